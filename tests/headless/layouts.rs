//! Tests that common layouts of RGB-D recordings open by one command, with depth and cameras.

use std::fs::File;
use std::path::{Path, PathBuf};

use image::codecs::jpeg::JpegEncoder;
use image::{ImageBuffer, ImageEncoder, Luma, Rgb, RgbImage};
use ostra_session::{Command, Session};

use super::frames::exif;
use crate::program::ostra;
use crate::project::Project;
use crate::session::perform;

/// Number of frames in each recording.
const FRAMES: u32 = 4;

fn image(path: PathBuf) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    RgbImage::from_pixel(64, 48, Rgb([90, 120, 60]))
        .save(path)
        .unwrap();
}

fn depth_image(path: PathBuf) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    ImageBuffer::<Luma<u16>, Vec<u16>>::from_pixel(64, 48, Luma([1500]))
        .save(path)
        .unwrap();
}

/// Returns the camera-to-world matrix of a frame, row by row.
fn matrix(frame: u32) -> String {
    format!(
        "1 0 0 {}\n0 1 0 0.25\n0 0 1 0\n0 0 0 1\n",
        0.1 * f64::from(frame)
    )
}

/// Returns a `.log` trajectory that counts from `first`.
fn log(first: u32) -> String {
    (0..FRAMES)
        .map(|k| format!("{0} {0} {1}\n{2}", k + first, k + first + 1, matrix(k)))
        .collect()
}

/// Opens a recording and checks the depth and camera of each frame.
///
/// Each frame must have its depth and the camera with its own number, or none if it is in `lost`.
fn opens(root: &Path, color: &str, depth: &str, more: &[&str], lost: &[usize]) {
    let [color, depth] = [color, depth].map(|name| root.join(name).display().to_string());
    let project = Project::new(
        Path::new(&color),
        &[&["--depth", &depth][..], more].concat(),
    );
    let info = project.info();
    for (number, frame) in info["frames"].as_array().unwrap().iter().enumerate() {
        assert_eq!(frame["depth"], true, "{frame}");
        assert_eq!(frame["camera"], !lost.contains(&number), "{frame}");
    }
    let out = root.join("out").display().to_string();
    project.done(&["export", &project.root(), "--cameras", &out]);
    let images = std::fs::read_to_string(Path::new(&out).join("images.txt")).unwrap();
    let lines: Vec<&str> = images
        .lines()
        .filter(|line| line.contains(['j', 'p']) && !line.starts_with('#'))
        .collect();
    assert_eq!(lines.len(), FRAMES as usize - lost.len(), "{images}");
    for line in lines {
        // The number in the image's name and the shift of its camera agree; numbers start at 0 or
        // 1.
        let words: Vec<&str> = line.split_whitespace().collect();
        let number = (0..FRAMES)
            .find(|&k| (words[5].parse::<f64>().unwrap() + 0.1 * f64::from(k)).abs() < 1e-9);
        let name = info["frames"][number.unwrap() as usize]["name"]
            .as_str()
            .unwrap();
        assert_eq!(words[9], name, "{line}");
    }
}

fn write(path: &Path, text: &str) -> String {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, text).unwrap();
    path.display().to_string()
}

const NUMBERS: [&str; 2] = ["--intrinsics", "60,60,32,24"];
const OPEN3D: &str =
    r#"{"width": 64, "height": 48, "intrinsic_matrix": [60, 0, 0, 0, 60, 0, 31.5, 23.5, 1]}"#;

#[test]
fn scenenn() {
    let root = tempfile::tempdir().unwrap();
    for k in 1..=FRAMES {
        image(root.path().join(format!("image/image{k:05}.png")));
        depth_image(root.path().join(format!("depth/depth{k:05}.png")));
    }
    let trajectory = write(&root.path().join("trajectory.log"), &log(0));
    opens(
        root.path(),
        "image",
        "depth",
        &[&["--cameras", &trajectory][..], &NUMBERS].concat(),
        &[],
    );
}

