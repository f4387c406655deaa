//! Tests of `ostra models`: networks are tested after they were installed, and used where they answer rightly.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Small networks with the interfaces of public files (`tests/parity/public.py`).
pub(super) fn public(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/parity/public");
    folder.join(name)
}

/// Runs the program with its data in `folder/data`, in this folder.
pub(super) fn ostra(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_ostra"))
        .args(args)
        .current_dir(folder)
        .env("XDG_DATA_HOME", folder.join("data"))
        .env("HOME", folder)
        .env_remove("OSTRA_NETWORKS")
        .output()
        .unwrap()
}

/// Runs a command that must succeed and returns what it prints.
pub(super) fn done(folder: &Path, args: &[&str]) -> String {
    let output = ostra(folder, args);
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{args:?}: {error}");
    String::from_utf8(output.stdout).unwrap()
}

/// Runs a command that must fail with one line and returns it.
pub(super) fn refused(folder: &Path, args: &[&str]) -> String {
    let output = ostra(folder, args);
    let text = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{args:?}: {text}");
    let mut errors = text.lines().filter(|line| line.starts_with("ostra: "));
    let line = errors.next().unwrap().to_owned();
    assert_eq!(errors.next(), None, "{text}");
    line
}

/// Creates a project of one frame with a red rectangle on grey.
fn project(folder: &Path) {
    let frames = folder.join("frames");
    std::fs::create_dir_all(&frames).unwrap();
    let colour = |x: u32, y: u32| {
        let is_red = (60..160).contains(&x) && (40..140).contains(&y);
        image::Rgb(if is_red { [220, 40, 30] } else { [120; 3] })
    };
    image::RgbImage::from_fn(300, 200, colour)
        .save(frames.join("0.png"))
        .unwrap();
    done(folder, &["new", "p", "--frames", "frames"]);
    done(folder, &["label", "p", "red"]);
}

fn add_mobile_sam(folder: &Path, decoder: &str) -> Output {
    let (encoder, decoder) = (public("encoder-hwc.onnx"), public(decoder));
    let files = [encoder.to_str().unwrap(), decoder.to_str().unwrap()];
    ostra(folder, &["models", "add", "mobile-sam", files[0], files[1]])
}

const CLICK: [&str; 8] = [
    "prompt", "p", "--frame", "0", "--label", "red", "--click", "100,80",
];

/// Returns whether Segment Anything has embedded an image.
fn has_embeddings(folder: &Path) -> bool {
    let embeddings = folder.join("data/ostra/embeddings");
    std::fs::read_dir(embeddings).is_ok_and(|mut files| files.next().is_some())
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn installed_network_is_tested_and_answers_clicks() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    project(folder);
    let output = add_mobile_sam(folder, "decoder-multi.onnx");
    let text = String::from_utf8_lossy(&output.stdout);
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{error}");
    assert!(
        text.contains("test passed: IoU of a click 0.9"),
        "{text} {error}"
    );
    for command in ["test", "check"] {
        let text = done(folder, &["models", command, "mobile-sam"]);
        assert!(text.contains("test passed"), "{text}");
    }
    let json = done(folder, &["models", "list", "--json"]);
    let rows: serde_json::Value = serde_json::from_str(&json).unwrap();
    let rows = rows.as_array().unwrap();
    let row = rows.iter().find(|row| row["name"] == "mobile-sam").unwrap();
    assert_eq!(row["tested"], "passed");
    assert_eq!(row["installed_variant"], "full");
    assert!(!has_embeddings(folder));
    done(folder, &CLICK);
    assert!(has_embeddings(folder), "`auto` takes the network");
    let text = done(folder, &["models", "remove", "mobile-sam"]);
    assert_eq!(text.matches(": removed").count(), 2, "{text}");
    let text = refused(folder, &["models", "remove", "mobile-sam"]);
    assert!(text.contains("`mobile-sam` is not installed"), "{text}");
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn network_with_wrong_answers_is_not_used() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    project(folder);
    let output = add_mobile_sam(folder, "decoder-wrong.onnx");
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{text}");
    let errors: Vec<&str> = text
        .lines()
        .filter(|line| line.starts_with("ostra: "))
        .collect();
    assert!(
        errors.len() == 1
            && errors[0].contains("failed its test")
            && errors[0].contains("ostra models remove mobile-sam"),
        "{text}"
    );
    let list = done(folder, &["models", "list"]);
    assert!(list.contains("not used, its test failed"), "{list}");
    done(folder, &CLICK);
    assert!(!has_embeddings(folder), "`auto` takes another segmenter");
    let text = refused(folder, &[&CLICK[..], &["--segmenter", "sam"]].concat());
    assert!(
        text.contains("mobile-sam is installed, but failed its test"),
        "{text}"
    );
    // Other files replace those that failed.
    let output = add_mobile_sam(folder, "decoder-single.onnx");
    assert!(output.status.success());
    done(folder, &[&CLICK[..], &["--segmenter", "sam"]].concat());
    assert!(has_embeddings(folder));
}

