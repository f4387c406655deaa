use ostra_cloud::LabelledCloud;
use ostra_cloud::fuse::{MaskVote, OntoOptions, SeenPoints, Votes, pixel_footprint, vote_seen};
use ostra_cloud::points::Neighbours;
use ostra_cloud::volume::{VolumeOptions, reconstruct_surface};
use ostra_core::job::Progress;

use super::Rendered;
use crate::cloud_score::{CloudScoreOptions, score_cloud};
use crate::synthetic::{Scene, SceneOptions, SensorNoise, TruthOptions};

fn median_off(cloud: &LabelledCloud, truth: &LabelledCloud) -> f32 {
    let truth = Neighbours::new(&truth.positions).unwrap();
    let mut off: Vec<f32> = cloud
        .positions
        .iter()
        .map(|&at| truth.nearest(at).1)
        .collect();
    off.sort_by(f32::total_cmp);
    off[off.len() / 2]
}

/// Asserts that every vertex is unlabelled or has a label that some view voted for.
fn assert_labels_were_given(cloud: &LabelledCloud, votes: &Votes) {
    let invented = (0..cloud.len()).filter(|&at| {
        let label = cloud.labels[at];
        label.0 != 0 && votes.histogram(at).iter().all(|&(given, _)| given != label)
    });
    assert_eq!(invented.count(), 0);
}

#[test]
fn thin_organs_survive_sensor_noise() {
    let progress = Progress::default();
    let options = SceneOptions {
        noise: Some(SensorNoise::default()),
        ..SceneOptions::default()
    };
    let sensed = Rendered::new(&options, None);
    let scene = &sensed.scene;
    let all: Vec<usize> = (0..sensed.frames.len()).collect();
    let voxel = pixel_footprint(&sensed, &all).unwrap().unwrap();
    let options = VolumeOptions {
        voxel,
        only_labelled: true,
        ..VolumeOptions::default()
    };
    let mesh = reconstruct_surface(&sensed, &options, &progress)
        .unwrap()
        .mesh;
    let onto = OntoOptions::default();
    let voted = vote_seen(
        mesh.vertices.clone(),
        &SeenPoints::new(),
        &MaskVote {
            views: &sensed,
            tree: scene.tree(),
            options: &onto,
        },
        &progress,
    )
    .unwrap();
    assert_labels_were_given(&voted.cloud, &voted.votes);
    let truth = scene
        .cloud(
            &TruthOptions {
                surroundings_m: None,
                ..TruthOptions::default()
            },
            &progress,
        )
        .unwrap();
    let within = CloudScoreOptions {
        within: vec![0.005],
        level: Some(Scene::CLASS_LEVEL),
        ..CloudScoreOptions::default()
    };
    let score = score_cloud(&truth, &voted.cloud, &within, &progress).unwrap();
    assert_eq!(score.labels.iou.len(), 3);
    for label in &score.labels.iou {
        assert!(label.iou >= 0.95, "{}: {}", label.name, label.iou);
    }
    let off = median_off(&voted.cloud, &truth);
    assert!(
        score.median_distance < 0.001 && off < 0.001,
        "{} and {off}",
        score.median_distance
    );
    assert!(score.surface[0].accuracy > 0.95, "{:?}", score.surface[0]);
}