#[test]
fn stanford_and_redwood() {
    let root = tempfile::tempdir().unwrap();
    for k in 1..=FRAMES {
        image(root.path().join(format!("lounge_color/{k:06}.png")));
        depth_image(root.path().join(format!("lounge_depth/{k:06}.png")));
    }
    let trajectory = write(&root.path().join("lounge_trajectory.log"), &log(0));
    let json = write(&root.path().join("camera_intrinsic.json"), OPEN3D);
    let cameras = ["--cameras", &trajectory, "--intrinsics", &json];
    opens(root.path(), "lounge_color", "lounge_depth", &cameras, &[]);

    // Redwood's names are number and time stamp; the time stamps of image and depth differ
    // slightly.
    for k in 1..=FRAMES {
        image(
            root.path()
                .join(format!("scan/rgb/{k:07}-{:012}.jpg", 33_369 * (k - 1))),
        );
        depth_image(root.path().join(format!(
            "scan/depth/{k:07}-{:012}.png",
            33_369 * (k - 1) + 11
        )));
    }
    opens(root.path(), "scan/rgb", "scan/depth", &cameras, &[]);
}

#[test]
fn scannet() {
    let root = tempfile::tempdir().unwrap();
    for k in 0..FRAMES {
        image(root.path().join(format!("color/{k}.jpg")));
        depth_image(root.path().join(format!("depth/{k}.png")));
        let lost = "-inf -inf -inf -inf\n".repeat(4);
        write(
            &root.path().join(format!("pose/{k}.txt")),
            &if k == 2 { lost } else { matrix(k) },
        );
    }
    let intrinsics = "60 0 31.5 0\n0 60 23.5 0\n0 0 1 0\n0 0 0 1\n";
    let intrinsics = write(
        &root.path().join("intrinsic/intrinsic_color.txt"),
        intrinsics,
    );
    let poses = root.path().join("pose").display().to_string();
    opens(
        root.path(),
        "color",
        "depth",
        &["--cameras", &poses, "--intrinsics", &intrinsics],
        &[2],
    );
}

/// A recording whose depth comes from a camera of its own.
struct DepthCameraRecording {
    root: tempfile::TempDir,
    /// Folder of the images.
    color: String,
    /// Folder of the depth images.
    depths: String,
    /// File with the intrinsics of the image camera.
    of_color: String,
    /// File with the intrinsics of the depth camera.
    of_depth: String,
    /// File with the pose of the depth camera.
    aside: String,
}

impl DepthCameraRecording {
    fn new() -> Self {
        let root = tempfile::tempdir().unwrap();
        let path = |name: &str| root.path().join(name);
        std::fs::create_dir_all(path("color")).unwrap();
        std::fs::create_dir_all(path("depth")).unwrap();
        RgbImage::from_pixel(128, 96, Rgb([90, 120, 60]))
            .save(path("color/0.png"))
            .unwrap();
        // A board in front of a wall.
        let is_board = |x: u32, y: u32| (24..40).contains(&x) && (16..32).contains(&y);
        let depth = |x, y| Luma([if is_board(x, y) { 1500 } else { 3000 }]);
        ImageBuffer::<Luma<u16>, Vec<u16>>::from_fn(64, 48, depth)
            .save(path("depth/0.png"))
            .unwrap();
        let matrix = |focal, x, y| format!("{focal} 0 {x} 0\n0 {focal} {y} 0\n0 0 1 0\n0 0 0 1\n");
        let of_color = write(
            &path("intrinsic/intrinsic_color.txt"),
            &matrix(120, 63.5, 47.5),
        );
        let of_depth = write(
            &path("intrinsic/intrinsic_depth.txt"),
            &matrix(60, 31.5, 23.5),
        );
        let aside = write(
            &path("depth_to_color.txt"),
            "1 0 0 0.05\n0 1 0 0\n0 0 1 0\n0 0 0 1\n",
        );
        let (color, depths) = (
            path("color").display().to_string(),
            path("depth").display().to_string(),
        );
        Self {
            root,
            color,
            depths,
            of_color,
            of_depth,
            aside,
        }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.root.path().join(name)
    }

    /// Returns the options that give the depth and both cameras.
    fn options(&self) -> [&str; 8] {
        [
            "--depth",
            &self.depths,
            "--intrinsics",
            &self.of_color,
            "--depth-intrinsics",
            &self.of_depth,
            "--depth-pose",
            &self.aside,
        ]
    }

