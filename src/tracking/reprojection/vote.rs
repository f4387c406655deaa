use std::collections::BTreeMap;
use std::sync::Arc;

use super::depth_view::{DepthView, PixelBox, Reprojection};
use super::draw::{NearestSurface, draw};
use super::keyframe::Keyframe;
use super::options::{ReprojectionOptions, Tolerance};
use ostra_core::job::{Progress, Stopped};
use ostra_masks::LabelId;

/// Votes of the selected keyframes on one target.
#[derive(Debug)]
pub struct KeyframeVotes {
    pub width: usize,
    pub height: usize,
    pub of_keyframes: Vec<(Arc<Keyframe>, ViewLabels)>,
}

impl KeyframeVotes {
    /// Returns the bounding box of the pixels of each label.
    pub fn boxes(&self) -> BTreeMap<LabelId, PixelBox> {
        let mut boxes: BTreeMap<LabelId, PixelBox> = BTreeMap::new();
        for (_, view_labels) in &self.of_keyframes {
            for at in 0..self.width * self.height {
                let Some((label, _)) = view_labels
                    .at(at)
                    .filter(|&(label, _)| label != LabelId::NONE)
                else {
                    continue;
                };
                let pixel = PixelBox::pixel(at % self.width, at / self.width);
                boxes
                    .entry(label)
                    .and_modify(|around| *around = around.union(&pixel))
                    .or_insert(pixel);
            }
        }
        boxes
    }

    /// Returns the weight for `shown` at a pixel and the total weight.
    ///
    /// Only keyframes with evidence about `label` there count.
    pub fn at(&self, pixel: usize, label: LabelId, shown: LabelId) -> [f32; 2] {
        let mut sums = [0.0; 2];
        for (keyframe, view_labels) in &self.of_keyframes {
            if let Some((seen, by)) = view_labels
                .at(pixel)
                .filter(|&(seen, _)| keyframe.bears_on(label, seen))
            {
                sums[0] += if seen == shown { by } else { 0.0 };
                sums[1] += by;
            }
        }
        sums
    }

    /// Returns, per pixel of a box, the weights for `label` minus those against, and their sum.
    ///
    /// A keyframe that shows background on a surface counts as much as one that shows a label. With
    /// a weight of 0.3 for it, mean label accuracy on three synthetic plants (sensor depth and
    /// stereo depth) rises from 0.940 to 0.945. But the 3-D IoU of four objects on a real shelf,
    /// clicked in two ways, falls in seven of eight cases (mean 0.754 to 0.747). Two keyframes can
    /// then no longer outvote a leak of one, and outlines without edges grow.
    pub fn of(&self, label: LabelId, within: PixelBox) -> Vec<[f32; 2]> {
        let mut votes = vec![[0.0; 2]; within.width() * within.height()];
        for (keyframe, view_labels) in &self.of_keyframes {
            for (y, row) in (within.top..within.bottom).zip(votes.chunks_exact_mut(within.width()))
            {
                for (x, [balance, weight]) in (within.left..within.right).zip(row) {
                    let Some((seen, by)) = view_labels.at(y * self.width + x) else {
                        continue;
                    };
                    if keyframe.bears_on(label, seen) {
                        *balance += if seen == label { by } else { -by };
                        *weight += by;
                    }
                }
            }
        }
        votes
    }
}

/// A keyframe and the target that it votes on.
pub struct VoteRequest<'a> {
    pub keyframe: &'a Keyframe,
    pub target: &'a DepthView,
    pub tolerance: Tolerance,
    pub options: &'a ReprojectionOptions,
    pub progress: &'a Progress,
}

/// Computes a keyframe's labels of a target's pixels.
///
/// Pixels with depth are looked up in the keyframe, which votes if its depth agrees. Where the
/// target has no depth, the keyframe's surfaces are drawn into it and into the holes of `drawn`.
pub fn ask(request: &VoteRequest<'_>, drawn: &mut [f32]) -> Result<ViewLabels, Stopped> {
    let mut view_labels = ViewLabels::none(request.target.rays.len());
    look_up(request, &mut view_labels)?;
    draw_in_holes(request, drawn, &mut view_labels)?;
    Ok(view_labels)
}

