//! Tests that setting the scale changes all results together.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError, Weak};

use glam::{DMat3, DQuat, DVec2, DVec3, Vec3};
use image::{GrayImage, Luma};
use ostra_cloud::measure::LengthUnit;
use ostra_cloud::ply::{read_mesh, read_ply};
use ostra_core::job::Progress;
use ostra_geometry::{Camera, Pose};
use ostra_project::{ExportRequest, ScaleEnd, ScaleRequest};
use ostra_session::{Command, Event, JobCompletion, JobKind, Session};
use tempfile::TempDir;

use super::recording::Recording;
use crate::program::{contents, done};
use crate::program::{ostra, refused};
use crate::session::perform;

pub(super) const WIDTH: u32 = 240;
pub(super) const HEIGHT: u32 = 180;

fn camera() -> Camera {
    Camera::pinhole(
        WIDTH,
        HEIGHT,
        [225.0, 225.0],
        [f64::from(WIDTH) / 2.0, f64::from(HEIGHT) / 2.0],
    )
}

/// Returns a camera above a speckled carpet that points at its middle; the azimuth is in degrees.
fn pose(azimuth: f64) -> Pose {
    let (around, up) = (azimuth.to_radians(), 62_f64.to_radians());
    let centre = 3.6 * DVec3::new(around.sin() * up.cos(), -around.cos() * up.cos(), up.sin());
    let forward = -centre.normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let rotation =
        DQuat::from_mat3(&DMat3::from_cols(right, forward.cross(right), forward).transpose());
    Pose {
        rotation,
        translation: -(rotation * centre),
    }
}

/// Returns the shade of a speckled surface, 0 to 1.
pub(super) fn speckles(x: f64, y: f64) -> f64 {
    let corner = |x: f64, y: f64| {
        let mut mixed =
            (x as i64).wrapping_mul(0x9E37_79B9) ^ (y as i64).wrapping_mul(0x85EB_CA6B) ^ 77;
        mixed = (mixed ^ (mixed >> 15)).wrapping_mul(0x2C1B_3C6D);
        mixed = (mixed ^ (mixed >> 12)).wrapping_mul(0x297A_2D39);
        ((mixed ^ (mixed >> 15)) & 0xffff) as f64 / 65535.0
    };
    let octave = |scale: f64| {
        let (x, y) = (x * scale + 1000.0, y * scale + 1000.0);
        let (u, v) = (x.fract(), y.fract());
        let (u, v) = (u * u * (3.0 - 2.0 * u), v * v * (3.0 - 2.0 * v));
        let row = |y: f64| corner(x.floor(), y) * (1.0 - u) + corner(x.floor() + 1.0, y) * u;
        row(y.floor()) * (1.0 - v) + row(y.floor() + 1.0) * v
    };
    0.4 * octave(5.0) + 0.6 * octave(13.0)
}

/// Returns where a camera ray meets the surface, and whether this is the sheet above the middle.
fn seen(pose: &Pose, at_px: DVec2) -> (DVec3, bool) {
    let (from, along) = (
        pose.centre(),
        pose.rotation.inverse() * camera().unproject(at_px).extend(1.0),
    );
    let at = |height: f64| from + along * ((height - from.z) / along.z);
    let sheet = at(0.4);
    if sheet.x.abs().max(sheet.y.abs()) < 0.6 {
        (sheet, true)
    } else {
        (at(0.0), false)
    }
}

/// Images of a sheet of 1.2 × 1.2 above a carpet, with a COLMAP model and masks of the sheet.
pub(super) struct Photos {
    dir: TempDir,
    poses: Vec<Pose>,
}

