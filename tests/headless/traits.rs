//! Traits and instances of the made plant from its recording, fused with the true masks, against the truth.

use std::ops::ControlFlow;
use std::path::Path;

use glam::Vec3;
use ostra::engine::job::Progress;
use ostra::frames::{FrameFolder, OpenRequest};
use ostra::scene::LabelledCloud;
use ostra::scene::instances::{InstanceOptions, find_instances};
use ostra::scene::measure::TraitRow;
use ostra::scene::synthetic::{Scene, SceneOptions};
use ostra::session::{Command, FuseRequest, MeasureWish, NewProject, Session};

use super::session::perform;

/// A session on the recording of a made scene with its true masks, fused without background.
fn fused(scene: &Scene, folder: &Path) -> Session {
    scene.write(folder, &Progress::default()).unwrap();
    let masks = folder.join("truth/masks");
    std::fs::copy(folder.join("truth/labels.json"), masks.join("labels.json")).unwrap();
    let sources = vec![FrameFolder { frames: folder.join("color"), depth: Some(folder.join("depth")) }];
    let open = OpenRequest { sources, depth_unit: Scene::DEPTH_UNIT_M, ..OpenRequest::default() };
    let cameras = Some(folder.join("sparse"));
    let mut session = Session::new();
    let new = NewProject { root: folder.join("project"), open, cameras, intrinsics: None };
    perform(&mut session, Command::New(new)).unwrap();
    perform(&mut session, Command::ImportMasks { dir: masks, format: "davis".into() }).unwrap();
    let fuse = FuseRequest { drop_unlabelled: true, ..FuseRequest::default() };
    perform(&mut session, Command::Fuse(fuse)).unwrap();
    session
}

/// Largest share (of angles: degrees) by which a trait of the fused cloud may be off; `None` where cameras cannot see it: a
/// third of each sheath faces away from all of them, and grains a pixel apart are one.
fn allowed(truth: &TraitRow) -> Option<f64> {
    match truth.name {
        "length" if truth.label.starts_with("stem") => Some(0.02),
        "length" => Some(0.03),
        "area" if truth.label.ends_with("blade") => Some(0.05),
        "width" | "width_max" | "diameter" => Some(0.05),
        "hull_volume" => Some(0.10),
        "insertion_angle" => Some(3.0),
        _ => None,
    }
}

fn class_points(cloud: &LabelledCloud, name: &str) -> Vec<Vec3> {
    let class = cloud.tree.by_name(name).unwrap().id;
    let is_of = |point: &usize| cloud.tree.path(cloud.labels[*point]).contains(&class);
    (0..cloud.len()).filter(is_of).map(|point| cloud.positions[point]).collect()
}

#[test]
fn traits_of_the_fused_cloud_are_the_true_ones_and_its_leaves_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let scene = Scene::build(&SceneOptions::default()).unwrap();
    let mut session = fused(&scene, folder.path());
    let _ = session.traits(MeasureWish::default());
    session.settle(|_| ControlFlow::Continue(()));
    let measured = session.traits(MeasureWish::default()).unwrap().clone();
    let mut compared = 0;
    for (truth, allowed) in scene.traits().iter().filter_map(|truth| Some((truth, allowed(truth)?))) {
        let same = |row: &&TraitRow| (&row.label, row.instance, row.name) == (&truth.label, truth.instance, truth.name);
        let found = measured.iter().find(same).unwrap_or_else(|| panic!("{} of {}", truth.name, truth.label));
        let off = (found.value - truth.value).abs() / if truth.name == "insertion_angle" { 1.0 } else { truth.value };
        println!("{} of {}: {} instead of {}", truth.name, truth.label, found.value, truth.value);
        assert!(off <= allowed, "{} of {}: {} instead of {}", truth.name, truth.label, found.value, truth.value);
        compared += 1;
    }
    // Three stems, eight leaves of blade and sheath, a panicle.
    assert_eq!(compared, 3 * 2 + 8 * (1 + 5 + 1) + 1);
    let leaves = class_points(session.cloud().unwrap(), "leaf");
    let instances = find_instances(&leaves, &InstanceOptions::default(), &Progress::default()).unwrap();
    assert_eq!(instances.sizes.len(), 8, "{:?}", instances.sizes);
}
