//! Tests of structure from motion on real images: floors that may only rise, and errors.

use std::path::{Path, PathBuf};
use std::process::Command;

use image::imageops::FilterType;
use ostra_frames::cameras::{CameraKey, GivenCameras};
use ostra_geometry::{Alignment, Pose, Similarity};
use serde_json::Value;
use tempfile::TempDir;

use crate::data::data_dir;
use crate::project::Project;

impl Project {
    pub fn reconstruct(&self, more: &[&str]) -> String {
        let root = self.root();
        self.done(&[&["reconstruct", &root, "--method", "sfm"][..], more].concat())
    }

    pub fn placed(&self) -> usize {
        self.info()["results"]["cameras"]["frames"]
            .as_u64()
            .unwrap() as usize
    }

    /// Returns the camera errors against the ground truth after a Sim(3) alignment.
    pub fn errors(&self, truth: &Path) -> Value {
        self.errors_after(&["--align", "sim3"], truth)
    }

    /// Returns the camera errors against the ground truth after the given alignment.
    pub fn errors_after(&self, align: &[&str], truth: &Path) -> Value {
        let out = self.dir.path().join("cameras");
        self.done(&["export", &self.root(), "--cameras", out.to_str().unwrap()]);
        let eval = [
            "eval",
            "cameras",
            "--truth",
            truth.to_str().unwrap(),
            "--result",
            out.to_str().unwrap(),
        ];
        let text = self.done(&[&eval[..], &["--json"], align].concat());
        serde_json::from_str(text.lines().last().unwrap()).unwrap()
    }
}

/// Returns the centre error (rmse) in percent of the extent and the rotation median in degrees.
fn accuracy(name: &str, errors: &Value) -> (f64, f64) {
    let number = |path: &str| errors.pointer(path).and_then(Value::as_f64).unwrap();
    let (centre, rotation) = (
        number("/centre_percent"),
        number("/error/rotation_deg/median"),
    );
    println!(
        "{name}: {} cameras, centre {centre:.3} %, rotation {rotation:.3}°",
        errors["result"]
    );
    (centre, rotation)
}

fn fountain_with_given_intrinsics() {
    let data = data_dir();
    let set = data.join("strecha_fountain_P11");
    let project = Project::new(
        &set.join("images"),
        &["--cameras", set.join("sparse").to_str().unwrap()],
    );
    let output = project.reconstruct(&[]);
    assert!(
        output.contains("11 of 11 frames by sift + nearest"),
        "{output}"
    );
    let (centre, rotation) = accuracy("fountain, given", &project.errors(&set.join("sparse")));
    assert!(centre <= 0.05 && rotation <= 0.05);
}

fn fountain_with_unknown_intrinsics() {
    let data = data_dir();
    let set = data.join("strecha_fountain_P11");
    let project = Project::new(&set.join("images"), &[]);
    project.reconstruct(&[]);
    let (centre, rotation) = accuracy("fountain, unknown", &project.errors(&set.join("sparse")));
    assert_eq!(project.placed(), 11);
    assert!(centre <= 0.12 && rotation <= 0.6);
}

fn dtu_with_given_intrinsics() {
    let data = data_dir();
    let set = data.join("dtu_scan24");
    let project = Project::new(
        &set.join("images"),
        &["--cameras", set.join("sparse").to_str().unwrap()],
    );
    project.reconstruct(&[]);
    let (centre, rotation) = accuracy("dtu, given", &project.errors(&set.join("sparse")));
    assert_eq!(project.placed(), 49);
    assert!(centre <= 0.2 && rotation <= 0.15);
}

fn dtu_with_unknown_intrinsics() {
    let data = data_dir();
    let set = data.join("dtu_scan24");
    let project = Project::new(&set.join("images"), &[]);
    project.reconstruct(&[]);
    let (centre, _) = accuracy("dtu, unknown", &project.errors(&set.join("sparse")));
    assert_eq!(project.placed(), 49);
    assert!(centre <= 0.3);
}

