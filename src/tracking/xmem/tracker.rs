use std::path::Path;
use std::sync::Arc;

use rayon::prelude::*;

use super::fit::Fit;
use super::memory::{MemoryGroup, XMemOptions};
use super::networks::{ImageEncoding, XMemNetworks};
use crate::networks::odds;
use crate::propagate::{
    KeyframeUse, LabelProbabilities, LookAhead, MaskPropagator, PassFrame, PassResult, Section,
    propagate, shown_labels,
};
use ostra_compute::nn::{Network, NnError, load};
use ostra_core::job::Progress;
use ostra_frames::Image;
use ostra_masks::{Direction, LabelId, LabelMask, MaskError, TrackRequest, TrackedFrame, Tracker};

/// The XMem tracker, for any number of labels, with a memory of bounded size.
///
/// Clones share the networks.
#[derive(Debug, Clone)]
pub struct XMem {
    pub(super) networks: Arc<XMemNetworks>,
    /// Input size and memory settings.
    pub options: XMemOptions,
}

impl XMem {
    /// Loads the networks `xmem` from a folder of networks.
    ///
    /// # Errors
    /// Fails if the networks are not installed there or do not load, or if ONNX Runtime is missing.
    pub fn load(folder: &Path) -> Result<Self, NnError> {
        let three = <[Network; 3]>::try_from(load(folder, "xmem")?);
        Self::new(three.map_err(|_| NnError::Request("`xmem` is three networks".into()))?)
    }

    /// Creates the tracker from key encoder, value encoder and decoder.
    ///
    /// `assets/export/xmem.py` writes these networks.
    ///
    /// # Errors
    /// [`NnError::Mismatch`] if one has other inputs than expected.
    pub fn new(networks: [Network; 3]) -> Result<Self, NnError> {
        Ok(Self {
            networks: Arc::new(XMemNetworks::new(networks)?),
            options: XMemOptions::default(),
        })
    }

    /// Starts a pass with an empty memory.
    pub(super) fn pass<'a>(&'a self, progress: &'a Progress) -> XMemPass<'a> {
        XMemPass::new(&self.networks, &self.options, progress)
    }
}

impl Tracker for XMem {
    fn name(&self) -> &'static str {
        "xmem"
    }

    fn track(
        &self,
        request: &TrackRequest,
        emit: &mut dyn FnMut(TrackedFrame),
        progress: &Progress,
    ) -> Result<Vec<String>, MaskError> {
        let make = |_: &Section| -> Box<dyn MaskPropagator + '_> { Box::new(self.pass(progress)) };
        propagate(request, KeyframeUse::Sequence, emit, progress, &make)
    }
}

/// A pass of objects through images of one size.
pub(super) struct XMemPass<'a> {
    networks: &'a XMemNetworks,
    options: &'a XMemOptions,
    progress: &'a Progress,
    /// Labels, in the order of their appearance.
    objects: Vec<LabelId>,
    /// One group for every frame on which objects appeared.
    groups: Vec<MemoryGroup>,
    /// Sensory memory, `[objects][hidden][cells]`.
    hidden: Vec<f32>,
    /// Frames since the last one that entered memory.
    since: usize,
}

impl<'a> XMemPass<'a> {
    pub fn new(
        networks: &'a XMemNetworks,
        options: &'a XMemOptions,
        progress: &'a Progress,
    ) -> Self {
        Self {
            networks,
            options,
            progress,
            objects: Vec::new(),
            groups: Vec::new(),
            hidden: Vec::new(),
            since: 0,
        }
    }

    /// Returns the elements of working and of long-term memory, by group.
    #[cfg(test)]
    pub fn sizes(&self) -> Vec<(usize, usize)> {
        self.groups.iter().map(MemoryGroup::sizes).collect()
    }

    fn see(&self, image: &Image) -> Result<ImageEncoding, MaskError> {
        let fit = Fit::new(image.width, image.height, self.options.short_side);
        self.networks.see(image, fit, self.progress)
    }

    /// Stores the labels of `mask` on `image` as given; other labels keep their memory.
    pub fn remember(&mut self, image: &Image, mask: &LabelMask) -> Result<(), MaskError> {
        let mut shown = shown_labels(mask);
        if shown.is_empty() && self.objects.is_empty() {
            return Ok(());
        }
        let seen = self.see(image)?;
        let are_all_given = self.objects.iter().all(|object| shown.contains(object));
        let predicted = if are_all_given {
            None
        } else {
            Some(self.segment(&seen)?.0)
        };
        shown.retain(|label| !self.objects.contains(label));
        self.objects.extend(shown);
        self.hidden.resize(
            self.objects.len() * self.networks.hidden * seen.cells.len(),
            0.0,
        );
        let given = self.given_masks(&seen, mask, predicted.as_deref());
        let area = seen.fit.area();
        self.memorise(&seen, &aggregated(&given, area)[area..])
    }

    /// Propagates the labels to the next image of the pass.
    pub fn propagate(&mut self, image: &Image) -> Result<LabelProbabilities, MaskError> {
        let seen = self.see(image)?;
        let area = seen.fit.area();
        let (probabilities, hidden) = self.segment(&seen)?;
        self.since += 1;
        if self.since >= self.options.remember_every {
            self.memorise(&seen, &probabilities[area..])?;
        } else {
            self.hidden = hidden;
        }
        Ok(LabelProbabilities::sorted(
            &self.objects,
            seen.fit.image,
            seen.fit.enlarged(&probabilities),
        ))
    }

