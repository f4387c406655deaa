//! Tests of structure from motion on unsuitable images.
//!
//! There must be one reason and no panic, and earlier results must stay.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use image::RgbImage;
use image::imageops::FilterType;
use ostra_project::{ReconstructMethod, ReconstructRequest};
use ostra_session::{Command as Request, Session};
use ostra_session::{Event, JobView};
use tempfile::TempDir;

use super::sfm::cameras;
use crate::data::data_dir;
use crate::program::ostra;
use crate::project::Project;

const WIDTH: u32 = 480;
const HEIGHT: u32 = 320;

/// A folder of small images.
struct Images {
    dir: TempDir,
    data: PathBuf,
}

impl Images {
    fn new() -> Self {
        Self {
            dir: TempDir::new().unwrap(),
            data: data_dir(),
        }
    }

    fn folder(&self) -> &Path {
        self.dir.path()
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// Returns a resized image of the real data.
    fn small(&self, from: &str) -> RgbImage {
        let image = image::open(self.data.join(from)).unwrap();
        image
            .resize_exact(WIDTH, HEIGHT, FilterType::Triangle)
            .to_rgb8()
    }

    fn put(&self, from: &str, name: &str) {
        self.small(from).save(self.path(name)).unwrap();
    }

    fn black(&self, name: &str) {
        RgbImage::new(WIDTH, HEIGHT).save(self.path(name)).unwrap();
    }

    /// Adds neighbouring images of the fountain.
    fn fountain(&self, count: usize) {
        for k in 0..count {
            self.put(
                &format!("strecha_fountain_P11/images/{k:04}.jpg"),
                &format!("fountain{k}.png"),
            );
        }
    }

    /// Adds views of a camera that rotates on the spot by `step` degrees per view.
    ///
    /// The focal length is `focal` image widths.
    fn turned(&self, views: u32, focal: f64, step: f64) {
        let from = image::open(self.data.join("strecha_fountain_P11/images/0004.jpg"))
            .unwrap()
            .to_rgb8();
        let focal_px = focal * f64::from(WIDTH);
        let from_focal_px = focal_px * f64::from(from.width()) / f64::from(WIDTH) / 1.6;
        for view in 0..views {
            let yaw = step * (f64::from(view) - 0.5 * f64::from(views - 1));
            let turn = DMat3::from_rotation_y(yaw.to_radians())
                * DMat3::from_rotation_x((2.0 * f64::from(view % 2)).to_radians());
            let image = RgbImage::from_fn(WIDTH, HEIGHT, |x, y| {
                let across = (f64::from(x) + 0.5 - 0.5 * f64::from(WIDTH)) / focal_px;
                let down = (f64::from(y) + 0.5 - 0.5 * f64::from(HEIGHT)) / focal_px;
                let ray = turn * DVec3::new(across, down, 1.0);
                let at =
                    |along: f64, side: u32| from_focal_px * along / ray.z + 0.5 * f64::from(side);
                between(&from, at(ray.x, from.width()), at(ray.y, from.height()))
            });
            image.save(self.path(&format!("{view}.png"))).unwrap();
        }
    }
}

/// Returns the bilinearly interpolated colour; outside the image, that of its edge.
fn between(image: &RgbImage, x: f64, y: f64) -> image::Rgb<u8> {
    let clamped = |at: f64, side: u32| (at - 0.5).clamp(0.0, f64::from(side) - 1.001);
    let (x, y) = (clamped(x, image.width()), clamped(y, image.height()));
    let (left, top) = (x as u32, y as u32);
    let (right, low) = (x.fract(), y.fract());
    let channel = |c: usize| {
        let at = |dx: u32, dy: u32| f64::from(image.get_pixel(left + dx, top + dy).0[c]);
        let row = |dy: u32| at(0, dy) * (1.0 - right) + at(1, dy) * right;
        (row(0) * (1.0 - low) + row(1) * low).round() as u8
    };
    image::Rgb([0, 1, 2].map(channel))
}

/// Runs a command that must fail and returns its error.
///
/// It must exit with code 1, report no result, not panic, and print one line with the reason.
fn refused(args: &[&str]) -> String {
    let output = ostra(args);
    let (message, why) = (
        String::from_utf8(output.stdout).unwrap(),
        String::from_utf8(output.stderr).unwrap(),
    );
    assert_eq!(output.status.code(), Some(1), "{args:?}: {message}{why}");
    assert!(
        message.is_empty() && !why.contains("panicked"),
        "{message}{why}"
    );
    let mut lines = why.lines().filter(|line| line.starts_with("ostra: "));
    let (first, more) = (lines.next().map(ToOwned::to_owned), lines.next());
    assert_eq!(more, None, "{why}");
    first.unwrap_or_else(|| panic!("{args:?} does not say why: {why}"))
}

/// Runs structure from motion where nothing can be registered, and returns the error.
///
/// The project must stay without cameras.
fn no_cameras(images: &Path, more: &[&str]) -> String {
    let project = Project::new(images, more);
    let why = refused(&["reconstruct", &project.root(), "--method", "sfm"]);
    assert!(
        project.info()["results"]["cameras"].is_null(),
        "{}",
        project.info()
    );
    why
}

/// Returns the reported reason why a frame has no camera.
fn reason<'a>(message: &'a str, frame: &str) -> &'a str {
    let begin = format!("warning: {frame} has no camera: ");
    let mut reported = message.lines().filter_map(|line| line.strip_prefix(&begin));
    let first = reported
        .next()
        .unwrap_or_else(|| panic!("nothing is said of {frame}: {message}"));
    assert_eq!(reported.next(), None, "{message}");
    first
}

