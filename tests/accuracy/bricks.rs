//! Tests on the synthetic scene of bricks.
//!
//! They cover classes, instances and parts from clicks to the report, and instances found on the
//! command line.

use std::path::Path;
use std::process::Command as Process;

use ostra_cloud::instances::InstanceOptions;
use ostra_core::job::Progress;
use ostra_eval::synthetic::{Scene, SceneKind, SceneOptions};
use ostra_project::{FuseRequest, ResultKind};
use ostra_session::{Command, InstancesRequest, Session};
use serde_json::Value;

use crate::program::{done, refused};
use crate::session::perform;

/// Runs the demo of the scene and returns its report.
///
/// Tests without time for large images pass options for small ones.
fn demo(out: &Path, more: &[&str]) -> Value {
    let run = Process::new(env!("CARGO_BIN_EXE_ostra"))
        .args(["demo", "--headless", "--scene", "bricks"])
        .args(more)
        .arg(out)
        .output()
        .unwrap();
    assert!(
        run.status.success(),
        "{}",
        String::from_utf8_lossy(&run.stderr)
    );
    serde_json::from_str(&std::fs::read_to_string(out.join("report.json")).unwrap()).unwrap()
}

fn least(ious: &Value) -> f64 {
    ious.as_object()
        .unwrap()
        .values()
        .map(|iou| iou.as_f64().unwrap())
        .fold(1.0, f64::min)
}

fn labels(project: &str) -> Vec<String> {
    let info: Value = serde_json::from_str(&done(&["info", project, "--json"])).unwrap();
    info["labels"]
        .as_array()
        .unwrap()
        .iter()
        .map(|label| label["name"].as_str().unwrap().to_owned())
        .collect()
}

fn wheels_clicked_as_one_class_become_six_instances() {
    let out = tempfile::tempdir().unwrap();
    let folder = out.path().join("demo");
    let report = demo(&folder, &[]);
    let levels = &report["levels"];
    assert_eq!(levels["instances"]["wheel"], 6, "{levels:#}");
    assert_eq!(levels["class"].as_object().unwrap().len(), 3, "{levels:#}");
    assert_eq!(
        levels["instance"].as_object().unwrap().len(),
        8,
        "{levels:#}"
    );
    assert_eq!(levels["part"].as_object().unwrap().len(), 9, "{levels:#}");
    assert!(least(&levels["class"]) >= 0.95, "{levels:#}");
    assert!(least(&levels["instance"]) >= 0.95, "{levels:#}");
    assert!(least(&levels["part"]) >= 0.90, "{levels:#}");
    let clicks = report["clicks"].as_object().unwrap();
    let most = |name: &str| if name == "wheel" { 6 * 8 } else { 8 };
    assert!(
        clicks.contains_key("wheel")
            && clicks
                .iter()
                .all(|(name, count)| count.as_u64().unwrap() <= most(name)),
        "{clicks:?}"
    );
}

fn sensor_noise_changes_depth_but_not_ground_truth() {
    let out = tempfile::tempdir().unwrap();
    let (exact, noisy) = (out.path().join("exact"), out.path().join("noisy"));
    demo(&noisy, &["--frames", "8", "--size", "240x180", "--noise"]);
    let options = SceneOptions {
        scene: SceneKind::Bricks,
        views: 8,
        width: 240,
        height: 180,
        ..SceneOptions::default()
    };
    Scene::build(&options)
        .unwrap()
        .write(&exact, &Progress::default())
        .unwrap();
    let read = |file: std::path::PathBuf| std::fs::read(file).unwrap();
    assert!(read(exact.join("depth/000.png")) != read(noisy.join("recording/depth/000.png")));
    assert!(read(exact.join("truth/masks/000.png")) == read(noisy.join("truth/masks/000.png")));
}

fn instances_are_found_again_by_the_command_line() {
    let out = tempfile::tempdir().unwrap();
    let folder = out.path().join("demo");
    demo(&folder, &["--frames", "8", "--size", "240x180"]);
    let project = folder.join("project").to_string_lossy().into_owned();
    assert!(refused(&["instances", &project, "--label", "nobody"]).contains("nobody"));
    assert!(
        refused(&["instances", &project, "--label", "wheel"]).contains("wheel"),
        "all have their instance already"
    );
    assert!(
        refused(&[
            "instances",
            &project,
            "--label",
            "car 1 cabin",
            "--radius",
            "0"
        ])
        .contains("radius")
    );
    one_undo_takes_instances_back(Path::new(&project));
    let output = done(&[
        "instances",
        &project,
        "--label",
        "car 1 cabin",
        "--min-points",
        "20",
    ]);
    assert!(output.starts_with("car 1 cabin 1 "), "{output}");
    assert!(labels(&project).contains(&"car 1 cabin 1".to_owned()));
}

fn one_undo_takes_instances_back(root: &Path) {
    let mut session = Session::new();
    perform(&mut session, Command::Open(root.into())).unwrap();
    // With all points kept, the masks can vote again.
    perform(&mut session, Command::Fuse(FuseRequest::default())).unwrap();
    let before = session.project().unwrap().clone();
    let label = before.labels.by_name("figure 1 legs").unwrap().id;
    let options = InstanceOptions {
        min_points: 20,
        ..InstanceOptions::default()
    };
    perform(
        &mut session,
        Command::Instances(InstancesRequest { label, options }),
    )
    .unwrap();
    let after = session.project().unwrap().clone();
    let made: Vec<_> = after
        .labels
        .children(Some(label))
        .map(|label| label.id)
        .collect();
    assert_eq!(made.len(), 1, "legs hang together");
    let shows = |id| {
        after
            .masks
            .values()
            .filter(|mask| mask.runs.extents().contains_key(&id))
            .count()
    };
    assert!(
        shows(made[0]) > 4 && shows(label) == 0,
        "{} {}",
        shows(made[0]),
        shows(label)
    );
    let cloud = session.cloud().unwrap();
    assert!(cloud.labels.contains(&made[0]) && !cloud.labels.contains(&label));
    assert!(
        !after.results[&ResultKind::Cloud].stale,
        "the cloud was voted on again"
    );
    perform(&mut session, Command::Undo).unwrap();
    assert!(
        **session.project().unwrap() == *before,
        "masks, labels and cloud are as they were"
    );
}

crate::registry::tests! {
    Nothing => wheels_clicked_as_one_class_become_six_instances, sensor_noise_changes_depth_but_not_ground_truth, instances_are_found_again_by_the_command_line;
}
