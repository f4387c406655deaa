//! Tests that all models are kept when images fall apart: listed, usable, and joined later.

use std::path::Path;

use glam::{DMat3, DQuat, DVec2, DVec3};
use image::{GrayImage, Luma};
use ostra_geometry::{Alignment, Camera, Pose, TrajectoryMetrics};
use ostra_project::{Project, ResultKind, ScaleEnd, ScaleRequest};
use ostra_session::{Command, Session};
use serde_json::{Value, json};
use tempfile::TempDir;

use super::scale::{HEIGHT, WIDTH, speckles};
use crate::program::{done, ostra, refused};
use crate::session::perform;

const FOCAL_PX: f64 = 225.0;

/// Images of a long street of speckled slabs, by folder: two places without overlap, and the way
/// between them.
struct Street {
    dir: TempDir,
}

fn camera() -> Camera {
    Camera::pinhole(
        WIDTH,
        HEIGHT,
        [FOCAL_PX; 2],
        [f64::from(WIDTH) / 2.0, f64::from(HEIGHT) / 2.0],
    )
}

/// Returns a camera above the street that points at a place of it; the azimuth is in degrees.
fn pose(place: f64, azimuth: f64) -> Pose {
    let (around, up) = (azimuth.to_radians(), 62_f64.to_radians());
    let target = DVec3::new(place, 0.0, 0.0);
    let away = DVec3::new(around.sin() * up.cos(), -around.cos() * up.cos(), up.sin());
    let forward = -away;
    let right = forward.cross(DVec3::Z).normalize();
    let rotation =
        DQuat::from_mat3(&DMat3::from_cols(right, forward.cross(right), forward).transpose());
    Pose {
        rotation,
        translation: -(rotation * (target + 3.6 * away)),
    }
}

/// Returns the shade at a pixel: every second slab lies higher than the street.
fn shade(pose: &Pose, at_px: DVec2) -> f64 {
    let from = pose.centre();
    let along = pose.rotation.inverse() * camera().unproject(at_px).extend(1.0);
    let at = |height: f64| from + along * ((height - from.z) / along.z);
    let top = at(0.4);
    let is_raised = (top.x / 0.9).rem_euclid(2.0) < 1.0 && top.y.abs() < 0.6;
    let (hit, shift) = if is_raised {
        (top, 40.0)
    } else {
        (at(0.0), 0.0)
    };
    speckles(hit.x + shift, hit.y)
}

/// The poses of a folder's images.
fn poses(folder: &str) -> Vec<Pose> {
    let around = |place: f64, count: u32| {
        let azimuth = move |k: u32| 14.0 * (f64::from(k) - f64::from(count - 1) / 2.0);
        (0..count).map(move |k| pose(place, azimuth(k))).collect()
    };
    match folder {
        "first" => around(0.0, 5),
        "second" => around(7.0, 4),
        _ => (1..8)
            .map(|k| pose(0.875 * f64::from(k), if k % 2 == 0 { 8.0 } else { -8.0 }))
            .collect(),
    }
}

impl Street {
    fn new() -> Self {
        let street = Self {
            dir: TempDir::new().unwrap(),
        };
        for folder in ["first", "second", "between"] {
            std::fs::create_dir(street.dir.path().join(folder)).unwrap();
            for (k, pose) in poses(folder).iter().enumerate() {
                let pixel = |x: u32, y: u32| {
                    let middle = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                    let offsets =
                        (0..4).map(|i| DVec2::new(f64::from(i % 2) - 0.5, f64::from(i / 2) - 0.5));
                    let sum: f64 = offsets.map(|o| shade(pose, middle + o / 2.0)).sum();
                    Luma([(255.0 * sum / 4.0).round() as u8])
                };
                let name = format!("{folder}/{folder}{k}.png");
                GrayImage::from_fn(WIDTH, HEIGHT, pixel)
                    .save(street.dir.path().join(name))
                    .unwrap();
            }
        }
        street
    }

    fn path(&self, name: &str) -> String {
        self.dir.path().join(name).display().to_string()
    }

    /// Makes a project of the two places and reconstructs their cameras; returns what is printed.
    fn reconstructed(&self, name: &str) -> (String, String) {
        let project = self.path(name);
        let intrinsics = format!("{FOCAL_PX},{FOCAL_PX},{},{}", WIDTH / 2, HEIGHT / 2);
        done(&[
            "new",
            &project,
            "--frames",
            &self.path("first"),
            "--frames",
            &self.path("second"),
            "--intrinsics",
            &intrinsics,
        ]);
        let text = reconstruct(&project, &["--method", "sfm"]);
        (project, text)
    }
}

