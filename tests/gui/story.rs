//! Tests of the window with a real session behind it.

use std::ops::ControlFlow;
use std::path::Path;
use std::time::{Duration, Instant};

use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use glam::Vec3;
use ostra_app::{Dialog, Prefs, Shell, Window};
use ostra_cloud::LabelledCloud;
use ostra_cloud::ply::{SavedColors, save_ply};
use ostra_core::job::Progress;
use ostra_eval::synthetic::{Scene, SceneOptions};
use ostra_frames::{FrameFolder, OpenRequest};
use ostra_masks::{LabelId, MaskFormat};
use ostra_project::FuseRequest;
use ostra_session::{Command, NewProject, Recent, Session};

pub type Shown = Harness<'static, Option<Window>>;

pub fn window() -> Shown {
    let mut harness = Harness::builder()
        .with_size(egui::vec2(1200.0, 800.0))
        .build_ui_state(
            |ui, window: &mut Option<Window>| {
                let window = window.get_or_insert_with(|| {
                    Window::with(
                        Shell::new(Prefs::default(), None),
                        Recent::default(),
                        ui.ctx(),
                    )
                });
                window.poll(ui.ctx());
                window.show(ui);
            },
            None,
        );
    harness.run_steps(2);
    harness
}

pub fn inner(harness: &mut Shown) -> &mut Window {
    harness.state_mut().as_mut().unwrap()
}

/// Runs the window until `is_true`, and fails with `what` after 30 s.
pub fn until(harness: &mut Shown, what: &str, mut is_true: impl FnMut(&mut Shown) -> bool) {
    let begun = Instant::now();
    while !is_true(harness) {
        assert!(
            begun.elapsed() < Duration::from_secs(30),
            "waited in vain: {what}"
        );
        harness.run_steps(1);
        std::thread::park_timeout(Duration::from_millis(5));
    }
    harness.run_steps(2);
}

/// Writes three images of a bright square on a dark ground.
pub fn images(dir: &Path) {
    for number in 0..3_u32 {
        let square = |x: u32, y: u32| (30..60).contains(&(x - number * 3)) && (20..50).contains(&y);
        let pixel = |x, y| {
            if x >= number * 3 && square(x, y) {
                image::Rgb([230, 220, 60])
            } else {
                image::Rgb([40, 50, 70])
            }
        };
        image::RgbImage::from_fn(96, 72, pixel)
            .save(dir.join(format!("{number}.png")))
            .unwrap();
    }
}

fn open(harness: &mut Shown, dir: &Path) {
    images(dir);
    let sources = vec![FrameFolder {
        frames: dir.to_owned(),
        depth: None,
    }];
    let open = OpenRequest {
        sources,
        ..OpenRequest::default()
    };
    let root = dir.join("project");
    inner(harness).act(Command::New(NewProject {
        root,
        open,
        cameras: None,
        intrinsics: None,
    }));
    until(harness, "the project is open", |harness| {
        harness.query_by_label("Frame 2, no mask").is_some()
    });
}

#[test]
fn click_makes_a_keyframe_and_undo_removes_it() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = window();
    open(&mut harness, dir.path());
    let pane = harness.get_by_label("Image 0.png").rect();
    for pressed in [true, false] {
        let (pos, button) = (
            pane.center() - egui::vec2(3.0, 3.0),
            egui::PointerButton::Primary,
        );
        harness.hover_at(pos);
        harness.event(egui::Event::PointerButton {
            pos,
            button,
            pressed,
            modifiers: egui::Modifiers::NONE,
        });
        harness.run_steps(1);
    }
    until(&mut harness, "frame 0 is a keyframe", |harness| {
        harness.query_by_label("Frame 0, keyframe").is_some()
    });
    let project = inner(&mut harness).session().project().unwrap().clone();
    let area = project.masks[&0]
        .runs
        .decode()
        .ids
        .iter()
        .filter(|&&id| id == LabelId(1))
        .count();
    assert!(
        (600..1300).contains(&area),
        "the square has 900 pixels: {area}"
    );
    assert_eq!(project.labels.get(LabelId(1)).unwrap().name, "object 1");
    let title = inner(&mut harness)
        .session()
        .undo_title()
        .unwrap()
        .to_owned();
    let note = |harness: &mut Shown| inner(harness).shell().view.note.clone();
    harness.get_by_label("Undo").click();
    until(&mut harness, "frame 0 has no mask", |harness| {
        harness.query_by_label("Frame 0, no mask").is_some()
    });
    assert_eq!(
        note(&mut harness),
        format!("Undone: {title}"),
        "the status line no longer says that it is done"
    );
    inner(&mut harness).act(Command::Redo);
    assert_eq!(note(&mut harness), format!("Redone: {title}"));
}

