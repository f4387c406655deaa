use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use glam::Vec3;

use super::depth_leak::DepthLeak;
use super::depth_view::{CalibratedView, DepthView, DepthViews, Reprojection};
use super::draw::DepthCompletion;
use super::options::{ReprojectionOptions, Tolerance};
use ostra_core::job::Progress;
use ostra_frames::DepthMap;
use ostra_masks::{LabelId, LabelMask, MaskError};

/// A keyframe with its depth and mask, prepared for votes.
#[derive(Debug)]
pub struct Keyframe {
    /// Camera and depth; holes in the depth are filled from other frames.
    pub view: DepthView,
    pub mask: Arc<LabelMask>,
    /// Labels of the mask, ascending.
    pub labels: Vec<LabelId>,
    /// Trust in each pixel's label, 0–1.
    pub trust: Vec<f32>,
}

impl Keyframe {
    /// Prepares a keyframe; `filled` is the depth of `own` with its holes filled.
    pub fn new(
        own: DepthView,
        filled: DepthMap,
        mask: Arc<LabelMask>,
        options: &ReprojectionOptions,
    ) -> Self {
        let mut trust = border_trust(&mask, options);
        for (at, trust) in trust.iter_mut().enumerate() {
            let filled = if own.depth.depths[at] > 0.0 {
                1.0
            } else {
                options.filled_weight
            };
            *trust *= filled * facing(&own, at).max(options.grazing_weight);
        }
        Self {
            view: DepthView {
                depth: Arc::new(filled),
                ..own
            },
            labels: labels_of(&mask),
            mask,
            trust,
        }
    }

    /// Returns whether showing `seen` somewhere is evidence for or against `label` there.
    ///
    /// A keyframe without the label counts against it only where it shows another label: the object
    /// may not have been annotated in it.
    pub fn bears_on(&self, label: LabelId, seen: LabelId) -> bool {
        seen != LabelId::NONE || label == LabelId::NONE || self.labels.binary_search(&label).is_ok()
    }
}

/// Returns the labels of a mask, ascending, without 0.
pub fn labels_of(mask: &LabelMask) -> Vec<LabelId> {
    let runs = mask.ids.chunk_by(|a, b| a == b).map(|run| run[0]);
    runs.filter(|&id| id != LabelId::NONE)
        .collect::<BTreeSet<_>>()
        .into_iter()
        .collect()
}

/// Returns weights that grow with the distance from label borders.
///
/// At a border, mask, image and depth are misaligned by a few pixels.
fn border_trust(mask: &LabelMask, options: &ReprojectionOptions) -> Vec<f32> {
    let border = options.border_px;
    let weight = |d: u8| {
        options.border_weight
            + (1.0 - options.border_weight) * f32::from(d) / f32::from(border.max(1))
    };
    let weights: [f32; 256] =
        std::array::from_fn(|d| if border == 0 { 1.0 } else { weight(d as u8) });
    border_distance(mask, border)
        .into_iter()
        .map(|d| weights[usize::from(d)])
        .collect()
}

/// Returns the steps to the nearest pixel at a label border, up to `most`.
fn border_distance(mask: &LabelMask, most: u8) -> Vec<u8> {
    let width = mask.width as usize;
    let mut distance = vec![most; mask.ids.len()];
    for at in 0..mask.ids.len() {
        let right = ((at + 1) % width != 0).then_some(at + 1);
        let below = (at + width < mask.ids.len()).then_some(at + width);
        for next in [right, below]
            .into_iter()
            .flatten()
            .filter(|&next| mask.ids[next] != mask.ids[at])
        {
            (distance[at], distance[next]) = (0, 0);
        }
    }
    for at in 0..distance.len() {
        let left = if at % width == 0 {
            most
        } else {
            distance[at - 1]
        };
        let above = if at < width {
            most
        } else {
            distance[at - width]
        };
        distance[at] = distance[at].min(left.min(above).saturating_add(1));
    }
    for at in (0..distance.len()).rev() {
        let right = if (at + 1) % width == 0 {
            most
        } else {
            distance[at + 1]
        };
        let below = if at + width >= distance.len() {
            most
        } else {
            distance[at + width]
        };
        distance[at] = distance[at].min(right.min(below).saturating_add(1));
    }
    distance
}