fn castle_without_ground_truth_registers_completely() {
    let data = data_dir();
    let project = Project::new(&data.join("sceaux_castle/images"), &[]);
    let output = project.reconstruct(&[]);
    assert_eq!(project.placed(), 11, "{output}");
}

/// Checks a plant on a turntable.
///
/// The arm's set points are good to some millimetres on a circle of 300 mm.
fn thin_plant_on_a_turntable() {
    let data = data_dir();
    let set = data.join("romi_real_plant");
    let project = Project::new(&set.join("images"), &[]);
    let output = project.reconstruct(&[]);
    assert!(!output.contains("may be wrong"), "{output}");
    assert_eq!(project.placed(), 60, "{output}");
    let percent = set_point_error(&project, &set);
    println!("romi plant, unknown: 60 cameras, centre {percent:.3} %");
    assert!(percent <= 1.0);
}

/// Returns the rmse between camera centres and the arm's set points, in percent of the extent.
///
/// The centres are aligned by Sim(3).
fn set_point_error(project: &Project, set: &Path) -> f64 {
    let text = std::fs::read_to_string(set.join("approximate_poses.json")).unwrap();
    let reported: Value = serde_json::from_str(&text).unwrap();
    let found = cameras(project);
    let mut pairs = Vec::new();
    for frame in reported["frames"].as_array().unwrap() {
        let name = Path::new(frame["image"].as_str().unwrap())
            .file_name()
            .unwrap()
            .to_str()
            .unwrap()
            .to_owned();
        let at = |i: usize| {
            frame["approximate_pose_x_y_z_mm_pan_tilt_deg"][i]
                .as_f64()
                .unwrap()
        };
        let centre = found
            .iter()
            .find(|(known, _)| *known == name)
            .unwrap()
            .1
            .centre();
        pairs.push((centre, glam::DVec3::new(at(0), at(1), at(2))));
    }
    let (found, reported): (Vec<_>, Vec<_>) = pairs.into_iter().unzip();
    let alignment = Similarity::align(&found, &reported, Alignment::Sim3).unwrap();
    let middle = reported.iter().sum::<glam::DVec3>() / reported.len() as f64;
    let extent = reported
        .iter()
        .map(|x| x.distance(middle))
        .fold(0.0, f64::max);
    let errors = found
        .iter()
        .zip(&reported)
        .map(|(found, reported)| alignment.transform(*found).distance_squared(*reported));
    100.0 * (errors.sum::<f64>() / reported.len() as f64).sqrt() / extent
}

/// Returns the names and poses of the frames that have a camera.
pub(super) fn cameras(project: &Project) -> Vec<(String, Pose)> {
    let out = project.dir.path().join("read back");
    project.done(&[
        "export",
        &project.root(),
        "--cameras",
        out.to_str().unwrap(),
    ]);
    poses(&out)
}

/// Returns the names and poses of a file of cameras.
fn poses(path: &Path) -> Vec<(String, Pose)> {
    let named = |key: &CameraKey| match key {
        CameraKey::Name(name) => name.clone(),
        other => panic!("a camera without a name: {other:?}"),
    };
    let cameras = GivenCameras::read(path).unwrap().cameras;
    cameras
        .iter()
        .map(|camera| {
            (
                named(&camera.key),
                camera.camera_from_world.clone().unwrap(),
            )
        })
        .collect()
}

/// Checks that cameras are right, or that the program says that they may be wrong.
///
/// Nothing is known of the camera here, and the frames have little parallax.
fn cameras_of_a_shelf_are_right_or_doubted() {
    let data = data_dir();
    let set = data.join("apc_shelf_rgbd_labels");
    let project = Project::new(&set.join("color"), &[]);
    let output = project.reconstruct(&[]);
    let (_, rotation) = accuracy("shelf, unknown", &project.errors(&set.join("sparse")));
    let doubted = output.contains("the cameras may be wrong");
    assert!(doubted != (rotation < 2.0), "{rotation}° {output}");
}