fn look_up(request: &VoteRequest<'_>, view_labels: &mut ViewLabels) -> Result<(), Stopped> {
    let (keyframe, target) = (request.keyframe, request.target);
    let reprojection = Reprojection::new(&target.posed, &keyframe.view.posed);
    for at in 0..target.rays.len() {
        if at % 16384 == 0 {
            request.progress.check()?;
        }
        let Some(point) = target.point(at) else {
            continue;
        };
        let moved = reprojection.transform(point);
        let Some(px) = reprojection.pixel(moved) else {
            continue;
        };
        let (x, y) = (px.x as usize, px.y as usize);
        match surface_at(&keyframe.view, x, y, moved.z, &request.tolerance) {
            DepthTest::Surface(hit, agreement) => {
                let nearness = (point.z / moved.z).min(1.0);
                view_labels.set(
                    at,
                    keyframe.mask.ids[hit],
                    agreement * nearness * keyframe.trust[hit],
                );
            }
            DepthTest::Behind => view_labels.set_through(at),
            DepthTest::Nothing => {}
        }
    }
    Ok(())
}

fn draw_in_holes(
    request: &VoteRequest<'_>,
    depths: &mut [f32],
    view_labels: &mut ViewLabels,
) -> Result<(), Stopped> {
    let (keyframe, target) = (request.keyframe, request.target);
    let mut canvas = vec![NearestSurface::NOTHING; target.rays.len()];
    draw(&keyframe.view, target, &mut canvas, request.progress)?;
    for (at, drawn) in canvas.iter().enumerate() {
        if drawn.depth < f32::INFINITY && target.depth.depths[at] <= 0.0 {
            let from = drawn.from as usize;
            depths[at] = if depths[at] > 0.0 {
                depths[at].min(drawn.depth)
            } else {
                drawn.depth
            };
            view_labels.set(
                at,
                keyframe.mask.ids[from],
                request.options.drawn_weight * keyframe.trust[from],
            );
        }
    }
    Ok(())
}

/// What a view sees at the position of another view's surface.
enum DepthTest {
    /// The surface: its pixel, and the depth agreement, 0–1.
    Surface(usize, f32),
    /// Only farther surfaces: the position is empty.
    Behind,
    /// A surface in front, or no depth.
    Nothing,
}

/// Finds the pixel at or next to (`x`, `y`) whose surface lies at depth `z`.
///
/// The neighbours are needed on slanted surfaces and at outlines, where depth and image are
/// misaligned by a pixel.
fn surface_at(view: &DepthView, x: usize, y: usize, z: f32, tolerance: &Tolerance) -> DepthTest {
    let (width, height) = (view.width(), view.height());
    let limit = tolerance.at(z);
    let depth = &view.depth.depths;
    let off = |at: usize| {
        if depth[at] > 0.0 {
            (depth[at] - z).abs()
        } else {
            f32::INFINITY
        }
    };
    let here = y * width + x;
    let (mut best, mut least, mut share) = (here, off(here), 1.0);
    let mut is_behind = true;
    if least > limit {
        let columns = x.saturating_sub(1)..(x + 2).min(width);
        let rows = y.saturating_sub(1)..(y + 2).min(height);
        for at in rows.flat_map(|row| columns.clone().map(move |column| row * width + column)) {
            is_behind &= depth[at] > z + limit;
            if off(at) < least {
                (best, least, share) = (at, off(at), 0.5);
            }
        }
    }
    let ratio = least / limit;
    match (ratio <= 1.0, is_behind) {
        (true, _) => DepthTest::Surface(best, share * (1.0 - 0.75 * ratio * ratio)),
        (false, true) => DepthTest::Behind,
        (false, false) => DepthTest::Nothing,
    }
}

/// Labels and weights of one keyframe for every pixel of a target.
#[derive(Debug, Clone)]
pub struct ViewLabels {
    packed: Vec<u32>,
}

