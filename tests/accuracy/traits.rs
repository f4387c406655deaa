//! Tests of traits and instances of the synthetic plant, fused with the ground-truth masks.

use std::ops::ControlFlow;
use std::path::Path;
use std::process::Command as Process;

use glam::Vec3;
use ostra_cloud::LabelledCloud;
use ostra_cloud::instances::{InstanceOptions, find_instances};
use ostra_cloud::measure::TraitRow;
use ostra_core::job::Progress;
use ostra_eval::synthetic::Scene;
use ostra_frames::{FrameFolder, OpenRequest};
use ostra_masks::MaskFormat;
use ostra_project::{ExportRequest, FuseRequest};
use ostra_session::{Command, MeasureSettings, NewProject, Session};

use crate::session::perform;
use crate::tiller::{Tiller, tiller};

/// Returns a session on a synthetic recording with ground-truth masks, fused without background.
fn fused(tiller: &Tiller, folder: &Path) -> Session {
    let masks = tiller.true_masks(folder);
    let recording = &tiller.recording;
    let sources = vec![FrameFolder {
        frames: recording.join("color"),
        depth: Some(recording.join("depth")),
    }];
    let open = OpenRequest {
        sources,
        depth_unit: Scene::DEPTH_UNIT_M,
        ..OpenRequest::default()
    };
    let cameras = Some(recording.join("sparse"));
    let mut session = Session::new();
    let new = NewProject {
        root: folder.join("project"),
        open,
        cameras,
        intrinsics: None,
    };
    perform(&mut session, Command::New(new)).unwrap();
    perform(
        &mut session,
        Command::ImportMasks {
            dir: masks,
            format: MaskFormat::Davis,
        },
    )
    .unwrap();
    let fuse = FuseRequest {
        drop_unlabelled: true,
        ..FuseRequest::default()
    };
    perform(&mut session, Command::Fuse(fuse)).unwrap();
    session
}

/// Returns the maximum relative error of a trait of the fused cloud (degrees for angles).
///
/// `None` where cameras cannot see it: a third of each sheath faces away from all of them, and
/// grains a pixel apart look like one.
fn allowed(truth: &TraitRow) -> Option<f64> {
    match &*truth.name {
        "length" if truth.label.starts_with("stem") => Some(0.02),
        "length" => Some(0.03),
        "area" if truth.label.ends_with("blade") => Some(0.05),
        "width" | "width_max" | "diameter" => Some(0.05),
        "hull_volume" => Some(0.10),
        "insertion_angle" => Some(3.0),
        _ => None,
    }
}

/// Returns the exported angles between each leaf and the stems.
///
/// They are exported in one run, and again by a recipe.
fn exported_angles(folder: &Path, leaves: &[String]) -> Vec<(String, f64)> {
    let project = folder.join("project").display().to_string();
    let csv = folder.join("angles.csv");
    let path = csv.display().to_string();
    let angles = leaves
        .iter()
        .flat_map(|leaf| ["--angle", leaf.as_str(), "stem"]);
    let words = ["export", &project, "--traits", &path]
        .into_iter()
        .chain(angles);
    let output = Process::new(env!("CARGO_BIN_EXE_ostra"))
        .args(words)
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let read = || {
        let text = std::fs::read_to_string(&csv).unwrap();
        let rows = text
            .lines()
            .map(|line| line.split(',').map(str::to_owned).collect::<Vec<_>>());
        let rows = rows.filter(|cells| cells[3] == "angle_to_stem" && cells[2] == "1");
        rows.map(|cells| (cells[0].clone(), cells[4].parse().unwrap()))
            .collect::<Vec<(String, f64)>>()
    };
    let rows = read();
    // The same export from a session, whose recipe keeps it.
    std::fs::remove_file(&csv).unwrap();
    let mut session = Session::new();
    perform(&mut session, Command::Open(project.into())).unwrap();
    let id = |name: &str| session.project().unwrap().labels.by_name(name).unwrap().id;
    let angles = leaves.iter().map(|leaf| [id(leaf), id("stem")]).collect();
    let export = Command::Export(ExportRequest {
        traits: Some(csv.clone()),
        angles,
        ..ExportRequest::default()
    });
    perform(&mut session, export.clone()).unwrap();
    assert_eq!(read(), rows);
    assert_eq!(session.recipe().commands.last(), Some(&export));
    rows
}

