use std::sync::Arc;

use super::{contradiction, frame_doubt, voted_mask};
use crate::engine::job::Progress;
use crate::frames::{DepthMap, Frame, Image, Orientation, PictureSource};
use crate::masks::{LabelId, LabelMask};
use crate::scene::SceneError;
use crate::scene::fuse::{FuseOptions, Fused, Views, fuse};
use crate::scene::synthetic::{RenderedView, Scene, SceneOptions};

/// The made plant by organs; some frames' masks are spoilt.
struct Made {
    frames: Vec<Frame>,
    views: Vec<RenderedView>,
    truth: Vec<LabelMask>,
    masks: Vec<LabelMask>,
    scene: Scene,
}

impl Made {
    fn new() -> Self {
        let options = SceneOptions { views: 12, width: 360, height: 480, ..SceneOptions::default() };
        let scene = Scene::build(&options).unwrap();
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
        let organs = |view: &RenderedView| {
            let ids = view.mask.ids.iter().map(|&id| scene.tree().at_level(id, 2)).collect();
            LabelMask { ids, ..view.mask }
        };
        let truth: Vec<LabelMask> = views.iter().map(organs).collect();
        let frames = names.zip(&views).map(frame).collect();
        Self { frames, masks: truth.clone(), truth, views, scene }
    }

    fn organ(&self, name: &str) -> LabelId {
        self.scene.tree().by_name(name).unwrap().id
    }

    fn fused(&self) -> Fused {
        fuse(self, self.scene.tree(), &FuseOptions::default(), &Progress::default()).unwrap()
    }

    /// Frames by how much their masks contradict the vote, the worst first.
    fn ranked(&self, fused: &Fused) -> Vec<(usize, f32)> {
        let share = |frame| frame_doubt(&fused.votes, &fused.cloud.labels, frame, &self.masks[frame]).share();
        let mut ranked: Vec<(usize, f32)> = (0..self.masks.len()).map(|frame| (frame, share(frame))).collect();
        ranked.sort_by(|a, b| b.1.total_cmp(&a.1));
        ranked
    }

    fn iou(&self, mask: &LabelMask, frame: usize, label: LabelId) -> f64 {
        let pairs = || mask.ids.iter().zip(&self.truth[frame].ids).map(|(&a, &b)| (a == label, b == label));
        pairs().filter(|(a, b)| *a && *b).count() as f64 / pairs().filter(|(a, b)| *a || *b).count() as f64
    }
}

impl Views for Made {
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
        Some(Arc::new(self.masks[index].clone()))
    }
}

/// Frames whose masks are spoilt, in three ways.
const SPOILT: [usize; 5] = [1, 4, 5, 8, 10];

/// The stems are gone, called leaf, or all leaves moved by nine pixels.
fn spoilt(mask: &LabelMask, way: usize, stem: LabelId, leaf: LabelId) -> LabelMask {
    let width = mask.width as usize;
    let ids = (0..mask.ids.len()).map(|at| match (way, mask.ids[at]) {
        (0, id) if id == stem => LabelId::NONE,
        (1, id) if id == stem => leaf,
        (2, id) => {
            let moved = if at % width >= 9 { mask.ids[at - 9] } else { LabelId::NONE };
            if moved == leaf || id == leaf { if moved == leaf { leaf } else { LabelId::NONE } } else { id }
        }
        (_, id) => id,
    });
    LabelMask { ids: ids.collect(), ..*mask }
}

#[test]
fn spoilt_masks_are_the_most_doubtful_and_the_vote_repairs_them() {
    let mut made = Made::new();
    let (stem, leaf) = (made.organ("stem"), made.organ("leaf"));
    let sound = made.ranked(&made.fused());
    assert!(sound[0].1 < 0.02, "true masks agree: {sound:?}");
    for (at, &frame) in SPOILT.iter().enumerate() {
        made.masks[frame] = spoilt(&made.truth[frame], at % 3, stem, leaf);
    }
    let fused = made.fused();
    let ranked = made.ranked(&fused);
    let mut first: Vec<usize> = ranked[..5].iter().map(|(frame, _)| *frame).collect();
    first.sort_unstable();
    assert_eq!(first, SPOILT, "{ranked:?}");
    assert!(ranked[4].1 > 2.0 * ranked[5].1, "clearly: {ranked:?}");
    for frame in SPOILT {
        let depth = &made.views[frame].depth;
        let of = (frame, &made.frames[frame]);
        let mask = voted_mask((&fused.cloud, &fused.votes), of, Some(depth), &made.masks[frame], &[]).unwrap();
        for label in [stem, leaf, made.organ("panicle")] {
            let iou = made.iou(&mask, frame, label);
            assert!(iou >= 0.97, "frame {frame}, label {label:?}: {iou}");
        }
    }
}

#[test]
fn one_label_is_repaired_alone_and_a_frame_without_depth_by_what_it_sees() {
    let mut made = Made::new();
    let (stem, leaf) = (made.organ("stem"), made.organ("leaf"));
    made.masks[4] = spoilt(&made.truth[4], 1, stem, leaf);
    // The panicle is gone besides, and nobody asks for it.
    let panicle = made.organ("panicle");
    made.masks[4].ids.iter_mut().filter(|id| **id == panicle).for_each(|id| *id = LabelId::NONE);
    let fused = made.fused();
    let of = (4, &made.frames[4]);
    let mask = voted_mask((&fused.cloud, &fused.votes), of, None, &made.masks[4], &[stem]).unwrap();
    assert!(made.iou(&mask, 4, stem) > 0.85, "{}", made.iou(&mask, 4, stem));
    assert!(!mask.ids.contains(&panicle));
    let mut other = fused.votes.clone();
    other = other.select(&[0, 1]);
    assert!(voted_mask((&fused.cloud, &other), of, None, &made.masks[4], &[]).is_err());
}

#[test]
fn a_wrong_name_and_a_lost_part_are_contradicted_but_not_a_border_a_pixel_aside() {
    let (width, height) = (40, 30);
    let block = |mask: &mut LabelMask, columns: std::ops::Range<usize>, rows: std::ops::Range<usize>, id: u16| {
        for y in rows {
            columns.clone().for_each(|x| mask.ids[y * width + x] = LabelId(id));
        }
    };
    let mut voted = LabelMask::empty(width as u32, height as u32);
    block(&mut voted, 2..20, 2..20, 1);
    block(&mut voted, 20..38, 2..20, 2);
    let mut mask = voted.clone();
    block(&mut mask, 19..21, 2..20, 1);
    assert!(contradiction(&mask, &voted).is_empty());
    block(&mut mask, 26..34, 8..14, 1);
    block(&mut mask, 5..12, 5..12, 0);
    let shown = contradiction(&mask, &voted);
    assert_eq!(shown.area(), 8 * 6 + 7 * 7);
    assert!(shown.at(26, 8) && shown.at(33, 13) && shown.at(5, 5) && shown.at(11, 11));
}
