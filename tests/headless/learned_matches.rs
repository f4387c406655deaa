//! Tests that networks for features and matches are installed, tested and used.
//!
//! The networks are small ones with the interfaces of COLMAP's files.

use std::path::Path;

use image::{GrayImage, Luma};
use ostra_compute::nn::Catalogue;

use super::networks::{done, ostra, public, refused};
use super::scale::{HEIGHT, Photos, WIDTH};

fn add(folder: &Path, name: &str, file: &str) -> String {
    let path = public(file);
    let output = ostra(folder, &["models", "add", name, path.to_str().unwrap()]);
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

/// Reconstructs the cameras of a project and returns all that is printed.
fn cameras(folder: &Path, project: &str, more: &[&str]) -> String {
    let args = [&["reconstruct", project, "--method", "sfm"], more].concat();
    let output = ostra(folder, &args);
    let text = String::from_utf8_lossy(&output.stdout).into_owned()
        + &String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{text}");
    text
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn features_and_matches_of_networks_give_cameras() {
    let scratch = tempfile::tempdir().unwrap();
    let folder = scratch.path();
    let text = add(folder, "aliked-lightglue", "aliked-lightglue.onnx");
    assert!(text.contains("its test needs `aliked`"), "{text}");
    let text = add(folder, "aliked", "aliked.onnx");
    assert!(text.contains("test passed: "), "{text}");
    let text = done(folder, &["models", "test", "aliked-lightglue"]);
    assert!(text.contains("test passed: "), "{text}");
    let text = add(folder, "sift-lightglue", "sift-lightglue.onnx");
    assert!(text.contains("test passed: "), "{text}");
    let photos = Photos::new(5);
    let project = photos.project("project", &[]);
    for (options, methods) in [
        (&["--features", "aliked"][..], "aliked + aliked-lightglue"),
        (
            &["--features", "aliked", "--matcher", "nearest"],
            "aliked + nearest",
        ),
        (&["--matcher", "sift-lightglue"], "sift + sift-lightglue"),
        // Nearest neighbours place all frames, so the network is not tried.
        (&[], "sift + nearest"),
    ] {
        let text = cameras(folder, &project, options);
        assert!(
            text.contains(&format!("cameras: 5 of 5 frames by {methods}, ")),
            "{options:?}: {text}"
        );
        assert!(!text.contains("matched again"), "{text}");
    }
    let other = [
        "reconstruct",
        &project,
        "--method",
        "sfm",
        "--features",
        "aliked",
        "--matcher",
        "sift-lightglue",
    ];
    let text = refused(folder, &other);
    assert!(
        text.contains("'sift-lightglue' matches features of sift"),
        "{text}"
    );
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn left_out_frames_are_matched_again_by_a_network() {
    let scratch = tempfile::tempdir().unwrap();
    let folder = scratch.path();
    let photos = Photos::new(5);
    // A frame of another scene.
    let value = |x: u32, y: u32| {
        let mixed = (x / 5).wrapping_mul(0x9E37_79B1) ^ (y / 5).wrapping_mul(0x85EB_CA77);
        Luma([(mixed.wrapping_mul(0x2C1B_3C6D) >> 24) as u8])
    };
    let other = GrayImage::from_fn(WIDTH, HEIGHT, value);
    other.save(photos.path("color/9.png")).unwrap();
    let project = photos.project("project", &[]);
    let text = cameras(folder, &project, &[]);
    assert!(
        text.contains("nearest neighbours left out 1 of 6 frames; the network sift-lightglue")
            && text.contains("'ostra models install sift-lightglue'"),
        "{text}"
    );
    let text = cameras(folder, &project, &["--matcher", "nearest"]);
    assert!(!text.contains("sift-lightglue"), "{text}");
    add(folder, "sift-lightglue", "sift-lightglue.onnx");
    let text = cameras(folder, &project, &[]);
    assert!(
        text.contains("cameras: 5 of 6 frames by sift + nearest, ")
            && text.contains(
                "matched again by sift-lightglue, because nearest neighbours left out 1 of 6 frames"
            )
            && text.contains("the first cameras stay"),
        "{text}"
    );
    // One with wrong answers is not used, and installing it again is no advice.
    let text = add(folder, "sift-lightglue", "sift-lightglue-wrong.onnx");
    assert!(text.contains("failed its test"), "{text}");
    let text = cameras(folder, &project, &[]);
    assert!(!text.contains("sift-lightglue"), "{text}");
    let args = ["reconstruct", &project, "--matcher", "sift-lightglue"];
    let text = refused(folder, &args);
    assert!(
        text.contains("sift-lightglue is installed, but failed its test"),
        "{text}"
    );
}

#[test]
#[ignore = "needs python3: add --include-ignored"]
fn published_files_are_written_into_the_catalogue() {
    let scratch = tempfile::tempdir().unwrap();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let catalogue = scratch.path().join("models.toml");
    let before = std::fs::read_to_string(root.join("assets/models.toml")).unwrap();
    std::fs::write(&catalogue, &before).unwrap();
    let write = |entry: &str, release: &str| {
        let output = std::process::Command::new("python3")
            .arg(root.join("assets/export/catalogue.py"))
            .args([entry, scratch.path().to_str().unwrap()])
            .args(["--release", release, "--catalogue"])
            .arg(&catalogue)
            .output()
            .unwrap();
        (
            output.status.success(),
            String::from_utf8_lossy(&output.stderr).into_owned(),
        )
    };
    let release = "https://example.org/releases/download/models-1";
    let (is_written, error) = write("xmem", release);
    assert!(
        !is_written && error.contains("xmem-key-encoder.onnx"),
        "{error}"
    );
    let parts = ["key-encoder", "value-encoder", "decoder"];
    for name in parts.map(|part| format!("xmem-{part}.onnx")) {
        std::fs::write(scratch.path().join(name), "abc").unwrap();
    }
    for part in ["encoder", "decoder"] {
        let name = format!("mobile-sam-{part}.onnx");
        std::fs::write(scratch.path().join(name), "abc").unwrap();
    }
    for release in ["https://example.org/old/", release] {
        for entry in ["xmem", "mobile-sam"] {
            let (is_written, error) = write(entry, release);
            assert!(is_written, "{error}");
        }
    }
    let after = std::fs::read_to_string(&catalogue).unwrap();
    assert_eq!(after.lines().count(), before.lines().count() + 5 * 3);
    let parsed = Catalogue::parse(&after).unwrap();
    let known = Catalogue::parse(&before).unwrap();
    for name in ["xmem", "mobile-sam"] {
        let variant = parsed.entry(name).unwrap().variants().last().unwrap();
        for file in &variant.files {
            assert_eq!(file.bytes, Some(3));
            assert_eq!(file.addresses[0].url, format!("{release}/{}", file.name));
            let digest = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
            assert_eq!(file.sha256.as_deref(), Some(digest));
        }
        let kept = |catalogue: &Catalogue| {
            let variants = catalogue.entry(name).unwrap().variants().to_vec();
            variants[..variants.len() - 1].to_vec()
        };
        assert_eq!(kept(&parsed), kept(&known), "other variants stay");
    }
}
