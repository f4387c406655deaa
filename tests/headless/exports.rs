//! Tests of exported clouds and measurements, through the command line.

use std::collections::BTreeSet;
use std::ops::ControlFlow;
use std::path::Path;
use std::process::Command as Process;
use std::sync::Arc;

use ostra_cloud::measure::LengthUnit;
use ostra_project::FuseRequest;
use ostra_session::{Command, MeasureSettings, Session};

use super::recording::Recording;
use crate::program::{done, refused};

/// Returns a recording and its fused project.
///
/// A red square, 1 m away, is labelled `thing` below `object`.
fn fused() -> (Recording, String) {
    let recording = Recording::new();
    let project = recording.project();
    done(&["label", &project, "object"]);
    done(&["label", &project, "thing", "--parent", "object"]);
    done(&["label", &project, "nothing"]);
    done(&[
        "prompt", &project, "--frame", "1", "--label", "thing", "--click", "20,24",
    ]);
    done(&["track", &project, "--tracker", "geometry"]);
    done(&["fuse", &project, "--voxel", "0.01"]);
    (recording, project)
}

/// Returns the deepest label and the class of every point.
fn las_labels(path: &str) -> Vec<(u16, u8)> {
    let points = las::Reader::from_path(path).unwrap().read_all().unwrap();
    let label =
        |point: &las::Point| u16::from_le_bytes([point.extra_bytes[0], point.extra_bytes[1]]);
    points
        .points()
        .map(Result::unwrap)
        .map(|point| (label(&point), u8::from(point.classification)))
        .collect()
}

#[test]
fn clouds_are_written_in_every_format() {
    let (recording, project) = fused();
    let [las, laz, pcd, ply] =
        ["c.las", "c.laz", "c.pcd", "c.ply"].map(|name| recording.path(&format!("out/{name}")));
    done(&["export", &project, "--cloud", &las, "--twin", "--per-label"]);
    for other in [&laz, &pcd, &ply] {
        done(&["export", &project, "--cloud", other]);
    }
    let labels = las_labels(&las);
    assert!(labels.len() > 500);
    assert_eq!(
        labels.iter().copied().collect::<BTreeSet<_>>(),
        BTreeSet::from([(0, 0), (2, 64)])
    );
    assert_eq!(las_labels(&laz), labels);
    let of_thing = labels.iter().filter(|(label, _)| *label == 2).count();
    assert_eq!(
        las_labels(&recording.path("out/c_thing.las")).len(),
        of_thing
    );
    assert_eq!(
        las_labels(&recording.path("out/c_labels.las")).len(),
        labels.len()
    );
    let head = String::from_utf8_lossy(&std::fs::read(&pcd).unwrap()).into_owned();
    assert!(head.contains(&format!("\nPOINTS {}\n", labels.len())));
    let classes = std::fs::read_to_string(recording.path("out/c.classes.json")).unwrap();
    let classes: serde_json::Value = serde_json::from_str(&classes).unwrap();
    assert_eq!(
        (&classes[1]["name"], &classes[1]["las_class"]),
        (&"thing".into(), &64.into())
    );

    done(&["export", &project, "--cloud", &las, "--level", "1"]);
    assert!(las_labels(&las).contains(&(1, 64)), "read at the top level");
}

#[test]
fn files_without_a_folder_are_written_to_the_current_folder() {
    let (recording, project) = fused();
    let here = recording.path("here");
    std::fs::create_dir(&here).unwrap();
    let files = [
        "--cloud", "c.ply", "--mesh", "m.glb", "--voxels", "v.npz", "--traits", "t.csv", "--masks",
        "masks",
    ];
    let more = [
        "--cameras",
        "sparse",
        "--undistorted",
        "flat",
        "--depths",
        "depths",
    ];
    let mut run = Process::new(env!("CARGO_BIN_EXE_ostra"));
    let output = run
        .current_dir(&here)
        .args(["export", &project])
        .args(files)
        .args(more)
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let there = |name: &&str| Path::new(&here).join(name).exists();
    let names = files.iter().chain(&more).skip(1).step_by(2);
    assert!(
        names.clone().all(there),
        "{:?}",
        names.filter(|name| !there(name)).collect::<Vec<_>>()
    );
}

#[test]
fn failed_export_gives_one_error_line_and_leaves_no_file() {
    let (recording, project) = fused();
    let wrong = recording.path("out/c.xyz");
    assert!(refused(&["export", &project, "--cloud", &wrong]).contains(".ply, .las, .laz or .pcd"));
    let file = recording.path("file");
    std::fs::write(&file, "").unwrap();
    let below = format!("{file}/c.las");
    assert!(refused(&["export", &project, "--cloud", &below]).contains("file"));
    let traits = recording.path("t.csv");
    let wrong = refused(&["export", &project, "--traits", &traits, "--ground", "table"]);
    assert!(wrong.contains("no label 'table'"), "{wrong}");
    let wrong = refused(&[
        "export", &project, "--traits", &traits, "--ground", "nothing",
    ]);
    assert!(wrong.contains("'nothing' has no points"), "{wrong}");
    assert!(!Path::new(&traits).exists() && !Path::new(&recording.path("out")).exists());
}

