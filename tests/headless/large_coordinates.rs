//! Tests that projected coordinates keep millimetres.

use std::collections::BTreeSet;

use glam::DVec3;
use ostra_cloud::LabelledCloud;
use ostra_cloud::ply::{read_mesh, read_ply};
use ostra_core::job::Progress;
use serde_json::Value;

use super::recording::Recording;
use crate::program::done;

/// Offset from the voxels' borders, where the last digit would decide the voxel.
const NEAR: DVec3 = DVec3::new(0.00371, 0.00371, 0.00371);
const UTM: DVec3 = DVec3::new(500_000.0, 5_400_000.0, 300.0);
const ECEF: DVec3 = DVec3::new(4_000_100.0, 700_400.0, 4_900_800.0);

/// Returns a recording whose cameras are moved; they are not rotated.
fn moved(by: DVec3) -> Recording {
    let recording = Recording::new();
    let mut images = String::new();
    for k in 0..4_u32 {
        let DVec3 { x, y, z } = -(by + DVec3::new(0.02 * f64::from(k), 0.0, 0.0));
        images += &format!("{} 1 0 0 0 {x} {y} {z} 1 {k}.png\n\n", k + 1);
    }
    std::fs::write(recording.path("sparse/images.txt"), images).unwrap();
    recording
}

fn fused(by: DVec3) -> (Recording, String) {
    let recording = moved(by);
    let project = recording.project();
    label_and_fuse(&project);
    (recording, project)
}

fn label_and_fuse(project: &str) {
    done(&["label", project, "thing"]);
    done(&[
        "prompt", project, "--frame", "1", "--label", "thing", "--click", "20,24",
    ]);
    done(&["track", project, "--tracker", "geometry"]);
    done(&["fuse", project, "--voxel", "0.01"]);
}

fn export(recording: &Recording, project: &str, option: &str, name: &str) -> String {
    let path = recording.path(name);
    done(&["export", project, option, &path]);
    path
}

fn json(path: &str) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn global(cloud: &LabelledCloud) -> impl Iterator<Item = DVec3> {
    cloud
        .positions
        .iter()
        .map(|at| at.as_dvec3() + cloud.origin)
}

/// Checks that both clouds have the same points and labels, to the millimetre.
fn assert_same(near: &LabelledCloud, far: &LabelledCloud, by: DVec3) {
    assert_eq!(near.labels, far.labels);
    assert!(near.labels.iter().filter(|label| label.0 == 1).count() > 500);
    for (near, far) in global(near).zip(global(far)) {
        assert!(far.abs_diff_eq(near + by, 1e-3), "{near} and {far}");
    }
}

#[test]
fn results_in_utm_and_ecef_equal_those_at_the_origin() {
    let progress = Progress::default();
    let (home, near) = fused(NEAR);
    let near_cloud = read_ply(export(&home, &near, "--cloud", "c.ply").as_ref(), &progress)
        .unwrap()
        .cloud;
    let near_mesh = read_mesh(export(&home, &near, "--mesh", "m.ply").as_ref(), &progress)
        .unwrap()
        .vertices;
    assert!(
        !std::fs::exists(home.path("c.ply.origin.json")).unwrap(),
        "small coordinates are left as they are"
    );
    for by in [UTM, ECEF] {
        let (recording, project) = fused(NEAR + by);
        let path = export(&recording, &project, "--cloud", "c.ply");
        let cloud = read_ply(path.as_ref(), &progress).unwrap().cloud;
        assert_same(&near_cloud, &cloud, by);
        let mesh = read_mesh(
            export(&recording, &project, "--mesh", "m.ply").as_ref(),
            &progress,
        )
        .unwrap()
        .vertices;
        assert_same(&near_mesh, &mesh, by);
        let voxels = read_ply(
            export(&recording, &project, "--voxels", "v.ply").as_ref(),
            &progress,
        )
        .unwrap()
        .cloud;
        assert_eq!(voxels.origin, cloud.origin);
        let origin: Vec<f64> =
            serde_json::from_value(json(&format!("{path}.origin.json"))["origin"].clone()).unwrap();
        assert_eq!(origin, cloud.origin.to_array());
        let info: Value = serde_json::from_str(&done(&["info", &project, "--json"])).unwrap();
        assert_eq!(info["origin"], serde_json::json!(origin));

        let las = export(&recording, &project, "--cloud", "c.las");
        let points = las::Reader::from_path(las).unwrap().read_all().unwrap();
        for (point, at) in points.points().map(Result::unwrap).zip(global(&cloud)) {
            assert!(
                DVec3::new(point.x, point.y, point.z).abs_diff_eq(at, 1e-4),
                "{point:?} and {at}"
            );
        }
        let cameras = export(&recording, &project, "--cameras", "out");
        let own = format!("{project}/sparse");
        for result in [cameras, own] {
            let truth = recording.path("sparse");
            let score = done(&[
                "eval", "cameras", "--truth", &truth, "--result", &result, "--json",
            ]);
            let score: Value = serde_json::from_str(&score).unwrap();
            assert!(
                score["error"]["centre"]["max"].as_f64().unwrap() < 1e-6,
                "{score}"
            );
        }
    }
}

