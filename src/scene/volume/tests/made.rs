use std::sync::Arc;

use super::*;
use crate::frames::{DepthMap, Frame, Image, Orientation, PictureSource};
use crate::masks::LabelMask;
use crate::scene::LabelledCloud;
use crate::scene::fuse::{OntoOptions, SeenPoints, Votes, pixel_footprint, vote_seen};
use crate::scene::points::Neighbours;
use crate::scene::score::{CloudScoreOptions, score_cloud};
use crate::scene::synthetic::{RenderedView, Scene, SceneOptions, SensorNoise, TruthOptions};

/// The made scene as a sensor sees it, with true masks.
struct Sensed {
    frames: Vec<Frame>,
    views: Vec<RenderedView>,
}

impl Sensed {
    fn new(scene: &Scene) -> Self {
        let views: Vec<RenderedView> = scene.views().iter().map(|view| scene.render(view)).collect();
        let frame = |(name, view): (String, &RenderedView)| Frame {
            name,
            width: view.image.width,
            height: view.image.height,
            picture: PictureSource::File { path: "none".into(), orientation: Orientation(1) },
            depth: None,
            camera: Some(view.camera),
        };
        let names = scene.views().iter().map(|view| view.name.clone());
        Self { frames: names.zip(&views).map(frame).collect(), views }
    }
}

impl Views for Sensed {
    fn frames(&self) -> &[Frame] {
        &self.frames
    }
    fn has_depth(&self, _: usize) -> bool {
        true
    }
    fn image(&self, index: usize) -> Result<Arc<Image>, SceneError> {
        Ok(Arc::new(self.views[index].image.clone()))
    }
    fn depth(&self, index: usize) -> Result<Option<Arc<DepthMap>>, SceneError> {
        Ok(Some(Arc::new(self.views[index].depth.clone())))
    }
    fn mask(&self, index: usize) -> Option<Arc<LabelMask>> {
        Some(Arc::new(self.views[index].mask.clone()))
    }
}

fn median_off(cloud: &LabelledCloud, truth: &LabelledCloud) -> f32 {
    let truth = Neighbours::new(&truth.positions).unwrap();
    let mut off: Vec<f32> = cloud.positions.iter().map(|&at| truth.nearest(at).1).collect();
    off.sort_by(f32::total_cmp);
    off[off.len() / 2]
}

/// Every vertex's label is one that some view gave it, or none.
fn assert_labels_were_given(cloud: &LabelledCloud, votes: &Votes) {
    let invented = (0..cloud.len()).filter(|&at| {
        let label = cloud.labels[at];
        label.0 != 0 && votes.histogram(at).iter().all(|&(given, _)| given != label)
    });
    assert_eq!(invented.count(), 0);
}

#[test]
fn thin_organs_outlive_a_sensors_noise() {
    let progress = Progress::default();
    let scene = Scene::build(&SceneOptions { noise: Some(SensorNoise::default()), ..SceneOptions::default() }).unwrap();
    let sensed = Sensed::new(&scene);
    let all: Vec<usize> = (0..sensed.frames.len()).collect();
    let voxel = pixel_footprint(&sensed, &all).unwrap().unwrap();
    let options = VolumeOptions { voxel, only_labelled: true, ..VolumeOptions::default() };
    let mesh = reconstruct_surface(&sensed, &options, &progress).unwrap().mesh;
    let onto = OntoOptions::default();
    let voted = vote_seen(mesh.vertices.clone(), &SeenPoints::new(), &sensed, scene.tree(), &onto, &progress).unwrap();
    assert_labels_were_given(&voted.cloud, &voted.votes);
    let truth = scene.cloud(&TruthOptions { surroundings_m: None, ..TruthOptions::default() }, &progress).unwrap();
    let within =
        CloudScoreOptions { within: vec![0.005], level: Some(Scene::CLASS_LEVEL), ..CloudScoreOptions::default() };
    let score = score_cloud(&truth, &voted.cloud, &within, &progress).unwrap();
    assert_eq!(score.labels.iou.len(), 3);
    for label in &score.labels.iou {
        assert!(label.iou >= 0.95, "{}: {}", label.name, label.iou);
    }
    let off = median_off(&voted.cloud, &truth);
    assert!(score.median_distance < 0.001 && off < 0.001, "{} and {off}", score.median_distance);
    assert!(score.surface[0].accuracy > 0.95, "{:?}", score.surface[0]);
}
