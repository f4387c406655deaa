use std::collections::{BTreeMap, BTreeSet, VecDeque};

use rayon::prelude::*;

use crate::reprojection::{ReprojectedLabels, ReprojectionOptions};
use ostra_cloud::conflicts::{ObservedLabels, mask_has_near};
use ostra_masks::{Connectivity, LabelId, LabelMask, MaskError, Region, WalkedFrame, components};

/// Options of the check of masks against geometry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConsistencyOptions {
    /// Options of the re-projection of the keyframes' masks.
    pub transfer: ReprojectionOptions,
    /// Minimum share of the keyframes' weights for geometry to be confident of a label, 0.5–1.
    pub confident_share: f32,
    /// Minimum sum of these weights; > 0.
    ///
    /// A keyframe that faces the surface from the same distance has weight 1.
    pub least_weight: f32,
    /// Maximum border difference, in pixels, at which the tracker's border is kept.
    pub border_px: u32,
    /// Minimum size of a correction in connected pixels.
    ///
    /// An object that is contradicted in fewer pixels has not drifted.
    pub least_area: usize,
    /// Frames that a pass must advance after a restart before the next restart.
    pub rest: usize,
}

impl Default for ConsistencyOptions {
    fn default() -> Self {
        Self {
            transfer: ReprojectionOptions::default(),
            confident_share: 0.75,
            least_weight: 1e-3,
            border_px: 3,
            least_area: 25,
            rest: 5,
        }
    }
}

/// A tracker's mask after the check against geometry.
pub struct CheckedMask {
    pub walked: WalkedFrame,
    /// Number of pixels whose label was changed.
    pub corrected: usize,
    /// Whether an object is mostly elsewhere than in the tracker's mask.
    pub has_drifted: bool,
}

impl CheckedMask {
    /// Wraps a mask that needs no correction.
    pub fn untouched(walked: WalkedFrame) -> Self {
        Self {
            walked,
            corrected: 0,
            has_drifted: false,
        }
    }
}

/// Checks a tracker's mask against geometry.
///
/// `carried` computes the frame's mask by geometry alone. It shows where objects that drifted are
/// visible, including pixels next to the confident ones. It is called only if an object drifted.
///
/// # Errors
/// Returns the error of `carried`.
pub fn check_mask(
    tracked: WalkedFrame,
    evidence: &ReprojectedLabels,
    options: &ConsistencyOptions,
    transferred: impl FnOnce() -> Result<Option<LabelMask>, MaskError>,
) -> Result<CheckedMask, MaskError> {
    let observed = judge(evidence, &tracked.mask, options);
    let found = MaskConflicts::find(&tracked.mask, &observed, options);
    if found.touched.is_empty() {
        return Ok(CheckedMask::untouched(tracked));
    }
    let mut mask = tracked.mask.clone();
    for (id, given) in mask.ids.iter_mut().zip(&found.given) {
        *id = given.unwrap_or(*id);
    }
    spread(&mut mask, &tracked.mask, &observed, &found, options);
    if !found.drifted.is_empty()
        && let Some(transferred) = transferred()?
    {
        complete(&mut mask, &transferred, &observed, &found);
    }
    let corrected = mask
        .ids
        .iter()
        .zip(&tracked.mask.ids)
        .filter(|(now, before)| now != before)
        .count();
    let confidence = confidence(&mask, &observed, &found.touched, tracked.confidence);
    Ok(CheckedMask {
        walked: WalkedFrame { mask, confidence },
        corrected,
        has_drifted: !found.drifted.is_empty(),
    })
}

/// Adds pixels of the re-projected mask to drifted objects.
///
/// Only pixels without a label are added, and only where geometry is not confident.
fn complete(
    mask: &mut LabelMask,
    transferred: &LabelMask,
    observed: &ObservedLabels,
    found: &MaskConflicts,
) {
    for ((id, &transferred), verdict) in mask
        .ids
        .iter_mut()
        .zip(&transferred.ids)
        .zip(&observed.labels)
    {
        if *id == LabelId::NONE && verdict.is_none() && found.drifted.contains_key(&transferred) {
            *id = transferred;
        }
    }
}