impl Photos {
    pub(super) fn new(count: u32) -> Self {
        let photos = Self {
            dir: TempDir::new().unwrap(),
            poses: (0..count).map(|i| pose(14.0 * f64::from(i))).collect(),
        };
        for folder in ["color", "masks", "sparse"] {
            std::fs::create_dir(photos.dir.path().join(folder)).unwrap();
        }
        let mut images = String::new();
        for (k, pose) in photos.poses.iter().enumerate() {
            let middle = |x: u32, y: u32| DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let shade = |x: u32, y: u32| {
                let offsets = (0..4)
                    .map(|i| DVec2::new(f64::from(i % 2) - 0.5, f64::from(i / 2) - 0.5) / 2.0);
                let shades = offsets.map(|offset| match seen(pose, middle(x, y) + offset) {
                    (at, true) => speckles(at.x + 40.0, at.y),
                    (at, false) => speckles(at.x, at.y),
                });
                Luma([(255.0 * shades.sum::<f64>() / 4.0).round() as u8])
            };
            GrayImage::from_fn(WIDTH, HEIGHT, shade)
                .save(photos.path(&format!("color/{k}.png")))
                .unwrap();
            GrayImage::from_fn(WIDTH, HEIGHT, |x, y| {
                Luma([u8::from(seen(pose, middle(x, y)).1)])
            })
            .save(photos.path(&format!("masks/{k}.png")))
            .unwrap();
            let (q, t) = (pose.rotation, pose.translation);
            images += &format!(
                "{} {} {} {} {} {} {} {} 1 {k}.png\n\n",
                k + 1,
                q.w,
                q.x,
                q.y,
                q.z,
                t.x,
                t.y,
                t.z
            );
        }
        let intrinsics = format!(
            "1 PINHOLE {WIDTH} {HEIGHT} 225 225 {} {}\n",
            WIDTH / 2,
            HEIGHT / 2
        );
        std::fs::write(photos.path("sparse/cameras.txt"), intrinsics).unwrap();
        std::fs::write(photos.path("sparse/images.txt"), images).unwrap();
        std::fs::write(photos.path("sparse/points3D.txt"), "").unwrap();
        photos
    }

    pub(super) fn path(&self, name: &str) -> String {
        self.dir.path().join(name).display().to_string()
    }

    pub(super) fn project(&self, name: &str, more: &[&str]) -> String {
        let project = self.path(name);
        done(
            &[
                &["new", &project, "--frames", &self.path("color")][..],
                more,
            ]
            .concat(),
        );
        project
    }

    /// Returns images with a fused project, shared by all tests that run at the same time.
    ///
    /// The project has given cameras, stereo depth, and a labelled cloud with its surface.
    fn fused() -> Arc<Self> {
        static MADE: Mutex<Weak<Photos>> = Mutex::new(Weak::new());
        let mut made = MADE.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(photos) = made.upgrade() {
            return photos;
        }
        let photos = Arc::new(Self::new(4));
        let project = photos.project("project", &["--cameras", &photos.path("sparse")]);
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
        done(&["label", &project, "sheet"]);
        done(&["masks", &project, "import", &photos.path("masks")]);
        done(&["fuse", &project]);
        *made = Arc::downgrade(&photos);
        photos
    }

    /// Returns options that mark both ends of a line of length 1 on the sheet in two frames.
    fn ends(&self) -> Vec<String> {
        let sees = |frame: usize, x: f64| {
            let pose = &self.poses[frame];
            let at_px = camera()
                .project(pose.transform(DVec3::new(x, 0.0, 0.4)))
                .unwrap();
            format!("{frame},{},{}", at_px.x, at_px.y)
        };
        let ends = [("--from", -0.5), ("--to", 0.5)];
        ends.iter()
            .flat_map(|&(end, x)| [0, 2].map(|frame| [end.to_owned(), sees(frame, x)]))
            .flatten()
            .collect()
    }
}

/// A copy of the fused project for one test.
struct Fused {
    photos: Arc<Photos>,
    dir: TempDir,
}

impl Fused {
    fn new() -> Self {
        let fused = Self {
            photos: Photos::fused(),
            dir: TempDir::new().unwrap(),
        };
        let from = fused.photos.dir.path().join("project");
        for (path, bytes) in contents(&from) {
            let to = Path::new(&fused.project()).join(path.strip_prefix(&from).unwrap());
            std::fs::create_dir_all(to.parent().unwrap()).unwrap();
            std::fs::write(to, bytes).unwrap();
        }
        fused
    }

    fn project(&self) -> String {
        self.dir.path().join("project").display().to_string()
    }

    /// Returns the arguments that set the length of the line on the sheet.
    fn scale(&self, more: &[&str]) -> Vec<String> {
        let project = self.project();
        let words: Vec<String> = [&["scale", &project][..], more]
            .concat()
            .into_iter()
            .map(str::to_owned)
            .collect();
        [words, self.photos.ends()].concat()
    }

