//! Tests of stereo on the synthetic scene with its ground-truth cameras.
//!
//! Depth and mesh are compared with the exact surfaces.

use std::collections::BTreeMap;
use std::path::Path;

use ostra_cloud::LabelledCloud;
use ostra_cloud::ply::{read_mesh, read_ply};
use ostra_cloud::points::Neighbours;
use ostra_core::job::Progress;
use ostra_eval::cloud_score::{CloudScoreOptions, score_cloud};
use ostra_eval::synthetic::{Scene, TruthOptions};
use ostra_masks::LabelId;
use tempfile::TempDir;

use crate::project::Project;
use crate::tiller::{Tiller, tiller};

fn depth_of(file: &Path) -> Vec<f32> {
    let mut file = tiff::decoder::Decoder::new(std::fs::File::open(file).unwrap()).unwrap();
    let tiff::decoder::DecodingResult::F32(depths) = file.read_image().unwrap() else {
        panic!("32-bit floats")
    };
    depths
}

/// Returns the share of labelled pixels of all views whose depth is known to 1 %.
fn share_in_depth(scene: &Scene, depths: &Path) -> f64 {
    let (mut good, mut all) = (0, 0);
    for view in scene.views() {
        let exact = scene.render_exact(view);
        let found = depth_of(&depths.join(format!("{}.tiff", view.name)));
        for ((&truth, id), &found) in exact.depth.depths.iter().zip(&exact.mask.ids).zip(&found) {
            if *id != LabelId::NONE {
                all += 1;
                good += usize::from((found / truth - 1.0).abs() <= 0.01);
            }
        }
    }
    f64::from(good as u32) / f64::from(all as u32)
}

/// Returns the share of `points` that have a point of `surface` within 2 mm.
fn share_near(points: impl Iterator<Item = glam::Vec3>, surface: &LabelledCloud) -> f64 {
    let surface = Neighbours::new(&surface.positions).unwrap();
    let away: Vec<f32> = points.map(|point| surface.nearest(point).1).collect();
    away.iter().filter(|&&away| away <= 0.002).count() as f64 / away.len() as f64
}

fn with_label(
    cloud: &LabelledCloud,
    wanted: impl Fn(LabelId) -> bool,
) -> impl Iterator<Item = glam::Vec3> {
    cloud
        .positions
        .iter()
        .zip(&cloud.labels)
        .filter(move |(_, label)| wanted(**label))
        .map(|(&position, _)| position)
}

fn synthetic_scene_with_ground_truth_cameras_and_masks() {
    let dir = TempDir::new().unwrap();
    let path = |name: &str| dir.path().join(name).display().to_string();
    let Tiller { scene, recording } = tiller();
    let progress = Progress::default();
    let of_recording = |name: &str| recording.join(name).display().to_string();
    let project = Project::new(
        &recording.join("color"),
        &["--cameras", &of_recording("sparse")],
    );
    let root = project.root();
    project.done(&["reconstruct", &root, "--method", "mvs", "--max-side", "640"]);
    project.done(&["masks", &root, "import", &of_recording("truth/masks")]);
    project.done(&["fuse", &root, "--drop-unlabelled"]);
    let exports = [
        "--cloud",
        &path("cloud.ply"),
        "--mesh",
        &path("mesh.ply"),
        "--depths",
        &path("depths"),
    ];
    project.done(&[&["export", &root][..], &exports].concat());

    let in_depth = share_in_depth(scene, &dir.path().join("depths"));
    let options = TruthOptions {
        surroundings_m: None,
        spacing_m: 0.0005,
        min_views: 0,
    };
    let surface = scene.cloud(&options, &progress).unwrap();
    let cloud = read_ply(&dir.path().join("cloud.ply"), &progress)
        .unwrap()
        .cloud;
    let near = share_near(cloud.positions.iter().copied(), &surface);
    let visible = TruthOptions {
        surroundings_m: None,
        ..TruthOptions::default()
    };
    let truth = scene.cloud(&visible, &progress).unwrap();
    let options = CloudScoreOptions {
        within: vec![0.003],
        level: Some(Scene::CLASS_LEVEL),
        ..Default::default()
    };
    let score = score_cloud(&truth, &cloud, &options, &progress).unwrap();
    let iou: BTreeMap<&str, f64> = score
        .labels
        .iou
        .iter()
        .map(|label| (label.name.as_str(), label.iou))
        .collect();
    let is_stem = |id: LabelId| {
        scene
            .tree()
            .path(id)
            .iter()
            .any(|&above| truth.tree.get(above).unwrap().name == "stem")
    };
    let stems = share_near(with_label(&truth, is_stem), &cloud);
    println!("in depth {in_depth:.3}, within 2 mm {near:.4}, IoU {iou:?}, stems {stems:.3}");
    assert!(in_depth >= 0.93 && near >= 0.95 && stems >= 0.85);
    assert!(
        iou.len() == 3 && iou.values().all(|&iou| iou >= 0.95),
        "{iou:?}"
    );

    let mesh = read_mesh(&dir.path().join("mesh.ply"), &progress)
        .unwrap()
        .vertices;
    let (near, leaves) = (
        share_near(mesh.positions.iter().copied(), &surface),
        share_near(with_label(&truth, |_| true), &mesh),
    );
    println!(
        "mesh: {} vertices, within 2 mm {near:.4}, completeness {leaves:.4}",
        mesh.len()
    );
    assert!(near >= 0.93 && leaves >= 0.90, "{near} {leaves}");
}

crate::registry::tests! {
    Nothing => synthetic_scene_with_ground_truth_cameras_and_masks;
}