#[test]
fn measurements_have_the_requested_unit_and_point_count() {
    let (recording, project) = fused();
    let csv = |arguments: &[&str]| {
        let path = recording.path("traits.csv");
        done(&[&["export", &project, "--traits", &path], arguments].concat());
        std::fs::read_to_string(path).unwrap()
    };
    let found = |csv: &str, name: &str| {
        let row = csv
            .lines()
            .find(|line| line.starts_with(&format!("thing,object › thing,0,{name},")))
            .unwrap();
        let cells: Vec<&str> = row.split(',').collect();
        (
            cells[4].parse::<f64>().unwrap(),
            cells[5].to_owned(),
            cells[cells.len() - 1].parse::<usize>().unwrap(),
        )
    };
    // The square has 16 × 20 pixels of 1/60 m; the plane z = 2 lies behind it.
    let plain = csv(&[]);
    assert!(plain.starts_with("label,path,instance,trait,value,unit,definition,points\n"));
    let (area, unit, points) = found(&plain, "area");
    assert!(
        (area / (16.0 * 20.0 / 3600.0) - 1.0).abs() < 0.15 && unit == "m^2" && points > 100,
        "{area} {unit}"
    );
    let (width, _, _) = found(&plain, "box_x");
    assert!((width - 16.0 / 60.0).abs() < 0.03, "{width}");
    let given = csv(&["--ground", "0,0,-1,-2", "--unit", "mm"]);
    let (height, unit, _) = found(&given, "height_max");
    assert!(
        (height - 1000.0).abs() < 15.0 && unit == "mm",
        "{height} {unit}"
    );
    let (fine, unit, _) = found(&given, "area");
    assert!((fine / 1e6 / area - 1.0).abs() < 1e-4 && unit == "mm^2");
}

#[test]
fn measured_cloud_is_freed_after_another_fusion() {
    let (_recording, project) = fused();
    let mut session = Session::new();
    session.act(Command::Open(project.into())).unwrap();
    session.settle(|_| ControlFlow::Continue(()));
    let settings = MeasureSettings::default();
    let pair = ["thing", "nothing"]
        .map(|name| session.project().unwrap().labels.by_name(name).unwrap().id);
    for _ in 0..3 {
        let _ = (session.traits(settings), session.angles([pair]));
        session.settle(|_| ControlFlow::Continue(()));
    }
    assert!(session.traits(settings).is_some());
    assert!(session.angles([pair])[&pair].is_err());
    let former = Arc::downgrade(session.cloud().unwrap());
    session
        .act(Command::Fuse(FuseRequest {
            voxel: Some(0.02),
            ..FuseRequest::default()
        }))
        .unwrap();
    session.settle(|_| ControlFlow::Continue(()));
    assert!(session.cloud().is_some());
    assert!(former.upgrade().is_none(), "it has no owner any more");
}

#[test]
fn unmeasurable_angle_gives_one_error_line() {
    let (recording, project) = fused();
    let csv = recording.path("traits.csv");
    let refused = |pair: [&str; 2]| {
        let reported = refused(&[
            "export", &project, "--traits", &csv, "--angle", pair[0], pair[1],
        ]);
        assert!(!Path::new(&csv).exists(), "{reported}");
        reported
    };
    for (pair, expected) in [
        (
            ["thing", "table"],
            "there is no label 'table' (labels: object, thing, nothing)",
        ),
        (["thing", "thing"], "'thing' was given twice"),
        (["object", "thing"], "'thing' is a part of 'object'"),
        (["thing", "nothing"], "'nothing': it has no points"),
    ] {
        let reported = refused(pair);
        assert!(reported.contains(expected), "{reported}");
    }
    let mut run = Process::new(env!("CARGO_BIN_EXE_ostra"));
    let one = run
        .args(["export", &project, "--traits", &csv, "--angle", "thing"])
        .output()
        .unwrap();
    assert_eq!(one.status.code(), Some(2), "an angle has two labels");
}

#[test]
fn job_measures_the_shown_level() {
    let (_recording, project) = fused();
    let mut session = Session::new();
    session.act(Command::Open(project.into())).unwrap();
    let mut requested = |level| {
        let settings = MeasureSettings {
            level,
            ..MeasureSettings::default()
        };
        let mut answered = 0;
        // The cloud is loaded before it is measured.
        while session.traits(settings).is_none() && answered < 4 {
            session.settle(|_| ControlFlow::Continue(()));
            answered += 1;
        }
        assert_eq!(
            session.length_unit(),
            LengthUnit::Metre,
            "depths tell the scale"
        );
        assert!(answered > 0, "what was measured otherwise is not shown");
        let rows = session.traits(settings).expect("it is measured");
        rows.iter()
            .map(|row| row.label.clone())
            .collect::<BTreeSet<String>>()
            .into_iter()
            .collect::<Vec<_>>()
    };
    assert_eq!(requested(None), ["object", "thing"]);
    assert_eq!(requested(Some(1)), ["object"]);
}