#[test]
fn ply_with_double_coordinates_scores_to_the_millimetre() {
    let progress = Progress::default();
    let (recording, project) = fused(UTM);
    let path = export(&recording, &project, "--cloud", "c.ply");
    let cloud = read_ply(path.as_ref(), &progress).unwrap().cloud;
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n", cloud.len());
    text += "property double x\nproperty double y\nproperty double z\nend_header\n";
    for at in global(&cloud) {
        text += &format!("{} {} {}\n", at.x, at.y, at.z);
    }
    let foreign = recording.path("foreign.ply");
    std::fs::write(&foreign, text).unwrap();
    for [truth, result] in [[&foreign, &path], [&path, &foreign]] {
        let score = done(&[
            "eval", "cloud", "--truth", truth, "--result", result, "--within", "0.001", "--json",
        ]);
        assert!(
            score.contains("\"recall\":1.0") || score.contains("\"completeness\":1.0"),
            "{score}"
        );
    }
}

#[test]
fn scale_multiplies_global_coordinates_and_later_frames_fit() {
    let recording = moved(UTM);
    let project = recording.path("project");
    let [color, sparse] = ["color", "sparse"].map(|name| recording.path(name));
    done(&["new", &project, "--frames", &color, "--cameras", &sparse]);
    let centres = |name: &str| -> Vec<DVec3> {
        let text = std::fs::read_to_string(format!(
            "{}/images.txt",
            export(&recording, &project, "--cameras", name)
        ));
        let lines = text.unwrap();
        let of_images = lines.lines().filter(|line| line.ends_with(".png"));
        // The cameras are not rotated.
        let number =
            |line: &str, at: usize| -line.split(' ').nth(at).unwrap().parse::<f64>().unwrap();
        of_images
            .map(|line| DVec3::new(number(line, 5), number(line, 6), number(line, 7)))
            .collect()
    };
    let before = centres("before");
    let seen =
        |frame: u32, from_px: f64| format!("{frame},{},20", from_px - 2.0 * f64::from(frame));
    let (near, far) = (
        [seen(0, 20.0), seen(3, 20.0)],
        [seen(0, 30.0), seen(3, 30.0)],
    );
    let from = ["--from", near[0].as_str(), "--from", near[1].as_str()];
    let to = ["--to", far[0].as_str(), "--to", far[1].as_str()];
    done(&[&["scale", &project, "--length", "0.5"][..], &from, &to].concat());
    let after = centres("after");
    let factor = after[0].y / before[0].y;
    assert!((factor - 1.0).abs() > 0.1, "{factor}");
    for (before, after) in before.iter().zip(&after) {
        assert!(
            after.abs_diff_eq(*before * factor, 1e-3),
            "{before} times {factor} is {after}"
        );
    }
    done(&["add", &project, "--frames", &color, "--cameras", &sparse]);
    let added = centres("added");
    assert_eq!(added.len(), 8);
    for at in &added {
        assert!(
            after.iter().any(|known| known.abs_diff_eq(*at, 1e-3)),
            "{at} is none of {after:?}"
        );
    }
}

#[test]
fn frames_added_later_are_relative_to_the_same_origin() {
    let recording = moved(UTM);
    let project = recording.path("project");
    let [color, depth, sparse] = ["color", "depth", "sparse"].map(|name| recording.path(name));
    done(&["new", &project, "--frames", &color]);
    // Frames without cameras have no coordinates: the first cameras define the origin.
    assert!(done(&["info", &project, "--json"]).contains("\"origin\":[0.0,0.0,0.0]"));
    let more = [
        "add",
        &project,
        "--frames",
        &color,
        "--depth",
        &depth,
        "--cameras",
        &sparse,
    ];
    done(&more);
    let manifest = || std::fs::read_to_string(format!("{project}/project.toml")).unwrap();
    assert!(done(&["info", &project, "--json"]).contains("\"origin\":[500000.0,5400000.0,300.0]"));
    done(&more);
    let centres: BTreeSet<String> = manifest()
        .lines()
        .filter(|line| line.starts_with("translation"))
        .map(str::to_owned)
        .collect();
    assert_eq!(
        centres.len(),
        4,
        "the same cameras are the same in both: {centres:?}"
    );
}
