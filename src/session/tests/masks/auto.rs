//! Tests of the segmenter that `auto` takes on a recording.

use std::sync::Arc;
use std::sync::mpsc::{Sender, channel};
use std::time::Duration;

use super::*;
use crate::JobKind;
use crate::prepared::Preparation;
use ostra_frames::{DepthSource, Frame, FrameCamera, ImageSource, Orientation};
use ostra_geometry::{Camera, Pose};
use ostra_project::{OpenProject, Project};

const SIZE: (u32, u32) = (160, 120);

/// Writes a frame with a square at 1 m before a wall at 2 m; the camera is `number` · 2 cm aside.
fn frame(folder: &Path, number: u32) -> Frame {
    let is_square =
        |x: u32, y: u32| (50 - 3 * number..110 - 3 * number).contains(&x) && (30..90).contains(&y);
    let (image, depth) = (
        folder.join(format!("{number}.png")),
        folder.join(format!("{number}-depth.png")),
    );
    image::RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| {
        image::Rgb(match is_square(x, y) {
            true => [200, 40, 30],
            false => [90, 90, 95],
        })
    })
    .save(&image)
    .unwrap();
    image::ImageBuffer::from_fn(SIZE.0, SIZE.1, |x, y| {
        image::Luma([if is_square(x, y) { 1000_u16 } else { 2000 }])
    })
    .save(&depth)
    .unwrap();
    let lens = Camera::pinhole(SIZE.0, SIZE.1, [150.0, 150.0], [80.0, 60.0]);
    let pose = Pose {
        rotation: glam::DQuat::IDENTITY,
        translation: glam::DVec3::new(-0.02 * f64::from(number), 0.0, 0.0),
    };
    Frame {
        name: format!("{number}.png"),
        width: SIZE.0,
        height: SIZE.1,
        image: ImageSource::File {
            path: image,
            orientation: Orientation::default(),
        },
        depth: Some(DepthSource::Sensor {
            path: depth,
            unit: 0.001,
            orientation: Orientation::default(),
            camera: None,
        }),
        camera: Some(FrameCamera::given(lens, Some(pose))),
    }
}

fn recorded(folder: &Path) -> Session {
    let frames = (0..4).map(|number| frame(folder, number)).collect();
    let project = Project {
        frames: Arc::new(frames),
        ..Project::default()
    };
    let mut session = Session::new();
    session.open = Some(OpenProject::create(&folder.join("p"), project).unwrap());
    let label = Command::AddLabel {
        name: "box".into(),
        parent: None,
        color: None,
    };
    perform(&mut session, label).unwrap();
    session
}

fn click_by_auto() -> Command {
    let Command::Prompt(request) = click(LabelId(1), &[(80.5, 60.5)]) else {
        unreachable!("a click is a prompt")
    };
    Command::Prompt(PromptRequest {
        segmenter: SegmenterId::Auto,
        ..request
    })
}

/// Gives half of the square the colour of the wall, so that depth and colours give other answers.
fn paint_half(folder: &Path) {
    let is_red = |x: u32, y: u32| (50..84).contains(&x) && (30..90).contains(&y);
    image::RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| {
        image::Rgb(if is_red(x, y) {
            [200, 40, 30]
        } else {
            [90, 90, 95]
        })
    })
    .save(folder.join("0.png"))
    .unwrap();
}

#[test]
fn same_click_answered_by_another_segmenter_replaces_its_step() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = recorded(folder.path());
    let steps = session.undo_title().map(str::to_owned);
    paint_half(folder.path());
    let mut answer = |segmenter| {
        let Command::Prompt(request) = click_by_auto() else {
            unreachable!("a click is a prompt")
        };
        perform(
            &mut session,
            Command::Prompt(PromptRequest {
                segmenter,
                ..request
            }),
        )
        .unwrap();
    };
    answer(SegmenterId::Builtin);
    answer(SegmenterId::Geometry);
    let last = Some((0, LabelId(1)));
    assert_eq!(session.last_prompt(), last, "its size can be changed");
    perform(&mut session, Command::Undo).unwrap();
    assert!(session.project().unwrap().prompts.is_empty(), "one step");
    assert_eq!(session.undo_title().map(str::to_owned), steps);
}

/// Notes that frame 0 is being prepared, by a job that works until the sender is dropped.
fn being_prepared(session: &mut Session) -> Sender<()> {
    let (sender, receiver) = channel();
    let job = session.start("prepare", JobKind::ReadAhead, move |_| {
        let _ = receiver.recv();
        Ok(Box::new(|_: &mut Session| Ok(())))
    });
    let frames = Arc::downgrade(&session.project().unwrap().frames);
    session.prompting.preparing = Some(Preparation {
        frame: "0.png".into(),
        segmenter: SegmenterId::Auto,
        frames,
        job,
    });
    sender
}

#[expect(
    clippy::disallowed_methods,
    reason = "`settle` would wait for the job that prepares the frame, too"
)]
fn pause() {
    std::thread::sleep(Duration::from_millis(1));
}