    /// Exports all results of the project.
    fn export(&self, name: &str) -> Exported {
        let (project, folder) = (self.project(), self.dir.path().join(name));
        let path = |name: &str| folder.join(name).display().to_string();
        let [cloud, las, mesh, voxels] =
            ["cloud.ply", "cloud.las", "mesh.ply", "voxels.ply"].map(path);
        let [cameras, depths, traits] = ["cameras", "depths", "traits.csv"].map(path);
        let of_points = [
            "--cloud", &cloud, "--mesh", &mesh, "--voxels", &voxels, "--traits", &traits,
        ];
        done(
            &[
                &["export", &project][..],
                &of_points,
                &["--cameras", &cameras, "--depths", &depths],
            ]
            .concat(),
        );
        done(&["export", &project, "--cloud", &las]);
        Exported { folder }
    }
}

struct Exported {
    folder: PathBuf,
}

impl Exported {
    fn cloud(&self) -> Vec<Vec3> {
        read_ply(&self.folder.join("cloud.ply"), &Progress::default())
            .unwrap()
            .cloud
            .positions
    }

    fn las(&self) -> Vec<DVec3> {
        let points = las::Reader::from_path(self.folder.join("cloud.las"))
            .unwrap()
            .read_all()
            .unwrap();
        points
            .points()
            .map(Result::unwrap)
            .map(|point| DVec3::new(point.x, point.y, point.z))
            .collect()
    }

    fn mesh(&self) -> Vec<Vec3> {
        read_mesh(&self.folder.join("mesh.ply"), &Progress::default())
            .unwrap()
            .vertices
            .positions
    }

    fn voxels(&self) -> Vec<Vec3> {
        read_ply(&self.folder.join("voxels.ply"), &Progress::default())
            .unwrap()
            .cloud
            .positions
    }

    fn translations(&self) -> Vec<DVec3> {
        let text = std::fs::read_to_string(self.folder.join("cameras/images.txt")).unwrap();
        let poses = text.lines().filter(|line| line.ends_with(".png"));
        let numbers = poses.map(|line| {
            line.split(' ')
                .map_while(|word| word.parse().ok())
                .collect::<Vec<f64>>()
        });
        numbers
            .map(|words| DVec3::new(words[5], words[6], words[7]))
            .collect()
    }

    fn depths(&self) -> Vec<f32> {
        depths_in(&self.folder.join("depths/1.tiff"))
    }

    /// Returns (trait, instance, value, unit) of each row.
    fn traits(&self) -> Vec<(String, String, f64, String)> {
        let text = std::fs::read_to_string(self.folder.join("traits.csv")).unwrap();
        let rows = text
            .lines()
            .skip(1)
            .map(|line| line.split(',').map(str::to_owned).collect::<Vec<_>>());
        rows.map(|cells| {
            (
                cells[3].clone(),
                cells[2].clone(),
                cells[4].parse().unwrap(),
                cells[5].clone(),
            )
        })
        .collect()
    }
}

fn depths_in(path: &Path) -> Vec<f32> {
    let mut decoder = tiff::decoder::Decoder::new(std::fs::File::open(path).unwrap()).unwrap();
    let tiff::decoder::DecodingResult::F32(depths) = decoder.read_image().unwrap() else {
        panic!("32-bit floats")
    };
    depths
}

fn assert_scaled(what: &str, before: &[Vec3], after: &[Vec3], factor: f32) {
    assert_eq!(before.len(), after.len(), "{what}");
    let off = before
        .iter()
        .zip(after)
        .map(|(a, b)| (factor * *a).distance(*b))
        .fold(0.0, f32::max);
    assert!(
        off < 1e-5 * factor.max(1.0) && before.len() > 50,
        "{what}: off by {off}"
    );
}

