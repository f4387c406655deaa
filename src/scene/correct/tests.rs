use std::sync::Arc;

use super::SeeingPixels;
use super::blind::close_blind;
use super::seeing::Pixel;
use crate::engine::job::Progress;
use crate::frames::{DepthMap, Frame, Image, Orientation, PictureSource};
use crate::masks::{LabelId, LabelMask, Region};
use crate::scene::SceneError;
use crate::scene::fuse::{FuseOptions, Fused, Views, fuse};
use crate::scene::select::{SelectStep, Selection, Selector};
use crate::scene::synthetic::{RenderedView, Scene, SceneOptions};

/// The made plant by organs, with true depths.
struct Made {
    frames: Vec<Frame>,
    views: Vec<RenderedView>,
    masks: Vec<LabelMask>,
    scene: Scene,
}

impl Made {
    fn new() -> Self {
        let options = SceneOptions { views: 8, width: 240, height: 320, ..SceneOptions::default() };
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
        let frames = scene.views().iter().map(|view| view.name.clone()).zip(&views).map(frame).collect();
        let organs = |view: &RenderedView| {
            let ids = view.mask.ids.iter().map(|&id| scene.tree().at_level(id, 2)).collect();
            LabelMask { ids, ..view.mask }
        };
        Self { frames, masks: views.iter().map(organs).collect(), views, scene }
    }

    fn label(&self, name: &str) -> LabelId {
        self.scene.tree().by_name(name).unwrap().id
    }

    fn fused(&self) -> Fused {
        fuse(self, self.scene.tree(), &FuseOptions::default(), &Progress::default()).unwrap()
    }

    /// The pixels of each frame that see the chosen points.
    fn seeing(&self, fused: &Fused, selector: &Selector, selection: &Selection, by_depth: bool) -> Vec<Option<Region>> {
        let seeing = SeeingPixels::new(selector, &fused.votes, selection).unwrap();
        let region = |number: usize| {
            let depth = by_depth.then_some(&self.views[number].depth);
            seeing.in_frame((number, &self.frames[number]), depth, &self.masks[number])
        };
        (0..self.frames.len()).map(region).collect()
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

fn chosen(fused: &Fused, steps: &[SelectStep]) -> (Selector, Selection) {
    let selector = Selector::new(Arc::new(fused.cloud.clone())).unwrap();
    let selection = selector.select(&[], &fused.cloud.tree, steps, &Progress::default()).unwrap();
    (selector, selection)
}

#[test]
fn what_sees_an_organ_are_its_pixels() {
    let made = Made::new();
    let fused = made.fused();
    for name in ["leaf", "panicle"] {
        let label = made.label(name);
        let (selector, selection) = chosen(&fused, &[SelectStep::Label(label)]);
        for (least, by_depth) in [(0.93, true), (0.8, false)] {
            for (number, region) in made.seeing(&fused, &selector, &selection, by_depth).into_iter().enumerate() {
                let iou = region.unwrap().iou(&made.masks[number].region(label));
                assert!(iou > least, "{name} on frame {number}, by depth {by_depth}: {iou}");
            }
        }
    }
}

#[test]
fn after_writing_back_the_vote_gives_the_points_their_label_and_leaves_others() {
    let mut made = Made::new();
    let before = made.fused();
    let (panicle, stem) = (made.label("panicle"), made.label("stem"));
    let (selector, selection) = chosen(&before, &[SelectStep::Label(panicle), SelectStep::Piece(0)]);
    let regions = made.seeing(&before, &selector, &selection, true);
    for (mask, region) in made.masks.iter_mut().zip(regions.into_iter().flatten()) {
        mask.ids.iter_mut().zip(region.inside).filter(|(_, inside)| *inside).for_each(|(id, _)| *id = stem);
    }
    let after = made.fused();
    assert_eq!(after.cloud.positions, before.cloud.positions);
    let is_chosen = |point: usize| selection.points.binary_search(&(point as u32)).is_ok();
    let voted = |point: &usize| !before.votes.histogram(*point).is_empty();
    let moved = selection.points.iter().filter(|&&point| after.cloud.labels[point as usize] == stem).count();
    assert!(moved * 1000 >= selection.points.len() * 995, "{moved} of {}", selection.points.len());
    let others: Vec<usize> = (0..before.cloud.len()).filter(voted).filter(|&point| !is_chosen(point)).collect();
    let kept = others.iter().filter(|&&point| after.cloud.labels[point] == before.cloud.labels[point]).count();
    assert!(kept * 1000 >= others.len() * 998, "{kept} of {}", others.len());
}

#[test]
fn a_frame_that_sees_none_of_it_and_votes_of_another_cloud() {
    let made = Made::new();
    let fused = made.fused();
    let selector = Selector::new(Arc::new(fused.cloud.clone())).unwrap();
    let none = made.seeing(&fused, &selector, &Selection::default(), true);
    assert!(none.iter().all(Option::is_none));
    let other = fused.votes.select(&[0, 1]);
    assert!(SeeingPixels::new(&selector, &other, &Selection::default()).is_err());
}

/// A picture drawn with letters: `c` chosen, `o` other, a blank blind; digits are the labels of the mask.
fn closed(pixels: &[&str], labels: &[&str]) -> Vec<String> {
    let kind = |letter: u8| match letter {
        b'c' => Pixel::Chosen,
        b'o' => Pixel::Other,
        _ => Pixel::Blind,
    };
    let mut found: Vec<Pixel> = pixels.iter().flat_map(|row| row.bytes()).map(kind).collect();
    let ids = labels.iter().flat_map(|row| row.bytes()).map(|digit| LabelId(u16::from(digit - b'0'))).collect();
    let (width, height) = (pixels[0].len() as u32, pixels.len() as u32);
    close_blind(&mut found, &LabelMask { width, height, ids });
    let letter = |pixel: &Pixel| match pixel {
        Pixel::Chosen => 'c',
        Pixel::Other => 'o',
        Pixel::Blind => ' ',
    };
    found.chunks(width as usize).map(|row| row.iter().map(letter).collect()).collect()
}

#[test]
fn blind_pixels_go_with_the_nearest_of_their_label() {
    assert_eq!(closed(&["c  o"], &["1111"]), ["cc o"]);
    assert_eq!(closed(&["c  o"], &["1121"]), ["cc o"], "one of another label does not");
    assert_eq!(closed(&["c   "], &["2111"]), ["c   "]);
}

#[test]
fn holes_without_a_label_are_closed_and_open_ones_are_not() {
    let ring = ["ccccccccc", "c       c", "c       c", "c       c", "c       c", "c       c", "ccccccccc"];
    let labels = ["111111111", "100000001", "100000001", "100000001", "100000001", "100000001", "111111111"];
    assert!(closed(&ring, &labels).iter().all(|row| row == "ccccccccc"));
    let (mut open, mut unlabelled) = (ring, labels);
    (open[3], unlabelled[3]) = ("c        ", "100000000");
    assert_eq!(closed(&open, &unlabelled), open);
    let mut around = ring;
    around[3] = "c   o   c";
    assert_eq!(closed(&around, &labels), around, "what sees something else stays");
}