    /// Returns the probabilities `[1 + objects][area]` and the updated sensory memory.
    fn segment(&mut self, seen: &ImageEncoding) -> Result<(Vec<f32>, Vec<f32>), MaskError> {
        let (keys, selections) = (&seen.cells.keys, &seen.cells.selections);
        let mut readout = Vec::new();
        for group in &mut self.groups {
            self.progress.check()?;
            readout.extend(group.read(keys, selections, self.options));
        }
        let mut outputs = self
            .networks
            .decode(seen, &readout, &self.hidden, self.progress)?;
        outputs
            .values
            .iter_mut()
            .for_each(|logit| *logit = 1.0 / (1.0 + (-*logit).exp()));
        Ok((aggregated(&outputs.values, seen.fit.area()), outputs.hidden))
    }

    /// Adds an image with its object masks, `[objects][area]`, to the memory.
    ///
    /// Objects that appeared with it form a group.
    fn memorise(&mut self, seen: &ImageEncoding, masks: &[f32]) -> Result<(), MaskError> {
        let outputs = self
            .networks
            .value(seen, masks, &self.hidden, self.progress)?;
        self.hidden = outputs.hidden;
        let grouped = self.groups.last().map_or(0, |group| group.objects.end);
        if grouped < self.objects.len() {
            self.groups.push(MemoryGroup::new(
                grouped..self.objects.len(),
                seen.cells.widths,
                seen.cells.len(),
            ));
        }
        let size = seen.cells.widths.value * seen.cells.len();
        for group in &mut self.groups {
            self.progress.check()?;
            let values = &outputs.values[group.objects.start * size..group.objects.end * size];
            group.remember(&seen.with_values(values), self.options);
        }
        self.since = 0;
        Ok(())
    }

    /// Returns the object masks `[objects][area]` given by `mask`.
    ///
    /// Objects that it does not show keep their prediction (`[1 + objects known before][area]`),
    /// except where the mask shows another object.
    fn given_masks(
        &self,
        seen: &ImageEncoding,
        mask: &LabelMask,
        predicted: Option<&[f32]>,
    ) -> Vec<f32> {
        let area = seen.fit.area();
        let mut maps = seen.fit.one_hot(mask, &self.objects);
        let Some(predicted) = predicted else {
            return maps;
        };
        let mut is_given = vec![false; area];
        for map in maps.chunks_exact(area) {
            is_given
                .iter_mut()
                .zip(map)
                .for_each(|(given, value)| *given |= *value > 0.5);
        }
        let known = maps
            .chunks_exact_mut(area)
            .zip(&self.objects)
            .zip(predicted[area..].chunks_exact(area));
        for ((map, _), predicted) in known.filter(|((_, object), _)| !mask.ids.contains(object)) {
            for ((out, value), given) in map.iter_mut().zip(predicted).zip(&is_given) {
                *out = if *given { 0.0 } else { *value };
            }
        }
        maps
    }
}

impl MaskPropagator for XMemPass<'_> {
    fn start_pass(&mut self, _direction: Direction) {
        *self = Self::new(self.networks, self.options, self.progress);
    }

    fn add_keyframe(&mut self, frame: &PassFrame, mask: &LabelMask) -> Result<(), MaskError> {
        self.remember(&frame.image, mask)
    }

    fn transfer_to(
        &mut self,
        frame: &PassFrame,
        _ahead: &mut LookAhead<'_, '_>,
    ) -> Result<PassResult, MaskError> {
        Ok(PassResult::most_probable(self.propagate(&frame.image)?))
    }
}

/// Pixels per parallel task.
const BLOCK: usize = 4096;
/// Margin of probabilities to 0 and 1.
const MARGIN: f32 = 1e-7;

/// Merges the probabilities of single objects by soft aggregation.
///
/// Input are the probabilities of each object alone, `[objects][area]`. Output are those of the
/// background and of each object among all, `[1 + objects][area]`, which sum to 1.
///
/// Oh et al.: "Video Object Segmentation using Space-Time Memory Networks", ICCV 2019.
fn aggregated(alone: &[f32], area: usize) -> Vec<f32> {
    let maps = 1 + alone.len() / area;
    let firsts = (0..area).into_par_iter().step_by(BLOCK);
    let blocks: Vec<Vec<f32>> = firsts
        .map(|first| shares(alone, area, first, BLOCK.min(area - first)))
        .collect();
    let mut out = vec![0.0; maps * area];
    for (place, block) in blocks.iter().enumerate() {
        let count = block.len() / maps;
        for (map, shares) in block.chunks_exact(count).enumerate() {
            out[map * area + place * BLOCK..][..count].copy_from_slice(shares);
        }
    }
    out
}

/// Returns the normalized odds of the background and each object, `[1 + objects][count]`.
fn shares(alone: &[f32], area: usize, first: usize, count: usize) -> Vec<f32> {
    let maps = 1 + alone.len() / area;
    let mut out = vec![1.0; maps * count];
    for at in 0..count {
        let mut sum = 0.0;
        for map in 1..maps {
            let p = alone[(map - 1) * area + first + at];
            out[at] *= 1.0 - p;
            out[map * count + at] = odds(p, MARGIN);
            sum += out[map * count + at];
        }
        out[at] = odds(out[at], MARGIN);
        sum += out[at];
        (0..maps).for_each(|map| out[map * count + at] /= sum);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn odds_are_normalized() {
        // Odds: background 0.4 · 0.7 = 0.28 → 0.3889; 0.6 → 1.5; 0.3 → 0.4286. Then one object with
        // certainty.
        let found = aggregated(&[0.6, 1.0, 0.3, 0.0], 2);
        let sum = 0.388_888_9 + 1.5 + 0.428_571_4;
        let expected = [
            0.388_888_9 / sum,
            0.0,
            1.5 / sum,
            1.0,
            0.428_571_4 / sum,
            0.0,
        ];
        assert!(
            found
                .iter()
                .zip(expected)
                .all(|(found, expected)| (found - expected).abs() < 1e-6),
            "{found:?}"
        );
    }
}
