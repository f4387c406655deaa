//! Tests of `ostra bench`, and of the times and memory that commands report for it.

use std::path::Path;
use std::process::{Command, Output};

use ostra_core::job::Progress;
use ostra_eval::synthetic::{Scene, SceneOptions};
use serde_json::Value;
use tempfile::TempDir;

use super::scale::Photos;
use crate::program::{contents, done, ostra};

/// Runs `ostra bench` with its temporary files in `folder/tmp`, and the programs in `folder/bin`.
fn bench(folder: &Path, args: &[&str]) -> Output {
    for name in ["tmp", "bin"] {
        std::fs::create_dir_all(folder.join(name)).unwrap();
    }
    let output = Command::new(env!("CARGO_BIN_EXE_ostra"))
        .arg("bench")
        .args(args)
        .env("TMPDIR", folder.join("tmp"))
        .env("TMP", folder.join("tmp"))
        .env("PATH", folder.join("bin"))
        .env_remove("OSTRA_DATA")
        .output()
        .unwrap();
    assert!(
        contents(&folder.join("tmp")).is_empty(),
        "temporary files are left"
    );
    output
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// Checks the exit code and returns the line of the error.
fn refused(output: &Output) -> String {
    let text = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{text}");
    let errors: Vec<&str> = text
        .lines()
        .filter(|line| line.starts_with("ostra: "))
        .collect();
    assert_eq!(errors.len(), 1, "{text}");
    errors[0].to_owned()
}

fn number(value: &Value) -> f64 {
    value
        .as_f64()
        .unwrap_or_else(|| panic!("{value} is no number"))
}

/// Returns the titles of the steps, after checking that they took some time and no more than `total`.
fn step_titles(steps: &Value, total: f64) -> Vec<String> {
    let steps = steps.as_array().unwrap();
    let seconds: Vec<f64> = steps.iter().map(|step| number(&step["seconds"])).collect();
    assert!(seconds.iter().all(|&seconds| seconds > 0.0), "{steps:?}");
    assert!(seconds.iter().sum::<f64>() <= total, "{steps:?} in {total}");
    let title = |step: &Value| step["step"].as_str().unwrap().to_owned();
    steps.iter().map(title).collect()
}

const CAMERA_STEPS: [&str; 3] = ["Find features", "Match images", "Compute cameras"];

#[test]
fn rendered_images_are_measured_and_scored_without_pycolmap() {
    let dir = TempDir::new().unwrap();
    let args = ["--synthetic", "8", "--beside", "pycolmap", "--json"];
    let output = bench(dir.path(), &args);
    let errors = text(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let report: Value = serde_json::from_str(&text(&output.stdout)).unwrap();
    assert_eq!(report["version"], env!("CARGO_PKG_VERSION"));
    assert!(number(&report["machine"]["cores"]) >= 1.0);
    assert_eq!(report["not_found"].as_array().unwrap().len(), 0);
    // There is no Python in the folders of the PATH.
    let not_run = report["not_run"][0].as_str().unwrap();
    assert!(not_run.contains("pip install pycolmap"), "{not_run}");
    assert!(errors.contains("warning: ") && errors.contains("pip install pycolmap"));
    let [set] = &report["sets"].as_array().unwrap()[..] else {
        panic!("{report}")
    };
    assert_eq!(set["name"], "synthetic-8");
    let [run] = &set["runs"].as_array().unwrap()[..] else {
        panic!("{set}")
    };
    assert_eq!(run["program"], "ostra");
    assert!(run["failure"].is_null(), "{run}");
    assert_eq!((&set["images"], &run["placed"]), (&8.into(), &8.into()));
    let seconds = number(&run["seconds"]);
    assert!(seconds > 0.0 && number(&run["rounds"][0]) == seconds);
    assert!((number(&run["seconds_per_image"]) - seconds / 8.0).abs() < 1e-9);
    assert_eq!(step_titles(&run["steps"], seconds), CAMERA_STEPS);
    let (centre, rotation) = (number(&run["centre_percent"]), number(&run["rotation_deg"]));
    assert!(centre > 0.0 && centre < 0.5, "{centre} %");
    assert!(rotation > 0.0 && rotation < 1.0, "{rotation}°");
    if cfg!(target_os = "linux") {
        let peak = number(&run["peak_memory_bytes"]);
        assert!(peak > 10e6 && peak < 4e9, "{peak} bytes");
    }
}

#[test]
fn cameras_of_two_rendered_cameras_are_found_together() {
    let dir = TempDir::new().unwrap();
    let output = bench(dir.path(), &["--two-cameras", "10", "--json"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let report: Value = serde_json::from_str(&text(&output.stdout)).unwrap();
    let set = &report["sets"][0];
    assert_eq!(set["name"], "two-cameras-10");
    assert_eq!(set["runs"][0]["placed"], 10);
    let centre = number(&set["runs"][0]["centre_percent"]);
    assert!(centre > 0.0 && centre < 0.5, "{centre} %");
}

/// Writes a rendering as the images of a standard set.
fn write_set(data: &Path, folder: &str, views: usize) {
    let scene = Scene::build(&SceneOptions {
        views,
        width: 640,
        height: 480,
        arc_deg: 38.4,
        ..SceneOptions::default()
    });
    let set = data.join(folder);
    let scene = scene.unwrap();
    scene.write_photos(&set, &Progress::default()).unwrap();
    std::fs::rename(set.join("color"), set.join("images")).unwrap();
}

#[test]
fn failing_set_does_not_stop_the_others_and_missing_ones_are_listed() {
    let dir = TempDir::new().unwrap();
    let data = dir.path().join("data");
    write_set(&data, "sceaux_castle", 5);
    // Images of one colour have no features.
    let blank = data.join("banana/images");
    std::fs::create_dir_all(&blank).unwrap();
    for name in ["0.png", "1.png"] {
        image::RgbImage::from_pixel(64, 48, image::Rgb([90; 3]))
            .save(blank.join(name))
            .unwrap();
    }
    let data = data.to_str().unwrap();
    let output = bench(dir.path(), &["--data", data, "--sets", "banana,castle,dtu"]);
    assert!(refused(&output).contains("1 of 2 runs failed (banana)"));
    let table = text(&output.stdout);
    let row = |start: &str| -> Vec<String> {
        let line = table.lines().find(|line| line.starts_with(start));
        let line = line.unwrap_or_else(|| panic!("no {start}: {table}"));
        line.split_whitespace().map(str::to_owned).collect()
    };
    assert_eq!(row("banana  ")[1..], ["ostra", "2", "failed"]);
    assert_eq!(row("castle  ")[1..4], ["ostra", "5", "5"]);
    // The castle has no ground truth.
    assert_eq!(row("castle  ")[4..8], ["not", "known", "not", "known"]);
    assert!(row("banana, ostra: ").join(" ").contains("features"));
    assert_eq!(row("not found: "), ["not", "found:", "dtu"]);
    assert!(row("OSTRA ")[1] == env!("CARGO_PKG_VERSION"));
}

#[test]
fn without_data_the_error_says_what_to_give() {
    let dir = TempDir::new().unwrap();
    let error = refused(&bench(dir.path(), &[]));
    assert!(
        error.contains("--data") && error.contains("--synthetic"),
        "{error}"
    );
    let missing = dir.path().join("missing");
    let missing = missing.to_str().unwrap();
    let error = refused(&bench(dir.path(), &["--data", missing]));
    assert!(
        error.contains(missing) && error.contains("--data"),
        "{error}"
    );
    let empty = dir.path().join("bin");
    let args = ["--data", empty.to_str().unwrap(), "--sets", "fountain,dtu"];
    let error = refused(&bench(dir.path(), &args));
    assert!(
        error.contains("strecha_fountain_P11 and dtu_scan24"),
        "{error}"
    );
    let output = bench(dir.path(), &["--sets", "moon"]);
    assert_eq!(output.status.code(), Some(2));
    let error = text(&output.stderr);
    assert!(
        error.contains("moon") && error.contains("kitchen-rgbd"),
        "{error}"
    );
    let output = bench(dir.path(), &["--synthetic", "4", "--beside", "colmap"]);
    assert_eq!(output.status.code(), Some(2));
}

/// A `python3` that answers as the scripts do, with the true cameras.
#[cfg(unix)]
const PYTHON: &str = r#"#!/bin/sh
export PATH=/usr/bin:/bin
case "$2" in
"import pycolmap"* | "import open3d"*) echo 9.9.9 ;;
*)
    value() { printf '%s' "$1" | sed "s/.*\"$2\":\"\([^\"]*\)\".*/\1/"; }
    images=$(value "$3" images)
    work=$(value "$3" work)
    cp -r "$images/../sparse" "$work/cameras"
    printf '%s\n' "$3" >> "$(dirname "$0")/requests"
    echo '{"steps": [{"step": "Match images", "seconds": 0.25}], "placed": 4, "peak_memory_bytes": null}'
    ;;
esac
"#;

/// Puts [`PYTHON`] among the programs of [`bench`].
#[cfg(unix)]
fn answer_as_python(folder: &Path) {
    use std::os::unix::fs::PermissionsExt;

    let python = folder.join("bin/python3");
    std::fs::create_dir_all(python.parent().unwrap()).unwrap();
    std::fs::write(&python, PYTHON).unwrap();
    std::fs::set_permissions(&python, std::fs::Permissions::from_mode(0o755)).unwrap();
}

#[cfg(unix)]
#[test]
fn programs_take_turns_and_get_the_same_images_and_intrinsics() {
    let dir = TempDir::new().unwrap();
    answer_as_python(dir.path());
    let args = ["--synthetic", "4", "--beside", "pycolmap", "--rounds", "2"];
    let output = bench(dir.path(), &[&args[..], &["--json"]].concat());
    let errors = text(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let rounds: Vec<&str> = errors
        .lines()
        .filter_map(|line| line.strip_prefix("synthetic-4: ")?.split_once(", round"))
        .map(|(program, _)| program)
        .collect();
    assert_eq!(rounds, ["ostra", "pycolmap", "ostra", "pycolmap"]);
    let report: Value = serde_json::from_str(&text(&output.stdout)).unwrap();
    let runs = &report["sets"][0]["runs"];
    assert_eq!(runs[0]["rounds"].as_array().unwrap().len(), 2);
    let other = &runs[1];
    assert_eq!(
        (&other["program"], &other["version"]),
        (&"pycolmap".into(), &"9.9.9".into())
    );
    assert_eq!(other["placed"], 4);
    assert_eq!(step_titles(&other["steps"], 1.0), ["Match images"]);
    assert!(number(&other["centre_percent"]) < 1e-3, "{other}");
    assert!(other["peak_memory_bytes"].is_null());
    let requests = std::fs::read_to_string(dir.path().join("bin/requests")).unwrap();
    assert_eq!(requests.lines().count(), 2);
    let request: Value = serde_json::from_str(requests.lines().next().unwrap()).unwrap();
    assert_eq!(request["names"].as_array().unwrap().len(), 4);
    assert_eq!(request["names"][0], "000.png");
    assert_eq!(request["camera"][2], 320.0);
    assert_eq!(request["sequential"], true);
}

#[cfg(unix)]
#[test]
fn open3d_takes_recordings_and_pycolmap_photos() {
    let dir = TempDir::new().unwrap();
    answer_as_python(dir.path());
    let data = dir.path().join("data");
    write_set(&data, "sceaux_castle", 5);
    let scene = Scene::build(&SceneOptions {
        views: 5,
        width: 160,
        height: 120,
        arc_deg: 38.4,
        ..SceneOptions::default()
    });
    let recording = data.join("redkitchen_rgbd_a");
    let scene = scene.unwrap();
    scene.write(&recording, &Progress::default()).unwrap();
    let args = ["--data", data.to_str().unwrap(), "--json"];
    let with_others = ["--beside", "pycolmap,open3d", "--sets"];
    let sets = |sets: &'static str| [&args[..], &with_others, &[sets]].concat();
    let output = bench(dir.path(), &sets("castle,kitchen-rgbd"));
    let errors = text(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let report: Value = serde_json::from_str(&text(&output.stdout)).unwrap();
    let programs = |set: &Value| -> Vec<String> {
        let runs = set["runs"].as_array().unwrap().iter();
        runs.map(|run| run["program"].as_str().unwrap().to_owned())
            .collect()
    };
    assert_eq!(programs(&report["sets"][0]), ["ostra", "pycolmap"]);
    let kitchen = &report["sets"][1];
    assert_eq!(programs(kitchen), ["ostra", "open3d"]);
    assert!(number(&kitchen["runs"][1]["centre_percent"]) < 1e-3);
    let requests = std::fs::read_to_string(dir.path().join("bin/requests")).unwrap();
    let request: Value = serde_json::from_str(requests.lines().next_back().unwrap()).unwrap();
    let depth = recording.join("depth");
    assert_eq!(request["depth"], depth.to_str().unwrap());
    assert_eq!(request["units_per_metre"], 1000.0);
    assert_eq!(request["camera"][2], 80.0);

    // Without a set that a program takes, the report says so.
    let output = bench(dir.path(), &sets("castle"));
    let report: Value = serde_json::from_str(&text(&output.stdout)).unwrap();
    let not_run = report["not_run"].as_array().unwrap();
    assert_eq!(not_run.len(), 1);
    let not_run = not_run[0].as_str().unwrap();
    assert!(
        not_run.contains("open3d") && not_run.contains("no set to run has depth"),
        "{not_run}"
    );
}

#[test]
fn reconstruct_and_info_report_the_time_of_each_step() {
    let photos = Photos::new(4);
    let project = photos.project("project", &[]);
    let args = [
        "reconstruct",
        &project,
        "--method",
        "mvs",
        "--max-side",
        "120",
        "--json",
    ];
    let output = ostra(&args);
    assert!(output.status.success(), "{}", text(&output.stderr));
    // Notices are not on standard output.
    assert!(text(&output.stderr).contains("cameras: 4 of 4 frames"));
    let printed: Value = serde_json::from_str(&text(&output.stdout)).unwrap();
    let results = &printed["results"];
    let cameras = &results["cameras"];
    let titles = step_titles(&cameras["steps"], number(&cameras["seconds"]) + 0.1);
    assert_eq!(titles[..3], CAMERA_STEPS);
    let depths = &results["depths"];
    let titles = step_titles(&depths["steps"], number(&depths["seconds"]) + 0.1);
    assert!(titles.contains(&"Compute depth".to_owned()), "{titles:?}");
    assert!(
        !titles
            .iter()
            .any(|title| CAMERA_STEPS.contains(&title.as_str())),
        "{titles:?}"
    );
    if cfg!(target_os = "linux") {
        assert!(number(&printed["peak_memory_bytes"]) > 1e6);
    }
    let info: Value = serde_json::from_str(&done(&["info", &project, "--json"])).unwrap();
    assert_eq!(info["results"]["cameras"]["steps"], cameras["steps"]);
    assert!(done(&["info", &project]).contains(" s (Find features "));
    let fused: Value = serde_json::from_str(&done(&["fuse", &project, "--json"])).unwrap();
    let cloud = &fused["results"]["cloud"];
    let titles = step_titles(&cloud["steps"], number(&cloud["seconds"]) + 0.1);
    assert!(titles.contains(&"Fuse points".to_owned()), "{titles:?}");
}