/// Number of weight steps per unit.
const STEPS: f32 = 65535.0;
/// Marks a pixel whose surface the keyframe sees through: a label without weight.
const THROUGH: u32 = 0xffff_0000;

impl ViewLabels {
    /// Creates a map without any votes.
    pub fn none(pixels: usize) -> Self {
        Self {
            packed: vec![0; pixels],
        }
    }

    /// Returns the label of a pixel (0 = background) and its weight, above 0 and up to 1.
    ///
    /// Returns `None` if the keyframe does not see the pixel's surface.
    pub fn at(&self, pixel: usize) -> Option<(LabelId, f32)> {
        let packed = self.packed[pixel];
        (packed & 0xffff != 0).then(|| {
            (
                LabelId((packed >> 16) as u16),
                (packed & 0xffff) as f32 / STEPS,
            )
        })
    }

    /// Returns whether the keyframe sees through the pixel's surface.
    pub fn is_through(&self, pixel: usize) -> bool {
        self.packed[pixel] == THROUGH
    }

    /// Records that the keyframe sees through the pixel's surface.
    pub fn set_through(&mut self, pixel: usize) {
        self.packed[pixel] = THROUGH;
    }

    /// Records the label of a pixel with its weight.
    pub fn set(&mut self, pixel: usize, label: LabelId, weight: f32) {
        let steps = (weight.clamp(0.0, 1.0) * STEPS).max(1.0) as u32;
        self.packed[pixel] = u32::from(label.0) << 16 | steps;
    }
}

/// Votes of the keyframes on a frame.
#[derive(Debug)]
pub(crate) struct ReprojectedLabels {
    /// The frame.
    pub target: DepthView,
    /// Depths of the frame, with holes filled from keyframes.
    pub depths: Vec<f32>,
    pub votes: KeyframeVotes,
}

impl ReprojectedLabels {
    /// Returns the label that the keyframes agree on at a pixel; 0 is background.
    ///
    /// Only keyframes with a surface at the frame's depth vote. The label must win at least `share`
    /// of their weights, which must sum to at least `weight`. Returns `None` if no label does, or
    /// if the frame has no depth. Background counts only by the keyframes that have evidence about
    /// `held`, the pixel's current label.
    pub fn verdict(&self, pixel: usize, held: LabelId, share: f32, weight: f32) -> Option<LabelId> {
        if self.target.depth.depths[pixel] <= 0.0 {
            return None;
        }
        let is_confident = |label: LabelId, shown: LabelId| {
            let [own, all] = self.votes.at(pixel, label, shown);
            all >= weight && own >= share * all
        };
        let seen = self
            .votes
            .of_keyframes
            .iter()
            .filter_map(|(_, view_labels)| Some(view_labels.at(pixel)?.0));
        let named = seen
            .filter(|&label| label != LabelId::NONE)
            .find(|&label| is_confident(label, label));
        named.or_else(|| is_confident(held, LabelId::NONE).then_some(LabelId::NONE))
    }

    /// Returns whether something new has appeared at a pixel.
    ///
    /// This is the case if a keyframe sees through the pixel's surface, and none has a surface at
    /// that place.
    pub fn is_new(&self, pixel: usize) -> bool {
        let view_labels = || {
            self.votes
                .of_keyframes
                .iter()
                .map(|(_, view_labels)| view_labels)
        };
        view_labels().any(|seen| seen.is_through(pixel))
            && view_labels().all(|seen| seen.at(pixel).is_none())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn votes_and_seen_through_pixels_are_distinguished() {
        let mut view_labels = ViewLabels::none(3);
        view_labels.set(0, LabelId(u16::MAX), 1e-9);
        view_labels.set_through(1);
        assert!(
            view_labels
                .at(0)
                .is_some_and(|(label, weight)| label == LabelId(u16::MAX) && weight > 0.0)
        );
        assert_eq!((view_labels.at(1), view_labels.at(2)), (None, None));
        assert_eq!(
            [0, 1, 2].map(|pixel| view_labels.is_through(pixel)),
            [false, true, false]
        );
    }
}