/// Checks a map from 56 of 167 frames, in which the others are registered; colour only.
fn every_third_frame_of_a_kitchen_forms_the_map() {
    let data = data_dir();
    let set = data.join("redkitchen_rgbd_a");
    for (name, more) in [
        ("given", vec!["--cameras", "sparse"]),
        ("unknown", Vec::new()),
    ] {
        let more: Vec<String> = more
            .iter()
            .map(|word| {
                if *word == "sparse" {
                    set.join(word).display().to_string()
                } else {
                    (*word).to_owned()
                }
            })
            .collect();
        let project = Project::new(
            &set.join("color"),
            &more.iter().map(String::as_str).collect::<Vec<_>>(),
        );
        let output = project.reconstruct(&["--every", "3"]);
        assert!(!output.contains("may be wrong"), "{output}");
        assert_eq!(project.placed(), 167);
        let errors = project.errors(&set.join("sparse"));
        accuracy(&format!("kitchen, {name}"), &errors);
        let rmse = errors
            .pointer("/error/centre/rmse")
            .and_then(Value::as_f64)
            .unwrap();
        println!("kitchen, {name}: {:.1} cm", 100.0 * rmse);
        assert!(rmse <= 0.04);
    }
}

fn close_ups_are_added_to_an_existing_model() {
    let data = data_dir();
    let set = data.join("strecha_fountain_P11");
    let dir = TempDir::new().unwrap();
    let (small, crops) = (dir.path().join("small"), dir.path().join("crops"));
    std::fs::create_dir_all(&small).unwrap();
    std::fs::create_dir_all(&crops).unwrap();
    for k in 0..11 {
        let name = format!("{k:04}.jpg");
        let image = image::open(set.join("images").join(&name)).unwrap();
        image
            .resize_exact(384, 256, FilterType::Triangle)
            .save(small.join(name.replace("jpg", "png")))
            .unwrap();
        if [2, 5, 8].contains(&k) {
            image
                .crop_imm(500, 300, 640, 480)
                .save(crops.join(name.replace("jpg", "png")))
                .unwrap();
        }
    }
    let project = Project::new(&small, &[]);
    project.reconstruct(&[]);
    project.done(&["add", &project.root(), "--frames", crops.to_str().unwrap()]);
    let output = project.done(&["reconstruct", &project.root()]);
    assert_eq!(project.placed(), 14, "{output}");
    let found = cameras(&project);
    let truth = poses(&set.join("sparse"));
    let stem = |name: &str| {
        Path::new(name)
            .file_stem()
            .unwrap()
            .to_str()
            .unwrap()
            .to_owned()
    };
    let pairs = found.iter().filter_map(|(name, pose)| {
        let (_, truth) = truth.iter().find(|(known, _)| stem(known) == stem(name))?;
        Some((*pose, *truth))
    });
    let (found, truth): (Vec<Pose>, Vec<Pose>) = pairs.unzip();
    assert_eq!(found.len(), 14);
    let error =
        ostra_geometry::TrajectoryMetrics::between(&found, &truth, Alignment::Sim3).unwrap();
    let percent = 100.0 * error.centre.rmse / error.extent;
    println!("fountain at a quarter of its size with three close-ups: centre {percent:.3} %");
    assert!(percent <= 0.15);
}