/// Reconstructs a project and returns all that is printed.
fn reconstruct(project: &str, options: &[&str]) -> String {
    let output = ostra(&[&["reconstruct", project], options].concat());
    let text = String::from_utf8_lossy(&output.stdout).into_owned()
        + &String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{text}");
    text
}

fn info(project: &str) -> Value {
    serde_json::from_str(&done(&["info", project, "--json"])).unwrap()
}

/// Returns the models that `info --json` lists, without the number of their points.
fn models(info: &Value) -> Value {
    let mut models = info["results"]["cameras"]["models"].clone();
    for model in models.as_array_mut().into_iter().flatten() {
        let points = model.as_object_mut().unwrap().remove("points").unwrap();
        assert!(points.as_u64().unwrap() >= 60, "{points}");
    }
    models
}

/// Returns the names of the frames that have a camera.
fn placed(info: &Value) -> Vec<String> {
    let frames = info["frames"].as_array().unwrap().iter();
    let posed = frames.filter(|frame| frame["camera"] == true);
    let name = |frame: &Value| {
        let path = Path::new(frame["name"].as_str().unwrap());
        path.file_name().unwrap().to_string_lossy().into_owned()
    };
    posed.map(name).collect()
}

fn names(folder: &str) -> Vec<String> {
    (0..poses(folder).len())
        .map(|k| format!("{folder}{k}.png"))
        .collect()
}

/// Returns the poses in `sparse/images.txt` by the name of their image.
fn written_poses(project: &str) -> Vec<(String, Pose)> {
    let text = std::fs::read_to_string(Path::new(project).join("sparse/images.txt")).unwrap();
    let lines = text.lines().filter(|line| line.ends_with(".png"));
    let mut poses: Vec<(String, Pose)> = lines
        .map(|line| {
            let words: Vec<&str> = line.split_whitespace().collect();
            let n = |i: usize| words[i].parse::<f64>().unwrap();
            let name = Path::new(words[9]).file_name().unwrap().to_string_lossy();
            let pose = Pose {
                rotation: DQuat::from_xyzw(n(2), n(3), n(4), n(1)),
                translation: DVec3::new(n(5), n(6), n(7)),
            };
            (name.into_owned(), pose)
        })
        .collect();
    poses.sort_by(|a, b| a.0.cmp(&b.0));
    poses
}

/// Checks that the written cameras are those of these folders, up to a similarity.
fn check_written(project: &str, folders: &[&str]) {
    let mut truth: Vec<(String, Pose)> = folders
        .iter()
        .flat_map(|folder| names(folder).into_iter().zip(poses(folder)))
        .collect();
    truth.sort_by(|a, b| a.0.cmp(&b.0));
    let written = written_poses(project);
    let (written_names, found): (Vec<String>, Vec<Pose>) = written.into_iter().unzip();
    let (true_names, truth): (Vec<String>, Vec<Pose>) = truth.into_iter().unzip();
    assert_eq!(written_names, true_names);
    let error = TrajectoryMetrics::between(&found, &truth, Alignment::Sim3).unwrap();
    let share = error.centre.max / error.extent;
    assert!(share < 0.02, "{folders:?}: centre error {share:.4}");
}

#[test]
fn all_models_are_listed_and_the_second_can_be_used() {
    let street = Street::new();
    let (project, text) = street.reconstructed("project");
    assert!(
        text.contains("they fall into 2 models, of 5 and 4 frames; model 1 is in use"),
        "{text}"
    );
    assert!(
        text.contains("second0.png has no camera: belongs to model 2 of 4 images"),
        "{text}"
    );
    let listed = |first: bool| {
        json!([
            {"model": 1, "images": 5, "in_use": first},
            {"model": 2, "images": 4, "in_use": !first},
        ])
    };
    let before = info(&project);
    assert_eq!(models(&before), listed(true));
    assert_eq!(placed(&before), names("first"));
    check_written(&project, &["first"]);

    let text = done(&["select-model", &project, "2"]);
    assert!(text.contains("model 2 of 2 is in use: 4 frames"), "{text}");
    let after = info(&project);
    assert_eq!(models(&after), listed(false));
    assert_eq!(placed(&after), names("second"));
    check_written(&project, &["second"]);
    let text = done(&["info", &project]);
    assert!(
        text.contains("  model 1: 5 images, ") && text.contains("  model 2: 4 images, "),
        "{text}"
    );
    assert!(text.contains(" points, in use\n"), "{text}");

    done(&["select-model", &project, "1"]);
    assert_eq!(info(&project)["frames"], before["frames"]);
    check_written(&project, &["first"]);
    for wrong in ["0", "3"] {
        let text = refused(&["select-model", &project, wrong]);
        assert!(
            text.contains(&format!(
                "there is no model {wrong}; the project has models 1 to 2"
            )),
            "{text}"
        );
    }
}