#[test]
#[ignore = "needs networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
fn real_networks_pass_their_tests() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let networks = std::env::var_os("OSTRA_MODELS").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/models"),
        PathBuf::from,
    );
    for (name, file, passed) in [
        ("lighterglue", "lighterglue.onnx", false),
        ("xfeat", "xfeat.onnx", true),
        ("yolox", "yolox_nano.onnx", true),
    ] {
        let path = networks.join(file);
        let text = done(folder, &["models", "add", name, path.to_str().unwrap()]);
        let expected = if passed {
            "test passed"
        } else {
            "not tested: its test needs `xfeat`"
        };
        assert!(text.contains(expected), "{name}: {text}");
    }
    let text = done(folder, &["models", "test", "lighterglue"]);
    assert!(text.contains("test passed"), "{text}");
    let text = done(folder, &["models", "list"]);
    assert_eq!(text.matches("test passed").count(), 3, "{text}");
}

#[test]
fn addresses_are_listed_with_size_and_digest() {
    let folder = tempfile::tempdir().unwrap();
    let text = done(folder.path(), &["models", "addresses", "mobile-sam"]);
    let encoder = "mobile_sam_image_encoder.onnx";
    let digest = "580f5fb648ea1062c0aabc26217aed56921985f03f0cbbd852bba81d760cc749";
    assert!(
        text.contains(encoder) && text.contains(digest) && text.contains("28157093 bytes"),
        "{text}"
    );
    let json = done(folder.path(), &["models", "addresses", "--json"]);
    let all: serde_json::Value = serde_json::from_str(&json).unwrap();
    let names: Vec<&str> = all
        .as_array()
        .unwrap()
        .iter()
        .filter_map(|file| file["network"].as_str())
        .collect();
    for name in ["sam-vit-b", "sam2.1-large", "grounding-dino", "lighterglue"] {
        assert!(names.contains(&name), "{names:?}");
    }
    let text = refused(folder.path(), &["models", "addresses", "xmem"]);
    assert!(text.contains("assets/export/xmem.py"), "{text}");
}

#[test]
fn every_network_is_listed_with_its_origin() {
    let folder = tempfile::tempdir().unwrap();
    let text = done(folder.path(), &["models", "list"]);
    let json = done(folder.path(), &["models", "list", "--json"]);
    let rows: serde_json::Value = serde_json::from_str(&json).unwrap();
    for row in rows.as_array().unwrap() {
        let name = row["name"].as_str().unwrap();
        let start = format!("{name} ");
        let line = text.lines().find(|line| line.starts_with(&start)).unwrap();
        match row["server"].as_str() {
            Some(server) => assert!(line.ends_with(&format!(" from {server}")), "{line}"),
            // The official checkpoint, and the script that makes the files of it.
            None => assert!(
                line.contains("from files only: https://") && line.contains("assets/export/"),
                "{line}"
            ),
        }
    }
    assert!(text.contains("MB from huggingface.co"), "{text}");
    let text = refused(folder.path(), &["models", "install", "xfeat"]);
    assert!(text.contains("assets/export/xfeat.py"), "{text}");
}

#[test]
fn missing_files_of_a_folder_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let args = ["models", "install", "efficient-sam", "--from", "."];
    let text = refused(folder.path(), &args);
    assert!(
        text.contains("efficient_sam_vitt_encoder.onnx") && text.contains("models addresses"),
        "{text}"
    );
    let args = ["models", "install", "sam-vit-b", "--variant", "int4"];
    let text = refused(folder.path(), &args);
    assert!(
        text.contains("no variant `int4`") && text.contains("full, int8"),
        "{text}"
    );
}
