//! Tests of the segmenter that `auto` takes, and of the reason that it prints.

use image::{ImageBuffer, Luma, RgbImage};
use tempfile::TempDir;

use super::recording::Recording;
use crate::program::done;

/// Writes four frames of a square of 60 × 60 pixels at 1 m and a pole of 4 pixels before a wall at
/// 2 m.
///
/// Square, pole and wall have the same colour, so that only depth distinguishes them. The cameras
/// stand side by side.
fn recorded() -> TempDir {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name);
    for name in ["color", "depth", "sparse"] {
        std::fs::create_dir(path(name)).unwrap();
    }
    let mut images = String::new();
    for k in 0..4_u32 {
        // Camera k is shifted by k · 2 cm to the right. With f = 150 px objects at 1 m move by 3 px
        // per frame.
        let is_near = |x: u32, y: u32| {
            let x = x + 3 * k;
            (30..90).contains(&y) && ((40..100).contains(&x) || (130..134).contains(&x))
        };
        RgbImage::from_pixel(160, 120, image::Rgb([120, 110, 100]))
            .save(path(&format!("color/{k}.png")))
            .unwrap();
        ImageBuffer::from_fn(160, 120, |x, y| {
            Luma([if is_near(x, y) { 1000_u16 } else { 2000 }])
        })
        .save(path(&format!("depth/{k}.png")))
        .unwrap();
        let x = -0.02 * f64::from(k);
        images += &format!("{} 1 0 0 0 {x} 0 0 1 {k}.png\n\n", k + 1);
    }
    let cameras = "1 PINHOLE 160 120 150 150 80 60\n";
    for (name, text) in [
        ("cameras.txt", cameras),
        ("images.txt", &images),
        ("points3D.txt", ""),
    ] {
        std::fs::write(path("sparse").join(name), text).unwrap();
    }
    folder
}

#[test]
fn auto_takes_geometry_on_a_recording_and_says_why() {
    let folder = recorded();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let [project, color, depth, sparse] = ["p", "color", "depth", "sparse"].map(path);
    done(&[
        "new",
        &project,
        "--frames",
        &color,
        "--depth",
        &depth,
        "--cameras",
        &sparse,
    ]);
    done(&["label", &project, "square"]);
    done(&["label", &project, "pole"]);
    let click = |label: &str, at: &str| {
        done(&[
            "prompt", &project, "--frame", "0", "--label", label, "--click", at,
        ])
    };
    let printed = click("square", "70,60");
    assert!(
        printed.contains("segmenter: geometry (a solid object with depth)"),
        "{printed}"
    );
    let printed = click("pole", "132,60");
    assert!(
        printed.contains("segmenter: builtin (a thin or small object)"),
        "{printed}"
    );
    let masks = path("masks");
    done(&["masks", &project, "export", &masks, "--format", "davis"]);
    let mask = image::open(folder.path().join("masks/0.png"))
        .unwrap()
        .to_luma8();
    let area = mask.pixels().filter(|pixel| pixel.0[0] > 0).count();
    assert!((3000..4600).contains(&area), "{area} pixels");
    let steps = std::fs::read_to_string(folder.path().join("p/history.jsonl")).unwrap();
    assert!(
        steps.contains("Click on square, frame 0 (geometry: a solid object with depth)"),
        "{steps}"
    );
}

#[test]
fn auto_takes_the_built_in_segmenter_on_a_photo_and_says_why() {
    let recording = Recording::new();
    let (project, color) = (recording.path("photos"), recording.path("color"));
    done(&["new", &project, "--frames", &color]);
    done(&["label", &project, "thing"]);
    let printed = done(&[
        "prompt", &project, "--frame", "1", "--label", "thing", "--click", "20,24",
    ]);
    assert!(
        printed.contains("segmenter: builtin (the frame has no depth)"),
        "{printed}"
    );
}
