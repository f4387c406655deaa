//! Tests of masks re-projected through geometry, on a real shelf and on the synthetic scene.

use std::collections::BTreeMap;
use std::sync::Arc;

use ostra_core::job::Progress;
use ostra_eval::synthetic::{Scene, SceneOptions};
use ostra_frames::cameras::GivenCameras;
use ostra_frames::{Frame, FrameFolder, FrameStore, OpenRequest, open};
use ostra_masks::{Direction, LabelId, LabelMask, TrackRequest, Tracker, read_palette_png};
use ostra_tracking::reprojection::GeometryTracker;

use crate::data::data_dir;

/// Returns the masks that the tracker makes on all frames from the ground-truth mask of one.
fn transferred(frames: &[Frame], keyframe: usize, mask: LabelMask) -> BTreeMap<usize, LabelMask> {
    let request = TrackRequest {
        frames: Arc::new(frames.to_vec()),
        store: Arc::new(FrameStore::new(256 << 20)),
        keyframes: BTreeMap::from([(keyframe, Arc::new(mask))]),
        from: 0,
        to: frames.len() - 1,
        direction: Direction::Both,
        labels: None,
    };
    let mut masks = BTreeMap::new();
    let mut take = |tracked: ostra_masks::TrackedFrame| {
        masks.insert(tracked.frame, tracked.mask);
    };
    GeometryTracker::default()
        .track(&request, &mut take, &Progress::default())
        .unwrap();
    assert!(
        !masks.contains_key(&keyframe),
        "a keyframe is never brought a mask"
    );
    masks
}

/// Returns the mean IoU of one label over the frames.
fn mean_iou(results: &BTreeMap<usize, LabelMask>, truths: &[LabelMask], label: LabelId) -> f64 {
    let iou = |(frame, result): (&usize, &LabelMask)| {
        let pairs = || result.ids.iter().zip(&truths[*frame].ids);
        let both = pairs().filter(|&(a, b)| *a == label && *b == label).count();
        let either = pairs().filter(|&(a, b)| *a == label || *b == label).count();
        if either == 0 {
            1.0
        } else {
            both as f64 / either as f64
        }
    };
    results.iter().map(iou).sum::<f64>() / results.len() as f64
}

fn one_ground_truth_mask_of_a_real_shelf_reaches_the_other_frames() {
    let data = data_dir();
    let set = data.join("apc_shelf_rgbd_labels");
    let source = FrameFolder {
        frames: set.join("color"),
        depth: Some(set.join("depth")),
    };
    let request = OpenRequest {
        sources: vec![source],
        ..OpenRequest::default()
    };
    let mut frames = open(&request, &Progress::default()).unwrap().frames;
    GivenCameras::read(&set.join("sparse"))
        .unwrap()
        .match_to(&mut frames)
        .unwrap();
    let truth = |frame: &Frame| read_palette_png(&set.join("labels").join(&frame.name)).unwrap();
    let truths: Vec<LabelMask> = frames.iter().map(truth).collect();
    let masks = transferred(&frames, 7, truths[7].clone());
    assert_eq!(masks.len(), frames.len() - 1);
    let ious: Vec<f64> = (1..=4)
        .map(|id| mean_iou(&masks, &truths, LabelId(id)))
        .collect();
    println!("apc shelf, true mask of frame 7 carried to the other 14: IoU {ious:.3?}");
    let mean = ious.iter().sum::<f64>() / 4.0;
    assert!(
        mean >= 0.78,
        "mean IoU {mean:.3}; a mask carried with nearest fill reaches 0.72"
    );
}

fn synthetic_plant_keeps_its_organs_across_the_arc() {
    let options = SceneOptions {
        views: 12,
        ..SceneOptions::default()
    };
    let scene = Scene::build(&options).unwrap();
    let dir = tempfile::tempdir().unwrap();
    scene.write(dir.path(), &Progress::default()).unwrap();
    let source = FrameFolder {
        frames: dir.path().join("color"),
        depth: Some(dir.path().join("depth")),
    };
    let request = OpenRequest {
        sources: vec![source],
        depth_unit: Scene::DEPTH_UNIT_M,
        ..OpenRequest::default()
    };
    let mut frames = open(&request, &Progress::default()).unwrap().frames;
    GivenCameras::read(&dir.path().join("sparse"))
        .unwrap()
        .match_to(&mut frames)
        .unwrap();
    let truth = |frame: &Frame| {
        let mut mask = read_palette_png(&dir.path().join("truth/masks").join(&frame.name)).unwrap();
        mask.ids
            .iter_mut()
            .for_each(|id| *id = scene.tree().at_level(*id, Scene::CLASS_LEVEL));
        mask
    };
    let truths: Vec<LabelMask> = frames.iter().map(truth).collect();
    let masks = transferred(&frames, 6, truths[6].clone());
    for (class, floor) in [("panicle", 0.9), ("leaf", 0.9), ("stem", 0.8)] {
        let label = scene.tree().by_name(class).unwrap().id;
        let iou = mean_iou(&masks, &truths, label);
        println!("made plant, {class}: IoU {iou:.3}");
        assert!(iou >= floor, "{class}: {iou:.3}");
    }
}

crate::registry::tests! {
    Nothing => synthetic_plant_keeps_its_organs_across_the_arc;
    Data(&["apc_shelf_rgbd_labels"]) => one_ground_truth_mask_of_a_real_shelf_reaches_the_other_frames;
}