/// Returns the cosine between surface normal and viewing direction.
///
/// It is computed from the slope of the depth; 1 where the slope is unknown.
fn facing(view: &DepthView, at: usize) -> f32 {
    let (width, height) = (view.width(), view.height());
    let depth = &view.depth.depths;
    let (x, y, here) = (at % width, at / width, depth[at]);
    if x == 0 || y == 0 || x + 1 >= width || y + 1 >= height || here <= 0.0 {
        return 1.0;
    }
    let slope = |a: f32, b: f32| {
        if a > 0.0 && b > 0.0 {
            0.5 * (b - a) / here
        } else {
            0.0
        }
    };
    let focal = view.posed.camera.focal_px.as_vec2();
    let across = focal.x * slope(depth[at - 1], depth[at + 1]);
    let down = focal.y * slope(depth[at - width], depth[at + width]);
    (1.0 + across * across + down * down).sqrt().recip()
}

/// A keyframe of the request, before its depth is loaded.
#[derive(Debug)]
pub struct GivenKeyframe<'a> {
    pub frame: usize,
    pub posed: CalibratedView,
    /// Labels of its mask, ascending.
    pub labels: Vec<LabelId>,
    pub mask: &'a Arc<LabelMask>,
}

/// Approximate memory limit of prepared keyframes, in bytes.
const BUDGET_BYTES: usize = 192 << 20;

type KeyframeSlot = Arc<Mutex<Option<Arc<Keyframe>>>>;

/// Cache of the latest prepared keyframes.
///
/// One thread prepares a keyframe while others wait for it.
#[derive(Debug)]
pub struct KeyframeCache<'a> {
    views: &'a DepthViews<'a>,
    options: &'a ReprojectionOptions,
    slots: Mutex<(BTreeMap<usize, KeyframeSlot>, VecDeque<usize>)>,
}

impl<'a> KeyframeCache<'a> {
    pub fn new(views: &'a DepthViews<'a>, options: &'a ReprojectionOptions) -> Self {
        Self {
            views,
            options,
            slots: Mutex::default(),
        }
    }

    /// Returns the keyframe and prepares it if needed; `None` if its depth cannot be read.
    pub fn get(
        &self,
        given: &GivenKeyframe<'_>,
        progress: &Progress,
    ) -> Result<Option<Arc<Keyframe>>, MaskError> {
        let slot = self.slot(given.frame, given.mask.ids.len());
        let mut slot = lock(&slot);
        if let Some(keyframe) = &*slot {
            return Ok(Some(keyframe.clone()));
        }
        let keyframe = self.make(given, progress)?.map(Arc::new);
        slot.clone_from(&keyframe);
        Ok(keyframe)
    }

    /// Returns the slot of a keyframe; a new one replaces the oldest.
    fn slot(&self, frame: usize, pixels: usize) -> KeyframeSlot {
        let mut slots = lock(&self.slots);
        let (of_frame, order) = &mut *slots;
        if let Some(slot) = of_frame.get(&frame) {
            return slot.clone();
        }
        let most = BUDGET_BYTES / (2 * size_of::<f32>() * pixels.max(1));
        while order.len() >= most.max(4) {
            order
                .pop_front()
                .and_then(|oldest| of_frame.remove(&oldest));
        }
        order.push_back(frame);
        of_frame.entry(frame).or_default().clone()
    }