    /// Writes the image of a sensor that lay on its side; returns its folder.
    fn write_turned_image(&self) -> String {
        std::fs::create_dir_all(self.path("aside")).unwrap();
        let mut encoder = JpegEncoder::new(File::create(self.path("aside/0.jpg")).unwrap());
        encoder.set_exif_metadata(exif(6)).unwrap();
        RgbImage::from_pixel(128, 96, Rgb([90, 120, 60]))
            .write_with_encoder(encoder)
            .unwrap();
        self.path("aside").display().to_string()
    }
}

/// Checks depth from a separate camera, as ScanNet and RealSense record it before alignment.
#[test]
fn depths_of_a_camera_of_their_own() {
    let recording = DepthCameraRecording::new();
    let requested = recording.options();
    let project = Project::new(&recording.path("color"), &requested);

    // The sensor lay on its side: the stored image is shown rotated by a quarter turn to the right,
    // and so is its depth.
    let turned = recording.write_turned_image();
    project.done(
        &[
            &["add", &project.root(), "--frames", &turned][..],
            &requested,
        ]
        .concat(),
    );

    let mut session = Session::new();
    perform(&mut session, Command::Open(project.root().into())).unwrap();
    let frames = session.project().unwrap().frames.clone();
    let [seen, turned] =
        [0, 1].map(|frame| session.store().depth(&frames[frame]).unwrap().unwrap());
    assert_eq!(
        [(seen.width, seen.height), (turned.width, turned.height)],
        [(128, 96), (96, 128)]
    );
    // The board moves by 4 px to the right, the wall by 2. The part that the board hides from the
    // depth camera stays unknown.
    for (x, depth) in [
        (45, 3.0),
        (51, 0.0),
        (54, 1.5),
        (68, 1.5),
        (82, 1.5),
        (86, 3.0),
    ] {
        assert!(
            (seen.at(x, 48) - depth).abs() < 1e-3,
            "{x}: {} is not {depth}",
            seen.at(x, 48)
        );
        assert!(
            (turned.at(47, x) - depth).abs() < 1e-3,
            "{x}, turned: {} is not {depth}",
            turned.at(47, x)
        );
    }
}

#[test]
fn depth_camera_without_its_other_options_is_refused() {
    let recording = DepthCameraRecording::new();
    let DepthCameraRecording {
        color,
        depths,
        of_color,
        of_depth,
        ..
    } = &recording;
    let place = recording.path("refused").display().to_string();
    let refused = |more: &[&str]| {
        let refused = ostra(&[&["new", &place, "--frames", color][..], more].concat());
        assert_eq!(refused.status.code(), Some(1));
        String::from_utf8_lossy(&refused.stderr).into_owned()
    };
    assert!(refused(&recording.options()[..4]).contains("--depth-intrinsics"));
    assert!(
        refused(&["--depth", depths, "--depth-intrinsics", of_depth])
            .contains("--intrinsics, or --cameras")
    );
    assert!(
        refused(&["--intrinsics", of_color, "--depth-intrinsics", of_depth]).contains("--depth)")
    );
    assert!(!recording.path("refused").exists());
}

#[test]
fn frames_of_an_azure_kinect_or_realsense_recorder_without_poses() {
    let root = tempfile::tempdir().unwrap();
    for k in 0..FRAMES {
        image(root.path().join(format!("color/{k:05}.jpg")));
        depth_image(root.path().join(format!("depth/{k:05}.png")));
    }
    let json = write(&root.path().join("intrinsic.json"), OPEN3D);
    let depth = root.path().join("depth").display().to_string();
    let project = Project::new(
        &root.path().join("color"),
        &["--depth", &depth, "--intrinsics", &json],
    );
    assert!(
        project.info()["frames"]
            .as_array()
            .unwrap()
            .iter()
            .all(|frame| frame["depth"] == true)
    );

    let other = write(
        &root.path().join("other.json"),
        &OPEN3D.replace("64", "1280"),
    );
    let (place, color) = (
        root.path().join("p2").display().to_string(),
        root.path().join("color").display().to_string(),
    );
    let refused = ostra(&["new", &place, "--frames", &color, "--intrinsics", &other]);
    let text = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!(refused.status.code(), Some(1), "{text}");
    assert!(text.contains("1280x48") && text.contains("64x48"), "{text}");
}