/// Returns the confidence of each label.
///
/// An uncorrected label keeps the tracker's confidence. A corrected one gets the share of its
/// pixels that geometry confirms.
fn confidence(
    mask: &LabelMask,
    observed: &ObservedLabels,
    touched: &BTreeSet<LabelId>,
    tracked: BTreeMap<LabelId, f32>,
) -> BTreeMap<LabelId, f32> {
    let mut counts: BTreeMap<LabelId, [usize; 2]> = BTreeMap::new();
    for (&label, &verdict) in mask
        .ids
        .iter()
        .zip(&observed.labels)
        .filter(|&(label, _)| touched.contains(label))
    {
        let [confirmed, all] = counts.entry(label).or_default();
        *confirmed += usize::from(verdict == Some(label));
        *all += 1;
    }
    let mut confidence = tracked;
    confidence.retain(|label, _| !touched.contains(label));
    confidence.extend(
        counts
            .into_iter()
            .map(|(label, [confirmed, all])| (label, confirmed as f32 / all as f32)),
    );
    confidence
}

/// Returns the confident label of geometry for each pixel of a tracker's mask.
///
/// It is `None` where geometry abstains: without depth, where keyframes do not see the surface or
/// disagree about it, and for objects that moved.
fn judge(
    evidence: &ReprojectedLabels,
    tracked: &LabelMask,
    options: &ConsistencyOptions,
) -> ObservedLabels {
    let verdict = |(at, &held): (usize, &LabelId)| {
        evidence.verdict(at, held, options.confident_share, options.least_weight)
    };
    let labels: Vec<Option<LabelId>> = tracked.ids.par_iter().enumerate().map(verdict).collect();
    let mut observed = ObservedLabels {
        width: tracked.width,
        height: tracked.height,
        labels,
    };
    let moved = moved(evidence, tracked, &observed, options);
    if !moved.is_empty() {
        for (verdict, held) in observed.labels.iter_mut().zip(&tracked.ids) {
            *verdict = verdict.filter(|label| !moved.contains(label) && !moved.contains(held));
        }
    }
    observed
}

/// Returns the labels of objects that have moved since the keyframes.
///
/// The tracker sees such an object where keyframes saw empty space, in more pixels than geometry
/// confirms in place.
fn moved(
    evidence: &ReprojectedLabels,
    tracked: &LabelMask,
    observed: &ObservedLabels,
    options: &ConsistencyOptions,
) -> BTreeSet<LabelId> {
    let mut counts: BTreeMap<LabelId, [usize; 2]> = BTreeMap::new();
    for (at, (&held, verdict)) in tracked.ids.iter().zip(&observed.labels).enumerate() {
        if let Some(label) = verdict.filter(|&label| label != LabelId::NONE) {
            counts.entry(label).or_default()[1] += 1;
        }
        if held != LabelId::NONE && evidence.is_new(at) {
            counts.entry(held).or_default()[0] += 1;
        }
    }
    let has_moved =
        |&(_, [new, in_place]): &(LabelId, [usize; 2])| new >= options.least_area && new > in_place;
    counts
        .into_iter()
        .filter(has_moved)
        .map(|(label, _)| label)
        .collect()
}

/// Pixels where geometry contradicts a mask, except for small border differences.
struct MaskConflicts {
    /// Label that geometry assigns to each contradicted pixel, 0 = none; `None` elsewhere.
    pub given: Vec<Option<LabelId>>,
    /// Labels that lost or gained pixels.
    pub touched: BTreeSet<LabelId>,
    /// Objects that geometry sees mostly elsewhere, with the label that most pixels get.
    ///
    /// They were swapped with others, drifted away or were lost.
    pub drifted: BTreeMap<LabelId, LabelId>,
}

/// A label in a mask, and the different label of geometry at the same pixel.
type LabelPair = (LabelId, LabelId);

impl MaskConflicts {
    pub fn find(mask: &LabelMask, observed: &ObservedLabels, options: &ConsistencyOptions) -> Self {
        let is_core: Vec<bool> = (0..mask.ids.len())
            .into_par_iter()
            .map(|at| is_beyond_borders(mask, observed, at, options.border_px))
            .collect();
        let pair = |at: usize| Some((mask.ids[at], observed.labels[at]?));
        let mut cores: BTreeMap<LabelPair, usize> = BTreeMap::new();
        (0..is_core.len())
            .filter(|&at| is_core[at])
            .filter_map(pair)
            .for_each(|pair| *cores.entry(pair).or_default() += 1);
        let drifted = drifted(mask, observed, &cores, options);
        let (mut given, mut touched) = (vec![None; mask.ids.len()], BTreeSet::new());
        for &(held, label) in cores.keys() {
            let inside = (0..mask.ids.len())
                .map(|at| pair(at) == Some((held, label)))
                .collect();
            let patches = components(
                &Region {
                    width: mask.width,
                    height: mask.height,
                    inside,
                },
                Connectivity::Eight,
            );
            let mut of_patches = vec![0; patches.areas.len() + 1];
            patches
                .labels
                .iter()
                .zip(&is_core)
                .for_each(|(&at, &core)| of_patches[at as usize] += usize::from(core));
            let has_drifted = drifted.contains_key(&held) || drifted.contains_key(&label);
            let least = if has_drifted { 1 } else { options.least_area };
            for (given, &patch) in given.iter_mut().zip(&patches.labels) {
                if patch > 0 && of_patches[patch as usize] >= least {
                    *given = Some(label);
                    touched.extend([held, label]);
                }
            }
        }
        touched.remove(&LabelId::NONE);
        Self {
            given,
            touched,
            drifted,
        }
    }
}