/// Creates and fuses a project of the synthetic scene with its ground-truth masks.
fn fused(dir: &Path) -> std::path::PathBuf {
    let options = SceneOptions {
        views: 3,
        width: 120,
        height: 90,
        ..SceneOptions::default()
    };
    Scene::build(&options)
        .unwrap()
        .write(dir, &Progress::default())
        .unwrap();
    let masks = dir.join("truth/masks");
    std::fs::copy(dir.join("truth/labels.json"), masks.join("labels.json")).unwrap();
    let sources = vec![FrameFolder {
        frames: dir.join("color"),
        depth: Some(dir.join("depth")),
    }];
    let open = OpenRequest {
        sources,
        depth_unit: Scene::DEPTH_UNIT_M,
        ..OpenRequest::default()
    };
    let (root, cameras) = (dir.join("project"), Some(dir.join("sparse")));
    let mut session = Session::new();
    for command in [
        Command::New(NewProject {
            root: root.clone(),
            open,
            cameras,
            intrinsics: None,
        }),
        Command::ImportMasks {
            dir: masks,
            format: MaskFormat::Davis,
        },
        Command::Fuse(FuseRequest::default()),
    ] {
        session.act(command).unwrap();
        session.settle(|_| ControlFlow::Continue(()));
    }
    root
}

#[test]
fn cloud_in_the_window_follows_its_masks() {
    let dir = tempfile::tempdir().unwrap();
    let root = fused(dir.path());
    let mut harness = window();
    inner(&mut harness).act(Command::Open(root));
    let labelled = |harness: &mut Shown| {
        let cloud = inner(harness).session().cloud();
        cloud.map(|cloud| {
            cloud
                .labels
                .iter()
                .filter(|&&label| label != LabelId::NONE)
                .count()
        })
    };
    until(&mut harness, "the cloud is loaded", |harness| {
        labelled(harness).is_some_and(|points| points > 0)
    });
    let before = labelled(&mut harness);
    for frame in 0..3 {
        inner(&mut harness).act(Command::ClearMask { frame });
    }
    until(&mut harness, "no point has a label", |harness| {
        labelled(harness) == Some(0)
    });
    for _ in 0..3 {
        inner(&mut harness).act(Command::Undo);
    }
    until(&mut harness, "the labels are back", |harness| {
        labelled(harness) == before
    });
}

#[test]
fn changing_image_to_video_changes_the_file_extension() {
    let mut harness = window();
    inner(&mut harness).shell().view.dialog = Some(Dialog::Image);
    harness.run_steps(4);
    harness.get_by_label("Image file").focus();
    harness.run_steps(2);
    harness.event(egui::Event::Text("/out/plant.PNG".into()));
    harness.run_steps(2);
    for (take, field, path) in [
        ("Turntable video", "Video file", "/out/plant.mp4"),
        ("Image", "Image file", "/out/plant.png"),
        ("Turntable video", "Video file", "/out/plant.mp4"),
    ] {
        harness.get_by_label(take).click();
        harness.run_steps(3);
        assert_eq!(
            harness.get_by_label(field).value().as_deref(),
            Some(path),
            "{take}"
        );
    }
}

#[test]
fn open_error_is_shown_once_with_the_path() {
    let mut harness = window();
    inner(&mut harness).act(Command::Open("/nowhere/at/all".into()));
    until(&mut harness, "an error is shown", |harness| {
        harness.query_by_label("Error").is_some()
    });
    let notices = inner(&mut harness).shell().view.notices.shown().to_vec();
    assert_eq!(notices.len(), 1);
    assert!(
        notices[0].text.contains("/nowhere/at/all"),
        "{}",
        notices[0].text
    );
}

#[test]
fn closing_returns_to_the_start_page() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = window();
    open(&mut harness, dir.path());
    inner(&mut harness).act(Command::Close);
    until(&mut harness, "nothing is open", |harness| {
        harness.query_by_label("Frame 0, no mask").is_none()
    });
    assert!(harness.query_by_label("Photos of an object").is_some());
}

/// Fills in the image dialog, saves, and waits until the file at `path` exists.
fn write_image(harness: &mut Shown, field: &str, path: &Path) {
    harness.get_by_label(field).focus();
    harness.run_steps(2);
    harness.event(egui::Event::Text(path.display().to_string()));
    harness.run_steps(2);
    harness.get_by_label("Save").click();
    until(harness, "the file is written", |_| path.is_file());
}

#[test]
fn scene_view_is_saved_as_an_image_of_any_size() {
    let dir = tempfile::tempdir().unwrap();
    let (ply, png) = (dir.path().join("cloud.ply"), dir.path().join("seen.png"));
    let plane = (0..10_000).map(|k| Vec3::new((k % 100) as f32, (k / 100) as f32, 0.0) * 0.01);
    let mut cloud = LabelledCloud::from_positions(plane.collect());
    cloud.colors = vec![[200, 40, 30]; cloud.len()];
    save_ply(&ply, &cloud, SavedColors::Image, &Progress::default()).unwrap();
    let mut harness = window();
    inner(&mut harness).act(Command::Inspect(ply));
    until(&mut harness, "the cloud is there", |harness| {
        inner(harness).session().cloud().is_some()
    });
    harness.key_press_modifiers(
        egui::Modifiers::COMMAND | egui::Modifiers::SHIFT,
        egui::Key::E,
    );
    harness.run_steps(6);
    harness.get_by_label("Transparent background").click();
    harness.run_steps(2);
    write_image(&mut harness, "Image file", &png);
    let image = image::open(&png).unwrap().to_rgba8();
    assert_eq!(image.dimensions(), (1920, 1080));
    let [r, g, b, opacity] = image.get_pixel(960, 540).0;
    assert!(
        opacity == 255 && r > 150 && g < 70 && b < 70,
        "{r} {g} {b} {opacity}"
    );
    assert_eq!(image.get_pixel(3, 3).0[3], 0);
}