    /// Removes background leaks from the keyframe's depth and fills its holes from other frames.
    ///
    /// Frames that cannot be read are skipped.
    fn make(
        &self,
        given: &GivenKeyframe<'_>,
        progress: &Progress,
    ) -> Result<Option<Keyframe>, MaskError> {
        let Some(seen) = self.views.load(given.frame)? else {
            return Ok(None);
        };
        let tolerance = Tolerance::most(&seen, self.options);
        let leak = DepthLeak::find(&seen, given.mask, tolerance);
        let own = DepthView {
            depth: Arc::new(leak.without_leaks(&seen.depth)),
            ..seen
        };
        let mut completion = DepthCompletion::new(&own, tolerance);
        let others = self
            .views
            .calibrated_views()
            .filter(|&(frame, _)| frame != given.frame);
        for filler in fillers_for(&own, others, self.options.fillers) {
            if let Some(filler) = self.views.load(filler)? {
                completion.add(&filler, progress)?;
            }
        }
        let mut filled = completion.finish();
        leak.check(&mut filled);
        Ok(Some(Keyframe::new(
            own,
            filled,
            given.mask.clone(),
            self.options,
        )))
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Number of sample points along each side of a frame for overlap estimates.
const GRID: usize = 16;

/// Selects the keyframes that vote on a target, as indices into `anchors`.
///
/// For every label these are the `most` keyframes that overlap most with the target, weighted by
/// proximity and similar viewing direction.
pub fn keyframes_for(
    target: &DepthView,
    keyframes: &[(CalibratedView, &[LabelId])],
    most: usize,
) -> Vec<usize> {
    let points = target.grid(GRID);
    let overlap: Vec<f32> = keyframes
        .iter()
        .map(|(posed, _)| overlap(&target.posed, &points, posed))
        .collect();
    let mut of_label: BTreeMap<LabelId, Vec<usize>> = BTreeMap::new();
    for place in (0..keyframes.len()).filter(|&place| overlap[place] > 0.0) {
        for &label in keyframes[place].1 {
            of_label.entry(label).or_default().push(place);
        }
    }
    let mut chosen: Vec<usize> = Vec::new();
    for mut places in of_label.into_values() {
        places.sort_by(|&a, &b| overlap[b].total_cmp(&overlap[a]).then(a.cmp(&b)));
        chosen.extend(places.iter().take(most));
    }
    chosen.sort_unstable();
    chosen.dedup();
    chosen
}

/// Selects up to `most` frames that see the same surfaces as `view`.
///
/// They range from the most similar direction to the most different one, because a hole is often
/// seen well from far to the side.
pub fn fillers_for(
    view: &DepthView,
    frames: impl Iterator<Item = (usize, CalibratedView)>,
    most: usize,
) -> Vec<usize> {
    let points = view.grid(GRID);
    let mut seen: Vec<(f32, usize)> = frames
        .map(|(frame, posed)| (overlap(&view.posed, &points, &posed), frame))
        .filter(|&(o, _)| o > 0.3)
        .collect();
    seen.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let count = most.min(seen.len());
    (0..count).map(|i| seen[i * seen.len() / count].1).collect()
}

/// Returns the share of a frame's points that lie in another frame's image.
///
/// Points are weighted by proximity and by the similarity of the viewing directions.
fn overlap(from: &CalibratedView, points: &[Vec3], to: &CalibratedView) -> f32 {
    let reprojection = Reprojection::new(from, to);
    let weight = |&point: &Vec3| {
        let moved = reprojection.transform(point);
        reprojection.pixel(moved)?;
        let alike = reprojection.turn(point).normalize().dot(moved.normalize());
        Some(alike.max(0.0) * (point.z / moved.z).min(1.0))
    };
    points.iter().filter_map(weight).sum::<f32>() / points.len().max(1) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn label_borders_have_less_trust() {
        let mut mask = LabelMask::empty(9, 5);
        mask.ids
            .iter_mut()
            .enumerate()
            .filter(|(at, _)| at % 9 < 4)
            .for_each(|(_, id)| *id = LabelId(7));
        let row: Vec<u8> = border_distance(&mask, 3)[18..27].to_vec();
        assert_eq!(row, [3, 2, 1, 0, 0, 1, 2, 3, 3]);
        let trust = border_trust(
            &mask,
            &ReprojectionOptions {
                border_weight: 0.25,
                border_px: 3,
                ..ReprojectionOptions::default()
            },
        );
        assert_eq!((trust[18], trust[21], trust[20]), (1.0, 0.25, 0.5));
        assert!(
            border_trust(
                &mask,
                &ReprojectionOptions {
                    border_px: 0,
                    ..ReprojectionOptions::default()
                }
            )
            .iter()
            .all(|&t| t == 1.0)
        );
        assert_eq!(labels_of(&mask), [LabelId(7)]);
    }
}
