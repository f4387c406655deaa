//! Fusion of real recordings.

use std::path::Path;
use std::sync::Arc;

use ostra::engine::job::Progress;
use ostra::frames::{Frame, FrameCamera, FrameFolder, FrameStore, OpenRequest, open};
use ostra::geometry::{Camera, Pose};
use ostra::masks::{LabelId, LabelMask, LabelTree};
use ostra::scene::fuse::{FuseOptions, Fused, OntoOptions, ProjectViews, fuse, vote_onto};
use ostra::scene::ply::read_ply;
use ostra::scene::score::{CloudScoreOptions, cloud_table, score_cloud};

use crate::support::data_dir;

fn load(dir: &Path, colors: &str, depth: Option<&str>) -> Vec<Frame> {
    let source = FrameFolder { frames: dir.join(colors), depth: depth.map(|d| dir.join(d)) };
    let mut frames =
        open(&OpenRequest { sources: vec![source], ..OpenRequest::default() }, &Progress::default()).unwrap().frames;
    let numbers = |line: &str| -> Vec<f64> { line.split_whitespace().filter_map(|w| w.parse().ok()).collect() };
    let cameras = std::fs::read_to_string(dir.join("sparse/cameras.txt")).unwrap();
    let c = numbers(cameras.lines().last().unwrap());
    let shift = option("SHIFT", 0.0);
    let intrinsics = Camera::pinhole(c[1] as u32, c[2] as u32, c[3], c[4], c[5] + shift, c[6] + shift);
    let images = std::fs::read_to_string(dir.join("sparse/images.txt")).unwrap();
    for line in images.lines().filter(|l| !l.starts_with('#') && !l.is_empty()) {
        let n = numbers(line);
        let name = line.split_whitespace().last().unwrap();
        let pose = Pose {
            rotation: glam::DQuat::from_xyzw(n[2], n[3], n[4], n[1]).normalize(),
            translation: glam::DVec3::new(n[5], n[6], n[7]),
        };
        let frame = frames.iter_mut().find(|f| f.name == name).unwrap();
        frame.camera = Some(FrameCamera { intrinsics, camera_from_world: Some(pose) });
    }
    frames
}

fn masks(dir: &Path, frames: &[Frame]) -> Vec<Option<Arc<LabelMask>>> {
    frames
        .iter()
        .map(|frame| {
            let path = dir.join(Path::new(&frame.name).with_extension("png"));
            let picture = image::open(path).unwrap().to_luma8();
            let ids = picture.pixels().map(|p| LabelId(u16::from(p.0[0]))).collect();
            Some(Arc::new(LabelMask { width: picture.width(), height: picture.height(), ids }))
        })
        .collect()
}

fn option(name: &str, default: f64) -> f64 {
    std::env::var(name).ok().and_then(|v| v.parse().ok()).unwrap_or(default)
}

#[test]
fn apc_shelf() {
    let Some(data) = data_dir() else { return };
    let dir = data.join("apc_shelf_rgbd_labels");
    let frames = load(&dir, "color", Some("depth"));
    let masks = masks(&dir.join("labels"), &frames);
    let store = FrameStore::new(256 << 20);
    let mask = |i: usize| masks[i].clone();
    let views = ProjectViews { frames: &frames, store: &store, masks: &mask };
    let voxel = option("VOXEL", 0.0);
    let options = FuseOptions {
        voxel: (voxel > 0.0).then_some(voxel),
        depth_tolerance: option("TOL", 0.01) as f32,
        edge_tolerance: option("EDGE", 0.02) as f32,
        ..FuseOptions::default()
    };
    let start = std::time::Instant::now();
    let fused = fuse(&views, &LabelTree::default(), &options, &Progress::default()).unwrap();
    println!("{:?} {:#?}", start.elapsed(), fused.report);
    let truth = read_ply(&dir.join("reference_labelled_cloud.ply"), &Progress::default()).unwrap().cloud;
    let score = score_cloud(
        &truth,
        &fused.cloud,
        &CloudScoreOptions { within: vec![0.005, 0.002], ..CloudScoreOptions::default() },
        &Progress::default(),
    )
    .unwrap();
    println!("{}", cloud_table(&score));
    picture(&fused, &frames, "apc");
}

fn picture(fused: &Fused, frames: &[Frame], name: &str) {
    let out = Path::new("/tmp/fuse");
    let p = Progress::default();
    ostra::scene::ply::save_ply(&out.join(format!("{name}.ply")), &fused.cloud, Default::default(), &p).unwrap();
    let _ = frames;
}

#[test]
fn romi() {
    let Some(data) = data_dir() else { return };
    let dir = data.join("romi_virtual_plant_labels");
    let frames = load(&dir, "images", None);
    let masks = masks(&dir.join("labels"), &frames);
    let store = FrameStore::new(256 << 20);
    let mask = |i: usize| masks[i].clone();
    let views = ProjectViews { frames: &frames, store: &store, masks: &mask };
    let truth = read_ply(&dir.join("gt_labelled_cloud.ply"), &Progress::default()).unwrap().cloud;
    let radius = option("RADIUS", 0.0);
    let start = std::time::Instant::now();
    let fused = vote_onto(
        &truth,
        &views,
        &LabelTree::default(),
        &OntoOptions { radius: (radius > 0.0).then_some(radius), ..OntoOptions::default() },
        &Progress::default(),
    )
    .unwrap();
    println!("{:?} {:#?}", start.elapsed(), fused.report);
    let score = score_cloud(
        &truth,
        &fused.cloud,
        &CloudScoreOptions { within: vec![0.001], ..CloudScoreOptions::default() },
        &Progress::default(),
    )
    .unwrap();
    println!("{}", cloud_table(&score));
    picture(&fused, &frames, "romi");
}

#[test]
fn kitchen() {
    let Some(data) = data_dir() else { return };
    let dir = data.join("redkitchen_rgbd_a");
    let mut frames = load(&dir, "color", Some("depth"));
    let every = option("EVERY", 1.0) as usize;
    frames = frames.into_iter().step_by(every).collect();
    let store = FrameStore::new(256 << 20);
    let mask = |_: usize| None;
    let views = ProjectViews { frames: &frames, store: &store, masks: &mask };
    let outliers = option("OUT", 0.0);
    let options = FuseOptions {
        voxel: Some(option("VOXEL", 0.01)),
        edge_tolerance: option("EDGE", 0.02) as f32,
        min_views: option("VIEWS", 1.0) as u32,
        outliers: (outliers > 0.0)
            .then_some(ostra::scene::points::OutlierOptions { neighbours: 16, std_ratio: outliers }),
        ..FuseOptions::default()
    };
    let start = std::time::Instant::now();
    let fused = fuse(&views, &LabelTree::default(), &options, &Progress::default()).unwrap();
    println!("{:?} {:#?}", start.elapsed(), fused.report);
    picture(&fused, &frames, "kitchen");
}
