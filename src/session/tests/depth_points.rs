//! Points of depth maps before there is a cloud.

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;

use glam::{DQuat, DVec3, Vec3};

use crate::{DepthPoints, Event, Session};
use ostra_frames::{DepthSource, Frame, FrameCamera, FrameStore, ImageSource, Orientation};
use ostra_geometry::{Camera, Pose};
use ostra_masks::{LabelId, LabelMask, RunMask};
use ostra_project::{Edit, FrameMask, MaskOrigin, OpenProject, Project};

const SIZE: [u32; 2] = [8, 6];

/// Writes a red image and a depth of 2 m, the left half of which is unknown.
fn frame(folder: &Path, name: &str) -> Frame {
    let [width, height] = SIZE;
    let (image, depth) = (
        folder.join(format!("{name}.png")),
        folder.join(format!("{name}-depth.png")),
    );
    image::RgbImage::from_pixel(width, height, image::Rgb([200, 10, 20]))
        .save(&image)
        .unwrap();
    image::ImageBuffer::from_fn(width, height, |x, _| {
        image::Luma([if x < width / 2 { 0_u16 } else { 2000 }])
    })
    .save(&depth)
    .unwrap();
    Frame {
        name: name.into(),
        width,
        height,
        image: ImageSource::File {
            path: image,
            orientation: Orientation(1),
        },
        depth: Some(DepthSource::Sensor {
            path: depth,
            unit: 0.001,
            orientation: Orientation(1),
            camera: None,
        }),
        camera: Some(camera(None)),
    }
}

fn camera(camera_from_world: Option<Pose>) -> FrameCamera {
    FrameCamera::given(
        Camera::pinhole(SIZE[0], SIZE[1], [8.0, 8.0], [4.0, 3.0]),
        camera_from_world,
    )
}

/// Returns a pose that moves the world by `x` to the right of the camera.
fn shifted(x: f64) -> Pose {
    Pose {
        rotation: DQuat::IDENTITY,
        translation: DVec3::new(x, 0.0, 0.0),
    }
}

fn opened(folder: &Path) -> Session {
    let frames = ["a", "b"].map(|name| frame(folder, name)).to_vec();
    let project = Project {
        frames: Arc::new(frames),
        ..Project::default()
    };
    let mut session = Session::new();
    session.open = Some(OpenProject::create(&folder.join("p"), project).unwrap());
    session
}

/// Requests the points until they are known, and returns them with the events.
fn points(session: &mut Session, frame: usize) -> (Arc<DepthPoints>, Vec<Event>) {
    let mut events = Vec::new();
    for _ in 0..3 {
        let _ = session.depth_points(frame, false);
        events.extend(session.settle(|_| ControlFlow::Continue(())));
    }
    (
        Arc::clone(session.depth_points(frame, false).unwrap()),
        events,
    )
}

fn set_camera(session: &mut Session, frame: usize, camera_from_world: Pose) {
    let camera = Some(camera(Some(camera_from_world)));
    let edit = Edit::SetCamera { frame, camera };
    session.commit("Camera", vec![edit]).unwrap();
}

#[test]
fn frame_without_cameras_is_shown_alone_and_all_frames_with_them() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(folder.path());
    assert!(session.depth_points(0, false).is_none(), "not read yet");
    let (alone, _) = points(&mut session, 1);
    let known = (SIZE[0] / 2 * SIZE[1]) as usize;
    assert_eq!(alone.cloud.len(), known);
    assert!(!alone.has_all && !alone.in_world);
    assert_eq!(alone.cloud.colors, vec![[200, 10, 20]; known]);
    // Pixel (4, 0) has its centre at (4.5, 0.5).
    assert_eq!(
        alone.cloud.positions[0],
        Vec3::new(2.0 * 0.5 / 8.0, 2.0 * -2.5 / 8.0, 2.0)
    );
    set_camera(&mut session, 0, shifted(-5.0));
    let (first, _) = points(&mut session, 1);
    assert!(first.has_all && first.in_world);
    assert_eq!(first.cloud.len(), known, "frame b has no place yet");
    assert!(first.cloud.positions.iter().all(|x| x.x > 5.0));
    set_camera(&mut session, 1, shifted(5.0));
    let (both, events) = points(&mut session, 1);
    assert_eq!(both.cloud.len(), 3 * known, "all frames and the shown one");
    assert!(events.contains(&Event::CloudChanged), "{events:?}");
    let left = both.cloud.positions.iter().filter(|x| x.x < 0.0).count();
    assert_eq!(left, 2 * known);
}

#[test]
fn masks_label_the_points_without_reading_depths_again() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(folder.path());
    set_camera(&mut session, 0, shifted(0.0));
    let (before, _) = points(&mut session, 0);
    assert!(
        before
            .cloud
            .labels
            .iter()
            .all(|&label| label == LabelId::NONE)
    );
    // Depths and images are not needed any more.
    for name in ["a", "b"] {
        std::fs::remove_file(folder.path().join(format!("{name}.png"))).unwrap();
        std::fs::remove_file(folder.path().join(format!("{name}-depth.png"))).unwrap();
    }
    session.store = Arc::new(FrameStore::new(0));
    let mut mask = LabelMask::empty(SIZE[0], SIZE[1]);
    mask.ids[7] = LabelId(3);
    let mask = FrameMask {
        runs: Arc::new(RunMask::encode(&mask)),
        origin: MaskOrigin::Keyframe,
        stale: false,
        confidence: Default::default(),
    };
    let label = Edit::SetLabel {
        id: LabelId(3),
        label: Some(ostra_project::testing::label(3, "leaf")),
    };
    let edit = Edit::SetMask {
        frame: 0,
        mask: Some(mask),
    };
    session.commit("Mask", vec![label, edit]).unwrap();
    let earlier = session.depth_points(0, false).unwrap();
    assert!(
        Arc::ptr_eq(earlier, &before),
        "shown until the new labels are known"
    );
    let (after, _) = points(&mut session, 0);
    assert_eq!(after.cloud.positions, before.cloud.positions);
    let labelled = after
        .cloud
        .labels
        .iter()
        .filter(|&&label| label == LabelId(3));
    assert_eq!(labelled.count(), 2, "of all frames and of the shown one");
}

#[test]
fn unreadable_depths_are_named_and_the_others_are_shown() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(folder.path());
    set_camera(&mut session, 0, shifted(0.0));
    set_camera(&mut session, 1, shifted(0.0));
    std::fs::write(folder.path().join("b-depth.png"), "no image").unwrap();
    let (points, events) = points(&mut session, 1);
    assert_eq!(points.cloud.len(), (SIZE[0] / 2 * SIZE[1]) as usize);
    let warned = |event: &Event| matches!(event, Event::Warning(text) if text.contains("not shown") && text.ends_with(": b"));
    assert!(events.iter().any(warned), "{events:?}");
    assert!(
        !events
            .iter()
            .any(|event| matches!(event, Event::Failed { .. }))
    );
}