/// Checks two cameras of different size and orientation.
///
/// Half of the images are cropped and rotated.
fn two_cameras_in_one_set() {
    let data = data_dir();
    let dir = TempDir::new().unwrap();
    let mut files: Vec<PathBuf> = std::fs::read_dir(data.join("banana/images"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    files.sort();
    for (number, file) in files.iter().enumerate() {
        let image = image::open(file).unwrap();
        let (width, height) = (image.width(), image.height());
        let half = if number % 2 == 0 {
            image
        } else {
            image
                .crop_imm(width / 8, height / 8, width * 3 / 4, height * 3 / 4)
                .rotate90()
        };
        half.save(dir.path().join(format!("{number:02}.png")))
            .unwrap();
    }
    let project = Project::new(dir.path(), &[]);
    let output = project.reconstruct(&[]);
    // DSC_0434, taken from low over the carpet, only matches under simulated tilts.
    assert_eq!(project.placed(), files.len(), "{output}");
    let out = dir.path().join("cameras");
    project.done(&[
        "export",
        &project.root(),
        "--cameras",
        out.to_str().unwrap(),
    ]);
    let list = std::fs::read_to_string(out.join("cameras.txt")).unwrap();
    assert_eq!(
        list.lines().filter(|line| !line.starts_with('#')).count(),
        2,
        "{list}"
    );
}

/// Writes images of the fountain, 384 pixels wide.
fn small_fountain(numbers: &[usize]) -> TempDir {
    let images = data_dir().join("strecha_fountain_P11/images");
    let dir = TempDir::new().unwrap();
    for number in numbers {
        let image = image::open(images.join(format!("{number:04}.jpg"))).unwrap();
        let small = image.resize_exact(384, 256, FilterType::Triangle);
        small
            .save(dir.path().join(format!("{number:04}.png")))
            .unwrap();
    }
    dir
}

fn model_does_not_depend_on_the_number_of_threads() {
    let images = small_fountain(&[2, 3, 4, 5, 6]);
    let model = |threads: &str| {
        let project = Project::new(images.path(), &[]);
        let run = Command::new(env!("CARGO_BIN_EXE_ostra"))
            .args(["reconstruct", &project.root(), "--method", "sfm"])
            .env("RAYON_NUM_THREADS", threads)
            .status()
            .unwrap();
        assert!(run.success());
        let sparse = project.dir.path().join("project/sparse");
        ["cameras.txt", "images.txt", "points3D.txt"]
            .map(|name| std::fs::read_to_string(sparse.join(name)).unwrap())
    };
    assert!(model("1") == model("3"));
}

fn known_length_sets_the_unit() {
    let images = small_fountain(&[2, 3, 4, 5]);
    let project = Project::new(images.path(), &[]);
    project.reconstruct(&[]);
    let out = project.dir.path().join("before");
    project.done(&[
        "export",
        &project.root(),
        "--cameras",
        out.to_str().unwrap(),
    ]);
    // Two points of the model, each seen by frames 1 and 2, serve as the ends of a ruler.
    let (ends, distance) = two_points(&out);
    let pixels = |end: &[(usize, [f64; 2])], option: &str| -> Vec<String> {
        end.iter()
            .flat_map(|(frame, [x, y])| [option.to_owned(), format!("{frame},{x},{y}")])
            .collect()
    };
    let more = [pixels(&ends[0], "--from"), pixels(&ends[1], "--to")].concat();
    let root = project.root();
    let args = ["scale", &root, "--length", "250"];
    project.done(
        &[
            &args[..],
            &more.iter().map(String::as_str).collect::<Vec<_>>(),
        ]
        .concat(),
    );
    let centres = |poses: Vec<(String, Pose)>| poses[0].1.centre().distance(poses[3].1.centre());
    let factor = centres(cameras(&project)) / centres(poses(&out));
    assert!(
        (factor * distance / 250.0 - 1.0).abs() < 0.01,
        "{factor} · {distance}"
    );
}

/// Frames and the pixels at which they see a point.
type Observations = Vec<(usize, [f64; 2])>;

/// Returns the pixels at which frames 1 and 2 see two points of a text model, and their distance.
fn two_points(model: &Path) -> ([Observations; 2], f64) {
    let lines = |name: &str| -> Vec<String> {
        let text = std::fs::read_to_string(model.join(name)).unwrap();
        text.lines()
            .filter(|line| !line.starts_with('#'))
            .map(str::to_owned)
            .collect()
    };
    let images = lines("images.txt");
    let seen = |frame: usize| -> Vec<(i64, [f64; 2])> {
        let words: Vec<f64> = images[2 * frame + 1]
            .split(' ')
            .map(|word| word.parse().unwrap())
            .collect();
        words
            .chunks(3)
            .map(|word| (word[2] as i64, [word[0], word[1]]))
            .collect()
    };
    let (first, second) = (seen(1), seen(2));
    let both: Vec<(i64, [f64; 2], [f64; 2])> = first
        .iter()
        .filter(|(point, _)| *point > 0)
        .filter_map(|&(point, at)| {
            Some((
                point,
                at,
                second.iter().find(|(other, _)| *other == point)?.1,
            ))
        })
        .collect();
    let left = both
        .iter()
        .min_by(|a, b| a.1[0].total_cmp(&b.1[0]))
        .unwrap();
    let right = both
        .iter()
        .max_by(|a, b| a.1[0].total_cmp(&b.1[0]))
        .unwrap();
    let position = |point: i64| -> glam::DVec3 {
        let points = lines("points3D.txt");
        let line = points
            .iter()
            .find(|line| line.starts_with(&format!("{point} ")))
            .unwrap();
        let words: Vec<f64> = line
            .split(' ')
            .skip(1)
            .take(3)
            .map(|word| word.parse().unwrap())
            .collect();
        glam::DVec3::new(words[0], words[1], words[2])
    };
    let ends = [left, right].map(|&(_, a, b)| vec![(1, a), (2, b)]);
    (ends, position(left.0).distance(position(right.0)))
}

fn depth_sets_the_scale() {
    let data = data_dir();
    let set = data.join("redkitchen_rgbd_a");
    let depth = set.join("depth").display().to_string();
    let more = [
        "--depth",
        &depth,
        "--intrinsics",
        "585,585,320.5,240.5",
        "--to",
        "60",
        "--every",
        "3",
    ];
    let project = Project::new(&set.join("color"), &more);
    let output = project.reconstruct(&[]);
    assert!(output.contains("scale from"), "{output}");
    let out = project.dir.path().join("cameras");
    project.done(&[
        "export",
        &project.root(),
        "--cameras",
        out.to_str().unwrap(),
    ]);
    let truth = set.join("sparse");
    let eval = [
        "eval",
        "cameras",
        "--truth",
        truth.to_str().unwrap(),
        "--result",
        out.to_str().unwrap(),
    ];
    let text = project.done(&[&eval[..], &["--align", "sim3", "--json"]].concat());
    let score: Value = serde_json::from_str(text.lines().last().unwrap()).unwrap();
    let scale = score
        .pointer("/error/alignment/scale")
        .and_then(Value::as_f64)
        .unwrap();
    println!("kitchen, scale from depth: {scale:.4} of the truth");
    assert!((scale - 1.0).abs() < 0.03, "{scale}");
}

fn undistorted_images_have_pinhole_cameras() {
    let images = small_fountain(&[3, 4, 5]);
    let project = Project::new(images.path(), &[]);
    project.reconstruct(&[]);
    let out = project.dir.path().join("plain");
    project.done(&[
        "export",
        &project.root(),
        "--undistorted",
        out.to_str().unwrap(),
    ]);
    let cameras = std::fs::read_to_string(out.join("sparse/cameras.txt")).unwrap();
    assert!(
        cameras
            .lines()
            .any(|line| line.contains(" PINHOLE 384 256 "))
            && !cameras.contains("RADIAL"),
        "{cameras}"
    );
    assert_eq!(
        image::image_dimensions(out.join("images/0004.png")).unwrap(),
        (384, 256)
    );
}

crate::registry::tests! {
    Data(&["strecha_fountain_P11"]) =>
        fountain_with_given_intrinsics,
        fountain_with_unknown_intrinsics,
        close_ups_are_added_to_an_existing_model,
        model_does_not_depend_on_the_number_of_threads,
        known_length_sets_the_unit,
        undistorted_images_have_pinhole_cameras;
    Data(&["dtu_scan24"]) => dtu_with_given_intrinsics, dtu_with_unknown_intrinsics;
    Data(&["sceaux_castle"]) => castle_without_ground_truth_registers_completely;
    Data(&["romi_real_plant"]) => thin_plant_on_a_turntable;
    Data(&["redkitchen_rgbd_a"]) => every_third_frame_of_a_kitchen_forms_the_map, depth_sets_the_scale;
    Data(&["banana"]) => two_cameras_in_one_set;
    Data(&["apc_shelf_rgbd_labels"]) => cameras_of_a_shelf_are_right_or_doubted;
}