fn left_out(message: &str) -> usize {
    message
        .lines()
        .filter(|line| line.contains(" has no camera: "))
        .count()
}

fn unrelated_images_are_refused_and_the_best_pair_is_named() {
    let images = Images::new();
    let things = [
        ("strecha_fountain_P11/images", "fountain.png"),
        ("sceaux_castle/images", "castle.png"),
        ("redkitchen_rgbd_a/color", "kitchen.png"),
    ];
    for (folder, name) in &things {
        images.put(first_in(&images.data.join(folder)).to_str().unwrap(), name);
    }
    let why = no_cameras(images.folder(), &[]);
    assert!(
        why.starts_with("ostra: no two images show the same scene: the nearest are "),
        "{why}"
    );
    assert!(
        things.iter().filter(|(_, name)| why.contains(name)).count() == 2,
        "{why}"
    );
    assert!(why.contains("take images that overlap"), "{why}");
}

fn first_in(folder: &Path) -> PathBuf {
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    files.sort();
    files.swap_remove(0)
}

fn copies_of_one_image_are_reported_as_an_unmoved_camera() {
    let images = Images::new();
    for name in ["a.png", "b.png", "c.png"] {
        images.put("strecha_fountain_P11/images/0004.jpg", name);
    }
    let why = no_cameras(images.folder(), &[]);
    assert!(
        why.contains(
            "did not move at all: no pair of 3 that show the same scene (best a.png and b.png, "
        ),
        "{why}"
    );
    assert!(why.contains("move sideways between images"), "{why}");
}

fn pure_rotation_is_reported() {
    let images = Images::new();
    images.turned(5, 1.08, 5.0);
    for more in [&[][..], &["--intrinsics", "518.4,518.4,240,160"]] {
        let why = no_cameras(images.folder(), more);
        assert!(
            why.contains("the camera only turned, or did not move at all: no pair of 10"),
            "{more:?}: {why}"
        );
    }
}

/// Checks pure rotation with focal lengths far from the initial guess of 1.2 image widths.
fn pure_rotation_is_reported_for_unusual_focal_lengths() {
    for focal in [0.7, 0.9, 1.8] {
        let images = Images::new();
        images.turned(6, focal, 5.0);
        let why = no_cameras(images.folder(), &[]);
        assert!(
            why.contains("the camera only turned"),
            "focal {focal}: {why}"
        );
    }
}

fn larger_of_two_scenes_is_kept_and_the_other_reported() {
    let images = Images::new();
    images.fountain(5);
    for k in 0..3 {
        images.put(
            &format!("sceaux_castle/images/100_710{k}.jpg"),
            &format!("castle{k}.png"),
        );
    }
    let project = Project::new(images.folder(), &[]);
    let message = project.reconstruct(&[]);
    assert_eq!(project.placed(), 5, "{message}");
    assert!(
        cameras(&project)
            .iter()
            .all(|(name, _)| name.starts_with("fountain")),
        "{message}"
    );
    assert!(
        message.contains("5 of 8 frames by sift + nearest"),
        "{message}"
    );
    for k in 0..3 {
        let why = reason(&message, &format!("castle{k}.png"));
        assert!(
            why.starts_with(
                "belongs to model 2 of 3 images, which is not connected with the one in use"
            ),
            "{why}"
        );
    }
    assert_eq!(left_out(&message), 3, "{message}");
}