/// Clicks and waits for the answer only; returns the title of its step and the notices.
fn answered(session: &mut Session) -> (String, Vec<String>) {
    session.act(click_by_auto()).unwrap();
    let mut notices = Vec::new();
    loop {
        for event in session.poll() {
            match event {
                Event::Notice(text) => notices.push(text),
                Event::Failed { error, .. } => panic!("{error}"),
                Event::Finished { title, .. } if title == "Segment" => {
                    return (session.undo_title().unwrap().to_owned(), notices);
                }
                _ => {}
            }
        }
        pause();
    }
}

/// Returns the preview of the click, waiting only for it.
fn preview(session: &mut Session) -> LabelMask {
    let Command::Prompt(request) = click_by_auto() else {
        unreachable!("a click is a prompt")
    };
    loop {
        session.hover(Some(request.clone()));
        session.poll();
        if let Some(mask) = session.hovered() {
            return mask.decode();
        }
        pause();
    }
}

fn recorded_segmenter(session: &Session) -> SegmenterId {
    let Some(Command::Prompt(request)) = session.recipe().commands.last() else {
        panic!("{:?}", session.recipe())
    };
    request.segmenter
}

#[test]
fn first_click_does_not_wait_until_geometry_is_prepared() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = recorded(folder.path());
    let preparing = being_prepared(&mut session);
    let previewed = preview(&mut session);
    let (title, notices) = answered(&mut session);
    let reason = "the frame is still being prepared for geometry";
    assert_eq!(title, format!("Click on box, frame 0 (builtin: {reason})"));
    assert_eq!(notices, [format!("segmenter: builtin ({reason})")]);
    assert_eq!(recorded_segmenter(&session), SegmenterId::Builtin);
    let mask_then = mask(&session);
    assert_eq!(mask_then.region(LabelId(1)), previewed.region(LabelId(1)));
    drop(preparing);
    session.prompting.preparing = None;
    session.settle(|_| ControlFlow::Continue(()));
    assert_eq!(mask(&session), mask_then, "geometry gives the same answer");
    assert!(session.undo_title().unwrap().contains(reason), "no step");
    perform(&mut session, Command::Undo).unwrap();

    let _preparing = being_prepared(&mut session);
    let previewed = preview(&mut session);
    let (title, notices) = answered(&mut session);
    assert_eq!(
        mask(&session).region(LabelId(1)),
        previewed.region(LabelId(1))
    );
    let reason = "a solid object with depth";
    assert_eq!(title, format!("Click on box, frame 0 (geometry: {reason})"));
    assert_eq!(notices, [format!("segmenter: geometry ({reason})")]);
    assert_eq!(recorded_segmenter(&session), SegmenterId::Auto);
}

#[test]
fn geometry_answers_an_early_click_again() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = recorded(folder.path());
    paint_half(folder.path());
    let preparing = being_prepared(&mut session);
    answered(&mut session);
    let early = mask(&session);
    drop(preparing);
    session.settle(|_| ControlFlow::Continue(()));
    let title = session.undo_title().unwrap();
    assert_eq!(
        title,
        "Click on box, frame 0 (geometry: a solid object with depth)"
    );
    assert_ne!(mask(&session), early);
    assert_eq!(recorded_segmenter(&session), SegmenterId::Auto);
    perform(&mut session, Command::Undo).unwrap();
    assert!(session.project().unwrap().prompts.is_empty(), "one step");
}

#[test]
fn geometry_answers_again_after_other_steps() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = recorded(folder.path());
    paint_half(folder.path());
    let preparing = being_prepared(&mut session);
    answered(&mut session);
    let early = mask(&session);
    let label = Command::AddLabel {
        name: "lid".into(),
        parent: None,
        color: None,
    };
    session.act(label).unwrap();
    drop(preparing);
    session.settle(|_| ControlFlow::Continue(()));
    let title = session.undo_title().unwrap();
    assert!(
        title.starts_with("Click on box, frame 0 (geometry"),
        "{title}"
    );
    assert_ne!(mask(&session), early);
    perform(&mut session, Command::Undo).unwrap();
    assert_eq!(mask(&session), early, "a step of its own");
}

#[test]
fn geometry_does_not_answer_a_click_that_was_taken_back() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = recorded(folder.path());
    paint_half(folder.path());
    let preparing = being_prepared(&mut session);
    answered(&mut session);
    session.act(click(LabelId(1), &[])).unwrap();
    drop(preparing);
    session.settle(|_| ControlFlow::Continue(()));
    let project = session.project().unwrap();
    assert!(project.prompts.is_empty() && project.masks.is_empty());
    assert_eq!(session.undo_title(), Some("Remove box from frame 0"));
}

#[test]
fn another_camera_prepares_the_frame_again() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = recorded(folder.path());
    let job = |session: &Session| session.prompting.preparing.as_ref().unwrap().job;
    session.prepare(0, SegmenterId::Auto);
    let first = job(&session);
    session.prepare(0, SegmenterId::Auto);
    assert_eq!(job(&session), first, "it is being prepared already");
    let camera = frame(folder.path(), 1).camera;
    let edit = ostra_project::Edit::SetCamera { frame: 0, camera };
    session.commit("Camera", vec![edit]).unwrap();
    session.prepare(0, SegmenterId::Auto);
    assert_ne!(job(&session), first);
}
