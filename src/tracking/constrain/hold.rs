use std::collections::{BTreeMap, BTreeSet};

use super::contradiction::Contradictions;
use super::judge::judge;
use super::options::ConstrainOptions;
use super::spread::spread;
use crate::carry::Testimony;
use ostra_cloud::doubt::Sighted;
use ostra_masks::{LabelId, LabelMask, MaskError, WalkedFrame};

/// A tracker's answer after it was held against geometry.
pub struct Held {
    pub walked: WalkedFrame,
    /// Pixels that have another label now.
    pub mended: usize,
    /// Whether an object is mostly elsewhere than the tracker had it.
    pub has_strayed: bool,
}

impl Held {
    /// An answer that stands.
    pub fn untouched(walked: WalkedFrame) -> Self {
        Self {
            walked,
            mended: 0,
            has_strayed: false,
        }
    }
}

/// Holds a tracker's answer against geometry. `carried` makes the mask of the frame by geometry alone, which shows where
/// objects that strayed are seen, also beside what is sure; it is asked for only where there are any.
///
/// # Errors
/// What `carried` says.
pub fn hold(
    tracked: WalkedFrame,
    testimony: &Testimony,
    options: &ConstrainOptions,
    carried: impl FnOnce() -> Result<Option<LabelMask>, MaskError>,
) -> Result<Held, MaskError> {
    let sighted = judge(testimony, &tracked.mask, options);
    let found = Contradictions::find(&tracked.mask, &sighted, options);
    if found.touched.is_empty() {
        return Ok(Held::untouched(tracked));
    }
    let mut mask = tracked.mask.clone();
    for (id, given) in mask.ids.iter_mut().zip(&found.given) {
        *id = given.unwrap_or(*id);
    }
    spread(&mut mask, &tracked.mask, &sighted, &found, options);
    if !found.strayed.is_empty()
        && let Some(carried) = carried()?
    {
        complete(&mut mask, &carried, &sighted, &found);
    }
    let mended = mask
        .ids
        .iter()
        .zip(&tracked.mask.ids)
        .filter(|(now, before)| now != before)
        .count();
    let confidence = confidence(&mask, &sighted, &found.touched, tracked.confidence);
    Ok(Held {
        walked: WalkedFrame { mask, confidence },
        mended,
        has_strayed: !found.strayed.is_empty(),
    })
}

/// Gives objects that strayed the pixels without a label in which they are carried, unless geometry is sure of another.
fn complete(mask: &mut LabelMask, carried: &LabelMask, sighted: &Sighted, found: &Contradictions) {
    for ((id, &carried), verdict) in mask.ids.iter_mut().zip(&carried.ids).zip(&sighted.labels) {
        if *id == LabelId::NONE && verdict.is_none() && found.strayed.contains_key(&carried) {
            *id = carried;
        }
    }
}

/// What is shown, as sure as the tracker was of it; what was mended, by the share of its pixels that geometry confirms.
fn confidence(
    mask: &LabelMask,
    sighted: &Sighted,
    touched: &BTreeSet<LabelId>,
    tracked: BTreeMap<LabelId, f32>,
) -> BTreeMap<LabelId, f32> {
    let mut counts: BTreeMap<LabelId, [usize; 2]> = BTreeMap::new();
    for (&label, &verdict) in mask
        .ids
        .iter()
        .zip(&sighted.labels)
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