fn truncated_image_is_named_at_the_start() {
    let images = Images::new();
    images.fountain(2);
    images.put("strecha_fountain_P11/images/0002.jpg", "cut.jpg");
    let whole = std::fs::read(images.path("cut.jpg")).unwrap();
    std::fs::write(images.path("cut.jpg"), &whole[..whole.len() / 2]).unwrap();
    let at = TempDir::new().unwrap();
    let root = at.path().join("project").display().to_string();
    let output = ostra(&["new", &root, "--frames", images.folder().to_str().unwrap()]);
    let warning = String::from_utf8(output.stderr).unwrap();
    assert!(
        output.status.success() && warning.contains("1 of 3 images cannot be read"),
        "{warning}"
    );
    assert!(
        warning.contains("cut.jpg: the image is damaged or cut off"),
        "{warning}"
    );
}

fn damaged_or_blank_images_are_reported_and_the_others_registered() {
    let images = Images::new();
    images.fountain(4);
    images.black("black.png");
    for name in ["cut.jpg", "garbage.jpg", "gone.jpg", "resized.png"] {
        images.put("strecha_fountain_P11/images/0002.jpg", name);
    }
    let project = Project::new(images.folder(), &[]);
    let whole = std::fs::read(images.path("cut.jpg")).unwrap();
    std::fs::write(images.path("cut.jpg"), &whole[..whole.len() / 2]).unwrap();
    std::fs::write(images.path("garbage.jpg"), "no image").unwrap();
    std::fs::remove_file(images.path("gone.jpg")).unwrap();
    RgbImage::new(300, 200)
        .save(images.path("resized.png"))
        .unwrap();
    let message = project.reconstruct(&[]);
    assert_eq!(project.placed(), 4, "{message}");
    for (name, words) in [
        (
            "black.png",
            "only 0 features; the image is blurred, dark, without texture or masked",
        ),
        ("cut.jpg", "the image is damaged or cut off"),
        ("garbage.jpg", "this is not a JPEG, PNG, TIFF or WebP image"),
        ("gone.jpg", "is missing"),
        (
            "resized.png",
            "it is 300 × 200 pixels now but was 480 × 320",
        ),
    ] {
        let why = reason(&message, name);
        assert!(why.contains(words), "{name}: {why}");
    }
    assert_eq!(left_out(&message), 5, "{message}");
}

fn one_image_is_too_few_and_two_are_enough() {
    let images = Images::new();
    images.fountain(1);
    let why = no_cameras(images.folder(), &[]);
    assert!(
        why.contains("no two images could be compared; give at least two images of the same scene"),
        "{why}"
    );
    images.fountain(2);
    let project = Project::new(images.folder(), &[]);
    let message = project.reconstruct(&[]);
    assert_eq!((project.placed(), left_out(&message)), (2, 0), "{message}");
    // Every 100th of two frames is one frame.
    let why = refused(&[
        "reconstruct",
        &project.root(),
        "--method",
        "sfm",
        "--every",
        "100",
    ]);
    assert!(why.contains("no two images could be compared"), "{why}");
    assert_eq!(project.placed(), 2);
}

fn tiny_and_black_images_give_an_error() {
    let images = Images::new();
    for k in 0..4 {
        let small = image::imageops::thumbnail(
            &images.small("strecha_fountain_P11/images/0004.jpg"),
            16,
            16,
        );
        small.save(images.path(&format!("small{k}.png"))).unwrap();
        images.black(&format!("black{k}.png"));
    }
    for (name, width, height) in [("dot.png", 1, 1), ("line.png", 900, 1), ("bar.png", 2, 400)] {
        RgbImage::from_fn(width, height, |x, y| {
            image::Rgb([(7 * x + 11 * y) as u8; 3])
        })
        .save(images.path(name))
        .unwrap();
    }
    no_cameras(images.folder(), &[]);
}

fn images_without_features_are_reported() {
    let images = Images::new();
    (0..3).for_each(|k| images.black(&format!("{k}.png")));
    let why = no_cameras(images.folder(), &[]);
    assert!(
        why.contains("features") && !why.contains("0 matches that do not agree"),
        "{why}"
    );
}