fn class_points(cloud: &LabelledCloud, name: &str) -> Vec<Vec3> {
    let class = cloud.tree.by_name(name).unwrap().id;
    let is_of = |point: &usize| cloud.tree.path(cloud.labels[*point]).contains(&class);
    (0..cloud.len())
        .filter(is_of)
        .map(|point| cloud.positions[point])
        .collect()
}

fn traits_and_leaf_count_of_the_fused_cloud_equal_ground_truth() {
    let folder = tempfile::tempdir().unwrap();
    let tiller = tiller();
    let scene = &tiller.scene;
    let mut session = fused(tiller, folder.path());
    let _ = session.traits(MeasureSettings::default());
    session.settle(|_| ControlFlow::Continue(()));
    let measured = session.traits(MeasureSettings::default()).unwrap().clone();
    let mut compared = 0;
    for (truth, allowed) in scene
        .traits()
        .iter()
        .filter_map(|truth| Some((truth, allowed(truth)?)))
    {
        let same = |row: &&TraitRow| {
            (&row.label, row.instance, &row.name) == (&truth.label, truth.instance, &truth.name)
        };
        let found = measured
            .iter()
            .find(same)
            .unwrap_or_else(|| panic!("{} of {}", truth.name, truth.label));
        let off = (found.value - truth.value).abs()
            / if truth.name == "insertion_angle" {
                1.0
            } else {
                truth.value
            };
        println!(
            "{} of {}: {} instead of {}",
            truth.name, truth.label, found.value, truth.value
        );
        assert!(
            off <= allowed,
            "{} of {}: {} instead of {}",
            truth.name,
            truth.label,
            found.value,
            truth.value
        );
        compared += 1;
    }
    // Three stems, eight leaves of blade and sheath, and a panicle.
    assert_eq!(compared, 3 * 2 + 8 * (1 + 5 + 1) + 1);
    let leaves = class_points(session.cloud().unwrap(), "leaf");
    let instances =
        find_instances(&leaves, &InstanceOptions::default(), &Progress::default()).unwrap();
    assert_eq!(instances.sizes.len(), 8, "{:?}", instances.sizes);
    let blades: Vec<String> = (1..=8).map(|k| format!("leaf {k} blade")).collect();
    // The window requests the same angles.
    let pair = ["leaf 3 blade", "stem"]
        .map(|name| session.project().unwrap().labels.by_name(name).unwrap().id);
    assert!(session.angles([pair]).is_empty());
    session.settle(|_| ControlFlow::Continue(()));
    let requested = session.angles([pair])[&pair].clone().unwrap()[0].value;
    drop(session);
    let angles = exported_angles(folder.path(), &blades);
    assert_eq!(
        angles
            .iter()
            .map(|(label, _)| label.clone())
            .collect::<Vec<_>>(),
        blades
    );
    assert!(
        (angles[2].1 - requested).abs() < 1e-3,
        "{} and {requested}",
        angles[2].1
    );
    for (label, degrees) in angles {
        let is_truth = |row: &&TraitRow| row.label == label && row.name == "insertion_angle";
        let truth = scene.traits().iter().find(is_truth).unwrap().value;
        println!("angle of {label} to its stem: {degrees} instead of {truth}");
        assert!(
            (degrees - truth).abs() < 3.0,
            "{label}: {degrees} instead of {truth}"
        );
    }
}

crate::registry::tests! {
    Nothing => traits_and_leaf_count_of_the_fused_cloud_equal_ground_truth;
}