/// Checks that each length, area and volume is multiplied by the matching power of the factor.
fn assert_traits_scaled(before: &Exported, after: &Exported, factor: f64) {
    let (before, after) = (before.traits(), after.traits());
    assert_eq!(before.len(), after.len());
    let mut powers = [0; 4];
    for ((name, instance, value, unit), (other, of, scaled, same)) in before.iter().zip(&after) {
        assert_eq!((name, instance, unit), (other, of, same));
        let power = match unit.as_str() {
            "m" => 1,
            "m^2" => 2,
            "m^3" => 3,
            _ => 0,
        };
        let expected = value * factor.powi(power);
        assert!(
            (scaled - expected).abs() <= 0.02 * expected.abs() + 1e-6,
            "{name}: {scaled} instead of {expected}"
        );
        powers[power as usize] += 1;
    }
    assert!(
        powers.iter().all(|&count| count > 0),
        "lengths, areas, volumes and plain numbers: {powers:?}"
    );
}

fn assert_all_scaled(before: &Exported, after: &Exported, factor: f64) {
    let factor_32 = factor as f32;
    assert_scaled("cloud", &before.cloud(), &after.cloud(), factor_32);
    assert_scaled("mesh", &before.mesh(), &after.mesh(), factor_32);
    assert_scaled("voxels", &before.voxels(), &after.voxels(), factor_32);
    let narrow = |points: Vec<DVec3>| points.into_iter().map(DVec3::as_vec3).collect::<Vec<_>>();
    let off = narrow(before.las())
        .iter()
        .zip(&narrow(after.las()))
        .map(|(a, b)| (factor_32 * *a).distance(*b))
        .fold(0.0, f32::max);
    assert!(off < 2e-3 * factor_32.max(1.0), "LAS steps: {off}");
    for (a, b) in before.translations().iter().zip(&after.translations()) {
        assert!(
            (factor * *a).distance(*b) < 1e-6 * b.length(),
            "cameras: {a} and {b}"
        );
    }
    let (a, b) = (before.depths(), after.depths());
    assert!(a.iter().filter(|depth| **depth > 0.0).count() > 1000);
    assert!(
        a.iter()
            .zip(&b)
            .all(|(a, b)| (factor_32 * a - b).abs() <= 1e-5 * b),
        "depths"
    );
    assert_traits_scaled(before, after, factor);
}

/// Returns the files that the project publishes under fixed names.
fn published(project: &str) -> Vec<(PathBuf, Vec<u8>)> {
    let root = Path::new(project);
    let mut all: Vec<(PathBuf, Vec<u8>)> = ["depths", "sparse"]
        .iter()
        .flat_map(|name| contents(&root.join(name)))
        .collect();
    for name in ["cloud.ply", "mesh.ply", "votes.bin"] {
        all.push((root.join(name), std::fs::read(root.join(name)).unwrap()));
    }
    all
}

fn step(project: &str, command: Command) {
    let mut session = Session::new();
    perform(&mut session, Command::Open(project.into())).unwrap();
    perform(&mut session, command).unwrap();
}

fn votes_of(project: &str) -> Vec<u8> {
    std::fs::read(Path::new(project).join("votes.bin")).unwrap()
}

#[test]
fn every_result_is_scaled_in_one_step_and_undo_restores_the_bytes() {
    let fused = Fused::new();
    let project = fused.project();
    let before = fused.export("before");
    let (files, votes) = (published(&project), votes_of(&project));
    let info = done(&["info", &project, "--json"]);
    let message = done_with_both(&fused.scale(&["--length", "30", "--unit", "cm"]));
    assert!(
        message.contains("scaled by 0.300000") && !message.contains("warning"),
        "{message}"
    );
    let after = fused.export("after");
    assert_all_scaled(&before, &after, 0.3);
    let stale = |text: &str| {
        text.matches("\"stale\": true").count() + text.matches("\"stale\":true").count()
    };
    assert_eq!(
        stale(&done(&["info", &project, "--json"])),
        stale(&info),
        "what fitted before fits as before"
    );
    // The files under fixed names for other programs are scaled, too.
    let root = Path::new(&project);
    let plain = read_ply(&root.join("cloud.ply"), &Progress::default())
        .unwrap()
        .cloud
        .positions;
    assert_scaled("cloud.ply", &before.cloud(), &plain, 0.3);
    let first = |all: &[(PathBuf, Vec<u8>)]| {
        all.iter()
            .find(|(path, _)| path.ends_with("depths/1.png.tiff"))
            .unwrap()
            .0
            .clone()
    };
    let map = |depths: Vec<f32>| {
        depths
            .into_iter()
            .filter(|depth| *depth > 0.0)
            .fold(0.0_f64, |sum, depth| sum + f64::from(depth))
    };
    let scaled_map = map(depths_in(&first(&files)));
    assert_eq!(votes_of(&project), votes);
    step(&project, Command::Undo);
    assert!((scaled_map / map(depths_in(&first(&files))) - 0.3).abs() < 1e-6);
    assert_eq!(published(&project), files, "undo restores the bytes");
    assert_all_scaled(&before, &fused.export("undone"), 1.0);
    step(&project, Command::Redo);
    assert_all_scaled(&before, &fused.export("redone"), 0.3);
}

