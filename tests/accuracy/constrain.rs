//! Tests of `track --constrain` as a process: masks tracked by flow and checked against geometry.
//!
//! They run on the synthetic scene and on a real shelf.

use std::path::{Path, PathBuf};
use std::process::Command;

use ostra_core::job::Progress;
use ostra_eval::synthetic::{Scene, SceneOptions};
use ostra_masks::{LabelTree, RunMask, encode_palette_png, read_palette_png};
use serde_json::Value;

use crate::data::data_dir;

/// Runs a command that must succeed; returns its standard output and standard error.
fn done(words: &[&str], folder: &Path) -> (String, String) {
    let out = Command::new(env!("CARGO_BIN_EXE_ostra"))
        .args(words)
        .current_dir(folder)
        .output()
        .unwrap();
    let [output, reported] = [out.stdout, out.stderr].map(|text| String::from_utf8(text).unwrap());
    assert!(out.status.success(), "{words:?}: {reported}");
    (output, reported)
}

/// Creates the folder `anchor` with only the ground-truth mask of one frame.
fn give_keyframe(folder: &Path, truth: &Path, name: &str) {
    std::fs::create_dir(folder.join("anchor")).unwrap();
    std::fs::copy(truth.join(name), folder.join("anchor").join(name)).unwrap();
}

/// Returns the mean J over all frames of the masks tracked by flow, and the tracking report.
fn tracked(folder: &Path, new: &[&str], truth: &Path, constrain: bool) -> (f64, String) {
    let project = if constrain { "held" } else { "free" };
    done(&[&["new", project], new].concat(), folder);
    done(&["masks", project, "import", "anchor"], folder);
    let track = ["track", project, "--tracker", "flow"];
    let (_, reported) = done(
        &if constrain {
            [&track[..], &["--constrain"]].concat()
        } else {
            track.to_vec()
        },
        folder,
    );
    let masks = format!("{project}-masks");
    done(&["masks", project, "export", &masks], folder);
    let eval = [
        "eval",
        "masks",
        "--truth",
        truth.to_str().unwrap(),
        "--result",
        &masks,
        "--json",
    ];
    let score: Value = serde_json::from_str(&done(&eval, folder).0).unwrap();
    (score["j"].as_f64().unwrap(), reported)
}

fn flow_on_a_synthetic_recording_improves_with_geometry() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let options = SceneOptions {
        views: 8,
        width: 300,
        height: 400,
        arc_deg: 40.0,
        ..SceneOptions::default()
    };
    let scene = Scene::build(&options).unwrap();
    scene.write(folder, &Progress::default()).unwrap();
    // The masks keep stems and leaves as separate labels.
    for entry in std::fs::read_dir(folder.join("truth/masks")).unwrap() {
        let path: PathBuf = entry.unwrap().path();
        let mask = RunMask::encode(&read_palette_png(&path).unwrap().at_level(scene.tree(), 3));
        std::fs::write(
            &path,
            encode_palette_png(&mask, &LabelTree::default()).unwrap(),
        )
        .unwrap();
    }
    let truth = folder.join("truth/masks");
    give_keyframe(folder, &truth, "000.png");
    let depth_unit = Scene::DEPTH_UNIT_M.to_string();
    let new = [
        "--frames",
        "color",
        "--depth",
        "depth",
        "--depth-unit",
        &depth_unit,
        "--cameras",
        "sparse",
    ];
    let (free, _) = tracked(folder, &new, &truth, false);
    let (held, reported) = tracked(folder, &new, &truth, true);
    println!("made plant, flow from one true mask: J {free:.3}, constrained {held:.3}\n{reported}");
    assert!(reported.contains("geometry corrected"), "{reported}");
    assert!(held > free + 0.1, "J {free:.3}, constrained {held:.3}");
    let info: Value = serde_json::from_str(&done(&["info", "held", "--json"], folder).0).unwrap();
    assert_eq!(info["frames"][0]["mask"], "anchor");
    assert_eq!(info["frames"][7]["mask"], "tracked");
}

fn flow_on_a_real_shelf_improves_with_geometry() {
    let data = data_dir();
    let set = data.join("apc_shelf_rgbd_labels");
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let truth = set.join("labels");
    let mut names: Vec<_> = std::fs::read_dir(&truth)
        .unwrap()
        .map(|entry| entry.unwrap().file_name())
        .collect();
    names.sort();
    give_keyframe(folder, &truth, names[7].to_str().unwrap());
    let [color, depth, sparse] =
        ["color", "depth", "sparse"].map(|part| set.join(part).to_str().unwrap().to_owned());
    let new = ["--frames", &color, "--depth", &depth, "--cameras", &sparse];
    let (free, _) = tracked(folder, &new, &truth, false);
    let (held, reported) = tracked(folder, &new, &truth, true);
    println!(
        "apc shelf, flow from the true mask of frame 7: J {free:.3}, constrained {held:.3}\n{reported}"
    );
    assert!(held > free, "J {free:.3}, constrained {held:.3}");
}

fn constrain_without_depth_and_cameras_says_what_to_add() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    std::fs::create_dir(folder.join("frames")).unwrap();
    let image = image::RgbImage::from_pixel(40, 30, image::Rgb([90, 120, 60]));
    ["0.png", "1.png"]
        .iter()
        .for_each(|name| image.save(folder.join("frames").join(name)).unwrap());
    done(&["new", "p", "--frames", "frames"], folder);
    done(&["label", "p", "leaf"], folder);
    done(
        &[
            "prompt",
            "p",
            "--frame",
            "0",
            "--label",
            "leaf",
            "--box",
            "5,5,20,20",
        ],
        folder,
    );
    let track = ["track", "p", "--tracker", "flow", "--constrain"];
    let out = Command::new(env!("CARGO_BIN_EXE_ostra"))
        .args(track)
        .current_dir(folder)
        .output()
        .unwrap();
    let reported = String::from_utf8(out.stderr).unwrap();
    assert_eq!(out.status.code(), Some(1), "{reported}");
    assert!(
        reported.contains("--constrain needs frames with depth and cameras"),
        "{reported}"
    );
}

crate::registry::tests! {
    Nothing => flow_on_a_synthetic_recording_improves_with_geometry, constrain_without_depth_and_cameras_says_what_to_add;
    Data(&["apc_shelf_rgbd_labels"]) => flow_on_a_real_shelf_improves_with_geometry;
}