fn unrelated_images_leave_an_existing_model_unchanged() {
    let images = Images::new();
    images.fountain(5);
    let project = Project::new(images.folder(), &[]);
    project.reconstruct(&[]);
    let before = cameras(&project);
    assert_eq!(before.len(), 5);
    let others = Images::new();
    let names = ["castle.png", "kitchen.png", "black.png"];
    for (folder, name) in [
        ("sceaux_castle/images", names[0]),
        ("redkitchen_rgbd_a/color", names[1]),
    ] {
        others.put(first_in(&others.data.join(folder)).to_str().unwrap(), name);
    }
    others.black(names[2]);
    project.done(&[
        "add",
        &project.root(),
        "--frames",
        others.folder().to_str().unwrap(),
    ]);
    let message = project.done(&["reconstruct", &project.root()]);
    assert_eq!(project.info()["frames"].as_array().unwrap().len(), 8);
    assert!(
        message.contains("5 of 8 frames by sift + nearest"),
        "{message}"
    );
    assert_eq!(cameras(&project), before, "{message}");
    for name in &names[..2] {
        let why = reason(&message, name);
        assert!(
            why.contains("the nearest, do not agree with one camera movement"),
            "{why}"
        );
    }
    assert!(
        reason(&message, names[2]).starts_with("only 0 features"),
        "{message}"
    );
    assert_eq!(left_out(&message), 3, "{message}");
    // A failed run leaves the model unchanged.
    refused(&[
        "reconstruct",
        &project.root(),
        "--method",
        "sfm",
        "--only-labelled",
    ]);
    assert_eq!(cameras(&project), before);
}

/// Reconstructs and stops as soon as `enough` frames are in the map; returns the number of cameras.
fn stopped_with(session: &mut Session, enough: usize) -> usize {
    let request = ReconstructRequest {
        method: ReconstructMethod::Sfm,
        ..ReconstructRequest::default()
    };
    session.act(Request::Reconstruct(request)).unwrap();
    let events = session.settle(|jobs| {
        let is_enough = |job: &JobView| job.report.stage == "map" && job.report.done >= enough;
        if jobs.iter().any(is_enough) {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    });
    assert!(
        events
            .iter()
            .any(|event| matches!(event, Event::Stopped { .. })),
        "{events:?}"
    );
    session
        .project()
        .unwrap()
        .frames
        .iter()
        .filter(|frame| frame.posed_camera().is_some())
        .count()
}

fn stopped_run_keeps_its_frames_but_replaces_no_larger_model() {
    let images = Images::new();
    images.fountain(11);
    let project = Project::new(images.folder(), &[]);
    let mut session = Session::new();
    session.act(Request::Open(project.root().into())).unwrap();
    session.settle(|_| ControlFlow::Continue(()));
    let kept = stopped_with(&mut session, 4);
    assert!((4..11).contains(&kept), "{kept}");
    assert_eq!(
        stopped_with(&mut session, 0),
        kept,
        "stopped before it had as many"
    );
    session.act(Request::Undo).unwrap();
    assert!(
        session
            .project()
            .unwrap()
            .frames
            .iter()
            .all(|frame| frame.posed_camera().is_none())
    );
    session.act(Request::Redo).unwrap();
    session.save().unwrap();
    drop(session);
    assert_eq!(project.placed(), kept);
    let message = project.reconstruct(&[]);
    assert_eq!((project.placed(), left_out(&message)), (11, 0), "{message}");
}

crate::registry::tests! {
    Data(&["strecha_fountain_P11", "sceaux_castle", "redkitchen_rgbd_a"]) =>
        unrelated_images_are_refused_and_the_best_pair_is_named,
        unrelated_images_leave_an_existing_model_unchanged;
    Data(&["strecha_fountain_P11"]) =>
        copies_of_one_image_are_reported_as_an_unmoved_camera,
        pure_rotation_is_reported,
        pure_rotation_is_reported_for_unusual_focal_lengths,
        truncated_image_is_named_at_the_start,
        damaged_or_blank_images_are_reported_and_the_others_registered,
        one_image_is_too_few_and_two_are_enough,
        tiny_and_black_images_give_an_error,
        stopped_run_keeps_its_frames_but_replaces_no_larger_model;
    Data(&["strecha_fountain_P11", "sceaux_castle"]) => larger_of_two_scenes_is_kept_and_the_other_reported;
    Data(&[]) => images_without_features_are_reported;
}