/// Runs a command that must succeed and returns both outputs.
pub(super) fn done_with_both(args: &[String]) -> String {
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    let output = ostra(&args);
    let text = format!(
        "{}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
    assert!(output.status.success(), "{args:?}: {text}");
    text
}

fn refused_scale(args: &[String]) -> String {
    refused(&args.iter().map(String::as_str).collect::<Vec<_>>())
}

#[test]
fn work_continues_in_the_new_scale() {
    let fused = Fused::new();
    let project = fused.project();
    let before = fused.export("before");
    // The length of the same line in pixels is set twice: half a unit, then two.
    done_with_both(&fused.scale(&["--length", "0.5"]));
    done_with_both(&fused.scale(&["--length", "2"]));
    assert_all_scaled(&before, &fused.export("twice"), 2.0);
    // The masks only vote again: the points do not change.
    let points = fused.export("points").cloud();
    done(&["masks", &project, "import", &fused.photos.path("masks")]);
    let message = done_with_both(&["fuse".to_owned(), project.clone()]);
    assert!(!message.contains("warning"), "{message}");
    assert_eq!(fused.export("again").cloud(), points);
    // A frame added now with its given camera gets the position it had among the others.
    let again = Exported {
        folder: fused.dir.path().join("again"),
    };
    done(&[
        "add",
        &project,
        "--frames",
        &fused.photos.path("color"),
        "--cameras",
        &fused.photos.path("sparse"),
    ]);
    let poses = fused.export("added").translations();
    assert_eq!(poses.len(), 2 * again.translations().len());
    assert!(
        poses
            .chunks(4)
            .all(|poses| poses[3].distance(again.translations()[3]) < 1e-6),
        "{poses:?}"
    );
    // After a full fusion, points and surface have the size of the cameras' scale.
    done(&["fuse", &project, "--min-confidence", "0.1"]);
    let made = fused.export("made");
    let extent = |points: &[Vec3]| {
        points
            .iter()
            .fold(0.0_f32, |most, point| most.max(point.length()))
    };
    let (old, new) = (extent(&points), extent(&made.cloud()));
    assert!((new / old - 1.0).abs() < 0.05, "{new} and {old}");
}

#[test]
fn failed_scaling_is_refused_and_changes_nothing() {
    let fused = Fused::new();
    let project = fused.project();
    let root = PathBuf::from(&project);
    let info = || done(&["info", &project, "--json"]);
    let before = info();
    let version = |start: &str| {
        let entries = std::fs::read_dir(root.join("versions"))
            .unwrap()
            .map(|entry| entry.unwrap().path());
        entries
            .filter(|path| {
                path.file_name()
                    .unwrap()
                    .to_str()
                    .unwrap()
                    .starts_with(start)
            })
            .max()
            .unwrap()
    };
    for (start, damaged, says) in [
        ("cloud-", version("cloud-"), "fuse again"),
        ("mesh-", version("mesh-"), "fuse again"),
    ] {
        let whole = std::fs::read(&damaged).unwrap();
        for bytes in [None, Some(&whole[..whole.len() / 2])] {
            let _ = std::fs::remove_file(&damaged);
            if let Some(bytes) = bytes {
                std::fs::write(&damaged, bytes).unwrap();
            }
            let message = refused_scale(&fused.scale(&["--length", "2"]));
            assert!(message.contains(says), "{start}: {message}");
            assert_eq!(info(), before, "{start}");
        }
        std::fs::remove_file(&damaged).unwrap();
        std::fs::write(&damaged, whole).unwrap();
    }
    for length in ["1e-30", "1e30", "1e300"] {
        let message = refused_scale(&fused.scale(&["--length", length]));
        assert!(
            message.contains("a million times") || message.contains("is not possible"),
            "{message}"
        );
    }
    for length in ["0", "-1", "nan", "inf"] {
        let words = fused.scale(&["--length", length]);
        assert_eq!(
            ostra(&words.iter().map(String::as_str).collect::<Vec<_>>())
                .status
                .code(),
            Some(2),
            "{length}"
        );
    }
    let inches = fused.scale(&["--length", "2", "--unit", "inch"]);
    assert_eq!(
        ostra(&inches.iter().map(String::as_str).collect::<Vec<_>>())
            .status
            .code(),
        Some(2)
    );
    assert_eq!(info(), before);
}

#[test]
fn one_damaged_depth_map_does_not_stop_the_scale() {
    let fused = Fused::new();
    let project = fused.project();
    let map = |version: u32| {
        PathBuf::from(&project).join(format!("versions/depths-{version}/maps/2.png.tiff"))
    };
    let damaged = (0..100).map(map).find(|map| map.exists()).unwrap();
    std::fs::write(&damaged, "cut off").unwrap();
    let before = fused.export("before").translations();
    let message = done_with_both(&fused.scale(&["--length", "2"]));
    assert!(
        message.contains("1 depth maps cannot be read") && message.contains("2.png"),
        "{message}"
    );
    let after = fused.export("after").translations();
    assert!(
        before
            .iter()
            .zip(&after)
            .all(|(before, after)| after.abs_diff_eq(*before * 2.0, 1e-9))
    );
    let info = done(&["info", &project, "--json"]);
    let info: serde_json::Value = serde_json::from_str(&info).unwrap();
    let has_depth = |frame: &&serde_json::Value| {
        frame["depth"].as_bool() == Some(true) || frame["depth"].is_object()
    };
    assert_eq!(
        info["frames"]
            .as_array()
            .unwrap()
            .iter()
            .filter(has_depth)
            .count(),
        3,
        "{info}"
    );
}

#[test]
fn scale_of_a_depth_sensor_cannot_be_changed() {
    let recording = Recording::new();
    let project = recording.project();
    let ends = [
        "--from", "0,20,20", "--from", "3,16,20", "--to", "0,30,20", "--to", "3,26,20",
    ];
    let message = refused(&[&["scale", &project, "--length", "2"][..], &ends].concat());
    assert!(message.contains("--depth-unit"), "{message}");
}

#[test]
fn given_cloud_keeps_its_scale_when_voted_again() {
    let fused = Fused::new();
    let project = fused.project();
    fused.export("given");
    let given = fused
        .dir
        .path()
        .join("given/cloud.ply")
        .display()
        .to_string();
    let options = ["--min-confidence", "0.05"];
    done(&["fuse", &project, "--onto", &given]);
    done_with_both(&fused.scale(&["--length", "0.5"]));
    let positions = || {
        read_ply(&Path::new(&project).join("cloud.ply"), &Progress::default())
            .unwrap()
            .cloud
    };
    let scaled = positions();
    // With other options the file is read again; its points must equal the scaled ones.
    done(&[&["fuse", &project, "--onto", &given][..], &options].concat());
    let again = positions();
    assert_eq!(again.positions, scaled.positions);
    assert_eq!(again.labels, scaled.labels);
}

fn world(x: f64) -> ScaleEnd {
    ScaleEnd::World(DVec3::new(x, 0.0, 0.0))
}

#[test]
fn lengths_have_a_unit_only_after_the_scale_is_set() {
    let photos = Photos::new(5);
    let project = photos.project("project", &[]);
    done(&["reconstruct", &project, "--method", "sfm"]);
    done(&["label", &project, "sheet"]);
    done(&["masks", &project, "import", &photos.path("masks")]);
    let given = photos.path("points.ply");
    std::fs::copy(
        Path::new(&project).join("sparse/points3D.txt"),
        photos.path("points.txt"),
    )
    .unwrap();
    write_points(&photos.path("points.txt"), &given);
    done(&["fuse", &project, "--onto", &given]);
    let csv = photos.path("traits.csv");
    let unit = || {
        done(&["export", &project, "--traits", &csv]);
        std::fs::read_to_string(&csv)
            .unwrap()
            .lines()
            .find_map(|line| {
                let unit = line.split(',').nth(5)?;
                ["units", "m"].contains(&unit).then(|| unit.to_owned())
            })
    };
    assert_eq!(unit().as_deref(), Some("units"));
    let message = refused(&["export", &project, "--traits", &csv, "--unit", "mm"]);
    assert!(
        message.contains("the scale of the cloud is not known") && message.contains("ostra scale"),
        "{message}"
    );
    let mut session = Session::new();
    perform(&mut session, Command::Open(project.clone().into())).unwrap();
    assert_eq!(session.length_unit(), LengthUnit::World);
    let request = ScaleRequest {
        ends: [world(0.0), world(1.0)],
        length: 0.25,
    };
    let events = perform(&mut session, Command::Scale(request.clone())).unwrap();
    let is_set = |event: &Event| matches!(event, Event::Notice(text) if text.starts_with("Scale set: 1 unit = 0.25 m"));
    assert!(events.iter().any(is_set), "{events:?}");
    assert_eq!(session.length_unit(), LengthUnit::Metre);
    perform(&mut session, Command::Undo).unwrap();
    assert_eq!(session.length_unit(), LengthUnit::World);
    perform(&mut session, Command::Redo).unwrap();
    drop(session);
    assert_eq!(unit().as_deref(), Some("m"));
    // Newly estimated cameras have no scale. The earlier cloud keeps its own and is not scaled with
    // them.
    done(&["reconstruct", &project, "--method", "sfm"]);
    assert_eq!(unit().as_deref(), Some("m"));
    let cloud = std::fs::read(Path::new(&project).join("cloud.ply")).unwrap();
    let mut session = Session::new();
    perform(&mut session, Command::Open(project.clone().into())).unwrap();
    let refused = perform(&mut session, Command::Scale(request)).unwrap_err();
    assert!(refused.to_string().contains("fuse again"), "{refused}");
    drop(session);
    assert_eq!(
        std::fs::read(Path::new(&project).join("cloud.ply")).unwrap(),
        cloud
    );
}

#[test]
fn cloud_of_earlier_cameras_is_not_scaled_and_never_metric() {
    let photos = Photos::new(5);
    let project = photos.project("project", &[]);
    done(&["reconstruct", &project, "--method", "sfm"]);
    done(&["label", &project, "sheet"]);
    done(&["masks", &project, "import", &photos.path("masks")]);
    let [text, given] = ["points.txt", "points.ply"].map(|name| photos.path(name));
    std::fs::copy(Path::new(&project).join("sparse/points3D.txt"), &text).unwrap();
    write_points(&text, &given);
    done(&["fuse", &project, "--onto", &given]);
    // Cameras that are estimated again have axes of their own.
    done(&["reconstruct", &project, "--method", "sfm"]);
    let cloud = || std::fs::read(Path::new(&project).join("cloud.ply")).unwrap();
    let before = cloud();
    let scale: [&str; 6] = ["scale", &project, "--length", "100", "--unit", "mm"];
    let args = [scale.map(str::to_owned).to_vec(), photos.ends()].concat();
    let message = done_with_both(&args);
    assert!(
        message.contains("keeps its size, without a unit"),
        "{message}"
    );
    assert_eq!(cloud(), before);

    let csv = photos.path("traits.csv");
    for unit in ["m", "cm", "mm"] {
        let message = refused(&["export", &project, "--traits", &csv, "--unit", unit]);
        assert!(message.contains("older than the scale"), "{message}");
    }
    let unit_of = |state: &str| {
        let mut session = Session::new();
        perform(&mut session, Command::Open(project.clone().into())).unwrap();
        assert_eq!(session.length_unit(), LengthUnit::World, "{state}");
        drop(session);
        done(&["export", &project, "--traits", &csv]);
        let text = std::fs::read_to_string(&csv).unwrap();
        assert!(text.contains(",units,") && !text.contains(",m,"), "{state}");
    };
    unit_of("scaled");
    step(&project, Command::Undo);
    unit_of("undone");
    step(&project, Command::Redo);
    unit_of("redone");
}

#[test]
fn scale_is_refused_while_a_long_job_runs_and_done_after_it() {
    let fused = Fused::new();
    let project = fused.project();
    let mut session = Session::new();
    perform(&mut session, Command::Open(project.clone().into())).unwrap();
    let (end, running) = std::sync::mpsc::channel::<()>();
    session.start("Track", JobKind::Long, move |_| {
        let _ = running.recv();
        Ok(Box::new(|_: &mut Session| Ok(())) as JobCompletion)
    });
    let request = ScaleRequest {
        ends: [world(0.0), world(1.0)],
        length: 0.25,
    };
    let scale = Command::Scale(request);
    let positions = || {
        let cloud = read_ply(&Path::new(&project).join("cloud.ply"), &Progress::default());
        cloud.unwrap().cloud.positions
    };
    let before = positions();
    let refused = session.act(scale.clone()).unwrap_err().to_string();
    assert!(
        refused.contains("'Track' is still running; wait for it or stop it"),
        "{refused}"
    );
    drop(end);
    session.settle(|_| std::ops::ControlFlow::Continue(()));
    assert_eq!(positions(), before, "nothing was scaled");
    perform(&mut session, scale).unwrap();
    assert_scaled("cloud", &before, &positions(), 0.25);
    let in_memory = &session.cloud().unwrap().positions;
    assert_scaled("cloud in memory", &before, in_memory, 0.25);
    perform(&mut session, Command::Undo).unwrap();
    assert_eq!(positions(), before);
}

#[test]
fn export_lists_what_it_wrote_with_sizes() {
    let fused = Fused::new();
    let mut session = Session::new();
    perform(&mut session, Command::Open(fused.project().into())).unwrap();
    let folder = fused.dir.path().join("out");
    let request = ExportRequest {
        cloud: Some(folder.join("cloud.ply")),
        twin: true,
        masks: Some(folder.join("masks")),
        ..ExportRequest::default()
    };
    let events = perform(&mut session, Command::Export(request)).unwrap();
    let items = events
        .into_iter()
        .find_map(|event| match event {
            Event::Exported(items) => Some(items),
            _ => None,
        })
        .unwrap();
    let size = |path: &Path| std::fs::metadata(path).unwrap().len();
    for item in items.iter().filter(|item| item.files.is_none()) {
        assert_eq!(item.bytes, size(&item.path), "{}", item.path.display());
    }
    let named = |name: &str| items.iter().find(|item| item.path.ends_with(name));
    assert!(named("cloud.ply").is_some() && named("cloud_labels.ply").is_some());
    let masks = named("masks").unwrap();
    let in_folder: Vec<_> = contents(&masks.path)
        .into_iter()
        .filter(|(path, _)| {
            !path
                .file_name()
                .unwrap()
                .as_encoded_bytes()
                .starts_with(b".")
        })
        .collect();
    assert_eq!(masks.files, Some(in_folder.len()));
    let bytes: usize = in_folder.iter().map(|(_, bytes)| bytes.len()).sum();
    assert_eq!(masks.bytes, bytes as u64);
}

/// Writes the points of a COLMAP text file as a PLY.
fn write_points(points: &str, ply: &str) {
    let text = std::fs::read_to_string(points).unwrap();
    let rows: Vec<String> = text
        .lines()
        .filter(|line| !line.starts_with('#'))
        .map(|line| {
            line.split(' ')
                .skip(1)
                .take(3)
                .collect::<Vec<_>>()
                .join(" ")
        })
        .collect();
    let header = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nend_header\n",
        rows.len()
    );
    std::fs::write(ply, header + &rows.join("\n") + "\n").unwrap();
}

#[test]
fn unit_of_given_cameras_is_questioned_without_sensor_depth() {
    let recording = Recording::new();
    let [color, depth, sparse] = ["color", "depth", "sparse"].map(|name| recording.path(name));
    let warned = |project: &str, more: &[&str]| {
        let project = recording.path(project);
        let new = ["new", &project, "--frames", &color, "--cameras", &sparse];
        let output = ostra(&[&new[..], more].concat());
        assert!(output.status.success(), "{output:?}");
        String::from_utf8(output.stderr)
            .unwrap()
            .contains("set the scale")
    };
    assert!(warned("photos", &[]));
    assert!(!warned("rgbd", &["--depth", &depth]));
}
