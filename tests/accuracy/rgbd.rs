//! Tests of RGB-D recordings without given cameras.

use std::path::Path;

use glam::DVec2;
use ostra_frames::{DepthSource, Frame, FrameStore};
use ostra_session::{Command, Session};
use serde_json::Value;

use crate::data::data_dir;
use crate::program::ostra;
use crate::project::Project;
use crate::session::perform;

const INTRINSICS: [&str; 2] = ["--intrinsics", "585,585,320.5,240.5"];

fn recording(set: &Path, more: &[&str]) -> Project {
    let depth = set.join("depth").display().to_string();
    Project::new(&set.join("color"), &[&["--depth", &depth], more].concat())
}

fn refused(project: &Project, more: &[&str]) -> String {
    let output = ostra(&[&["reconstruct", &project.root(), "--method", "rgbd"], more].concat());
    assert_eq!(output.status.code(), Some(1));
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Checks poses and focal length of a kitchen recording with unknown cameras.
///
/// The camera centres lie nearly on a line, so an alignment by centres leaves the rotation about
/// that line open. Rotation errors are therefore measured after aligning the orientations by
/// themselves, or together with the centres in one sum.
///
/// The recording's images are not registered to its depth. The sensor's colour camera has a focal
/// length of about 525 px and is offset by 2.5 cm; the given 585 px are those of the depth camera.
fn kitchen_without_cameras() {
    let data = data_dir();
    let set = data.join("redkitchen_rgbd_a");
    let project = recording(&set, &INTRINSICS);
    let output = project.done(&["reconstruct", &project.root()]);
    assert!(
        output.contains("167 of 167 frames by depth") && output.contains("px, not 585"),
        "{output}"
    );
    assert_eq!(project.placed(), 167);
    let out = tempfile::tempdir().unwrap();
    project.done(&[
        "export",
        &project.root(),
        "--cameras",
        out.path().to_str().unwrap(),
    ]);
    let cameras = std::fs::read_to_string(out.path().join("cameras.txt")).unwrap();
    let focal_px: f64 = cameras
        .lines()
        .last()
        .and_then(|line| line.split(' ').nth(4))
        .unwrap()
        .parse()
        .unwrap();
    println!("kitchen by depth: the images' focal length is {focal_px:.1} px");
    assert!((focal_px - 525.0).abs() < 10.0, "{cameras}");
    for (align, most_deg) in [
        (&["--align", "se3"][..], 3.5),
        (&["--align", "se3", "--turns"], 1.25),
    ] {
        let errors = project.errors_after(align, &set.join("sparse"));
        let number = |path: &str| errors.pointer(path).and_then(Value::as_f64).unwrap();
        let (centre, rotation) = (
            number("/error/centre/rmse"),
            number("/error/rotation_deg/median"),
        );
        println!(
            "kitchen by depth {}: {:.2} cm, rotation {rotation:.2}°",
            align.join(" "),
            100.0 * centre
        );
        let own = number("/error/own_rotation_deg/median");
        println!("kitchen by depth: rotation by itself {own:.2}°");
        assert!(
            centre <= 0.03 && rotation <= most_deg && own <= 1.0,
            "{centre} {rotation} {own}"
        );
    }
    the_camera_beside_is_part_of_the_step(&project);
    // Part of the error comes from the ground truth, which is itself the output of a tracker. With
    // the estimated poses and colour camera, depth of distant frames agrees more often than with
    // the given ones.
    let given = recording(
        &set,
        &[
            &["--cameras", set.join("sparse").to_str().unwrap()],
            &INTRINSICS[..],
        ]
        .concat(),
    );
    let [ours, theirs] = [&project, &given].map(shares_that_meet);
    println!(
        "kitchen: of the depths of frames 10, 20, 40 apart meet {ours:.3?} by what was found, {theirs:.3?} by what was given"
    );
    assert!(
        ours.iter().zip(&theirs).all(|(ours, theirs)| ours > theirs),
        "{ours:?} {theirs:?}"
    );
}

/// Checks that the estimated colour camera is part of the undo step.
///
/// After undo, images and depth have the given camera; after redo, each has its own again. This
/// also holds for the saved project.
fn the_camera_beside_is_part_of_the_step(project: &Project) {
    let mut session = Session::new();
    perform(&mut session, Command::Open(project.root().into())).unwrap();
    let cameras = |session: &Session| -> Vec<_> {
        let frames = session.project().unwrap().frames.iter();
        frames
            .map(|frame| {
                (
                    frame.camera.as_ref().map(|camera| camera.intrinsics),
                    frame.depth.clone(),
                )
            })
            .collect()
    };
    let found = cameras(&session);
    let own = |depth: &Option<DepthSource>| {
        matches!(
            depth,
            Some(DepthSource::Sensor {
                camera: Some(_),
                ..
            })
        )
    };
    assert!(
        found
            .iter()
            .all(|(camera, depth)| camera.unwrap().focal_px.x < 550.0 && own(depth))
    );
    let reopened = |session: Session| {
        drop(session);
        let mut session = Session::new();
        perform(&mut session, Command::Open(project.root().into())).unwrap();
        session
    };
    perform(&mut session, Command::Undo).unwrap();
    let mut session = reopened(session);
    assert!(
        cameras(&session)
            .iter()
            .all(|(camera, depth)| camera.unwrap().focal_px.x == 585.0 && !own(depth))
    );
    perform(&mut session, Command::Redo).unwrap();
    assert_eq!(cameras(&reopened(session)), found);
}

/// Returns how much depth agrees between frames 10, 20 and 40 apart.
///
/// Of the pixels that two frames see in nearly the same place, the share within 1.2 %.
fn shares_that_meet(project: &Project) -> [f64; 3] {
    let mut session = Session::new();
    perform(&mut session, Command::Open(project.root().into())).unwrap();
    let frames = &session.project().unwrap().frames;
    [10, 20, 40].map(|apart| {
        let pairs = (0..frames.len() - apart)
            .step_by(8)
            .map(|at| [&frames[at], &frames[at + apart]]);
        let shares: Vec<f64> = pairs
            .map(|pair| share_that_meets(pair, session.store()))
            .collect();
        shares.iter().sum::<f64>() / shares.len() as f64
    })
}

fn share_that_meets([source, target]: [&Frame; 2], store: &FrameStore) -> f64 {
    let (measured, there) = (
        store.depth(source).unwrap().unwrap(),
        store.depth(target).unwrap().unwrap(),
    );
    let ((camera, pose), (camera_there, pose_there)) = (
        source.posed_camera().unwrap(),
        target.posed_camera().unwrap(),
    );
    let there_from_here = pose_there.compose(&pose.inverse());
    let off = |(x, y): (u32, u32)| {
        let depth = Some(measured.at(x, y)).filter(|depth| (0.4..4.0).contains(depth))?;
        let ray = camera
            .unproject(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5))
            .extend(1.0);
        let point = there_from_here.transform(ray * f64::from(depth));
        let at_px = camera_there
            .project(point)
            .filter(|at_px| camera_there.contains(*at_px))?;
        let seen = Some(there.at(at_px.x as u32, at_px.y as u32)).filter(|seen| *seen > 0.0)?;
        Some((point.z / f64::from(seen) - 1.0).abs()).filter(|off| *off < 0.15)
    };
    let pixels = (0..measured.height)
        .step_by(4)
        .flat_map(|y| (0..measured.width).step_by(4).map(move |x| (x, y)));
    let offs: Vec<f64> = pixels.filter_map(off).collect();
    offs.iter().filter(|off| **off < 0.012).count() as f64 / offs.len().max(1) as f64
}

fn every_third_frame_is_registered_and_the_others_are_added() {
    let data = data_dir();
    let set = data.join("redkitchen_rgbd_a");
    let project = recording(&set, &[&["--to", "30"], &INTRINSICS[..]].concat());
    let root = project.root();
    project.done(&[
        "reconstruct",
        &root,
        "--method",
        "rgbd",
        "--every",
        "3",
        "--registration",
        "ransac",
    ]);
    assert_eq!(project.placed(), 31);
}

fn missing_requirements_of_registration_are_reported() {
    let data = data_dir();
    let set = data.join("redkitchen_rgbd_a");
    let images = Project::new(&set.join("color"), &["--to", "5"]);
    assert!(refused(&images, &[]).contains("--depth"));
    assert!(refused(&recording(&set, &["--to", "5"]), &[]).contains("--intrinsics"));
    let labelled = recording(&set, &[&["--to", "5"], &INTRINSICS[..]].concat());
    assert!(refused(&labelled, &["--only-labelled"]).contains("--only-labelled"));
}

crate::registry::tests! {
    Data(&["redkitchen_rgbd_a"]) =>
        kitchen_without_cameras,
        every_third_frame_is_registered_and_the_others_are_added,
        missing_requirements_of_registration_are_reported;
}