/// Returns whether mask and geometry differ at a pixel by more than a border shift.
///
/// This is the case if one of them does not have the other's label nearby.
fn is_beyond_borders(
    mask: &LabelMask,
    observed: &ObservedLabels,
    at: usize,
    border_px: u32,
) -> bool {
    let held = mask.ids[at];
    observed.labels[at].is_some_and(|label| {
        label != held
            && (!mask_has_near(mask, at, border_px, label)
                || !observed.has_near(at, border_px, held))
    })
}

/// Returns the labels that are contradicted in more pixels than they agree in.
///
/// Each is returned with the label that takes most of its pixels.
fn drifted(
    mask: &LabelMask,
    observed: &ObservedLabels,
    cores: &BTreeMap<LabelPair, usize>,
    options: &ConsistencyOptions,
) -> BTreeMap<LabelId, LabelId> {
    let mut agreed: BTreeMap<LabelId, usize> = BTreeMap::new();
    let both = mask
        .ids
        .iter()
        .zip(&observed.labels)
        .filter(|&(&held, &label)| label == Some(held));
    both.for_each(|(&held, _)| *agreed.entry(held).or_default() += 1);
    let labels: BTreeSet<LabelId> = cores
        .keys()
        .flat_map(|&(held, label)| [held, label])
        .collect();
    let has_drifted = |label: &LabelId| {
        let of_label = cores
            .iter()
            .filter(|&(&(held, given), _)| held == *label || given == *label);
        let vote_mismatch: usize = of_label.map(|(_, count)| count).sum();
        vote_mismatch >= options.least_area
            && vote_mismatch > agreed.get(label).copied().unwrap_or(0)
    };
    let taken_by = |label: LabelId| {
        let taken = cores.iter().filter(|&(&(held, _), _)| held == label);
        taken
            .max_by_key(|&(_, count)| count)
            .map_or(LabelId::NONE, |(&(_, given), _)| given)
    };
    let labels = labels
        .into_iter()
        .filter(|&label| label != LabelId::NONE)
        .filter(has_drifted);
    labels.map(|label| (label, taken_by(label))).collect()
}

/// Extends corrections to pixels where geometry is not confident.
///
/// Each pixel follows the nearest confident pixel of the same object: over a few steps in corrected
/// objects, over any distance in drifted ones. Detached parts of a drifted object get the label
/// that most of the object gets. `mask` is the result of the correction of `tracked` so far.
fn spread(
    mask: &mut LabelMask,
    tracked: &LabelMask,
    observed: &ObservedLabels,
    found: &MaskConflicts,
    options: &ConsistencyOptions,
) {
    let (width, count) = (mask.width as usize, mask.ids.len());
    let mut steps = vec![u32::MAX; count];
    let is_start =
        |&at: &usize| found.touched.contains(&tracked.ids[at]) && observed.labels[at].is_some();
    let mut open: VecDeque<usize> = (0..count).filter(is_start).collect();
    open.iter().for_each(|&at| steps[at] = 0);
    while let Some(at) = open.pop_front() {
        let object = tracked.ids[at];
        if steps[at] >= options.border_px && !found.drifted.contains_key(&object) {
            continue;
        }
        let adjacent = [
            (at % width > 0).then(|| at - 1),
            (at % width + 1 < width).then(|| at + 1),
            at.checked_sub(width),
            (at + width < count).then(|| at + width),
        ];
        for next in adjacent.into_iter().flatten() {
            if tracked.ids[next] == object && steps[next] == u32::MAX {
                steps[next] = steps[at] + 1;
                mask.ids[next] = mask.ids[at];
                open.push_back(next);
            }
        }
    }
    let detached = (0..count).filter(|&at| steps[at] == u32::MAX);
    for (at, &label) in detached.filter_map(|at| Some((at, found.drifted.get(&tracked.ids[at])?))) {
        mask.ids[at] = label;
    }
}