#[test]
fn depth_maps_of_the_former_model_become_stale() {
    let street = Street::new();
    let (project, _) = street.reconstructed("project");
    let with_depth = || {
        done(&[
            "reconstruct",
            &project,
            "--method",
            "mvs",
            "--device",
            "cpu",
            "--max-side",
            "120",
        ]);
        let info = info(&project);
        assert_eq!(info["results"]["depths"]["stale"], false);
        let has = |frame: &&Value| frame["camera"] == true && frame["depth"] == true;
        info["frames"]
            .as_array()
            .unwrap()
            .iter()
            .filter(has)
            .count()
    };
    assert_eq!(with_depth(), 5);
    done(&["select-model", &project, "2"]);
    assert_eq!(info(&project)["results"]["depths"]["stale"], true);
    assert_eq!(with_depth(), 4);
    assert_eq!(models(&info(&project)).as_array().unwrap().len(), 2);
}

#[test]
fn frames_between_join_the_models() {
    let street = Street::new();
    // All poses are estimated again, or those of the model in use stay.
    for options in [&["--method", "sfm"][..], &["--device", "cpu"]] {
        let (project, _) = street.reconstructed(options[1]);
        done(&["select-model", &project, "2"]);
        done(&["add", &project, "--frames", &street.path("between")]);
        let text = reconstruct(&project, options);
        let joined = info(&project);
        assert_eq!(models(&joined), Value::Null, "{text}");
        assert_eq!(placed(&joined).len(), 16, "{text}");
        check_written(&project, &["first", "second", "between"]);
        let text = refused(&["select-model", &project, "1"]);
        assert!(text.contains("there is no other one to use"), "{text}");
    }
}

#[test]
fn use_of_a_model_is_undone_and_its_scale_is_kept() {
    let street = Street::new();
    let (project, _) = street.reconstructed("project");
    let mut session = Session::new();
    perform(&mut session, Command::Open(project.into())).unwrap();
    let state = |session: &Session| Project::clone(session.project().unwrap());
    let first = state(&session);
    let record = |project: &Project| project.results[&ResultKind::Cameras].clone();
    perform(&mut session, Command::SelectModel { model: 2 }).unwrap();
    let second = state(&session);
    assert_eq!(record(&second).frames, 4);
    assert_ne!(
        first.coordinates().world,
        second.coordinates().world,
        "nothing relates the positions of two models"
    );
    perform(&mut session, Command::Undo).unwrap();
    assert_eq!(state(&session), first);
    perform(&mut session, Command::Redo).unwrap();
    assert_eq!(state(&session), second);
    // The points of the model in use are read, not those of the other one.
    session.save().unwrap();
    let root = session.root().unwrap().to_owned();
    let points = ostra_project::store::read_sparse(&root, &second).unwrap();
    assert_eq!(points.points.len(), record(&second).models[1].points);
    assert_eq!(
        points.keypoints.keys().copied().collect::<Vec<_>>(),
        [5, 6, 7, 8]
    );
    // The scale that is set for one model stays with it.
    let ends = [DVec3::ZERO, DVec3::X].map(ScaleEnd::World);
    let scale = ScaleRequest { ends, length: 2.5 };
    perform(&mut session, Command::Scale(scale)).unwrap();
    let scaled = state(&session);
    assert_eq!(scaled.coordinates().scale, 2.5);
    for model in [1, 2] {
        perform(&mut session, Command::SelectModel { model }).unwrap();
        let scale = state(&session).coordinates().scale;
        assert_eq!(scale, if model == 2 { 2.5 } else { 1.0 });
    }
    assert_eq!(state(&session), scaled);
}
