use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

use super::image_input::{fed, nearest, probabilities, shown_size};
use super::network::{
    DeAotNetworks, EncoderFeatures, ImageMemory, LongMemory, NetworkOutput, OBJECTS, Running,
};
use crate::propagate::{
    KeyframeUse, LabelProbabilities, LookAhead, MaskPropagator, PassFrame, PassResult, Section,
    most_probable, propagate, shown_labels,
};
use ostra_compute::nn::{Network, NnError, Tensor, load};
use ostra_core::image::ImageSize;
use ostra_core::job::Progress;
use ostra_frames::Image;
use ostra_masks::{Direction, LabelId, LabelMask, MaskError, TrackRequest, TrackedFrame, Tracker};

/// Options of [`Deaot`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DeaotOptions {
    /// Longer side of the network input in pixels; larger images are reduced.
    ///
    /// Time grows with its fourth power.
    pub longest_side: u32,
    /// Interval in images at which one enters long-term memory, at least 1.
    pub remembered_every: usize,
    /// Maximum number of images in long-term memory, at least 1.
    ///
    /// The memory keeps the images with given masks and the latest others. The official code sets
    /// no bound; up to `remembered_every · most_remembered` images the results are the same.
    pub most_remembered: usize,
}

impl Default for DeaotOptions {
    /// Returns the settings of the official evaluation of R50-DeAOT-L, with bounded memory.
    fn default() -> Self {
        Self {
            longest_side: 1040,
            remembered_every: 5,
            most_remembered: 16,
        }
    }
}

/// The DeAOT tracker, for any number of labels in groups of ten.
///
/// Clones share the networks.
#[derive(Debug, Clone)]
pub struct Deaot {
    networks: Arc<DeAotNetworks>,
    /// Input size and memory settings.
    pub options: DeaotOptions,
}

impl Deaot {
    /// Loads the networks `deaot` from a folder of networks.
    ///
    /// # Errors
    /// Fails if the networks are not installed there or do not load, or if ONNX Runtime is missing.
    pub fn load(folder: &Path) -> Result<Self, NnError> {
        let four = <[Network; 4]>::try_from(load(folder, "deaot")?);
        Self::new(four.map_err(|_| NnError::Request("`deaot` is four networks".into()))?)
    }

    /// Creates the tracker from encoder, remember, propagate and identify.
    ///
    /// `assets/export/deaot.py` writes these networks.
    ///
    /// # Errors
    /// [`NnError::Mismatch`] if one has other inputs or outputs.
    pub fn new(networks: [Network; 4]) -> Result<Self, NnError> {
        Ok(Self {
            networks: Arc::new(DeAotNetworks::new(networks)?),
            options: DeaotOptions::default(),
        })
    }

    /// Starts a pass with an empty memory.
    pub(super) fn pass<'a>(&'a self, progress: &'a Progress) -> DeaotPass<'a> {
        DeaotPass::new(self.networks.running(progress), self.options)
    }
}

impl Tracker for Deaot {
    fn name(&self) -> &'static str {
        "deaot"
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

/// A pass through frames.
///
/// Labels are numbered as they appear. Every ten form a group of their own, and the results of the
/// groups are merged.
#[derive(Debug)]
pub(super) struct DeaotPass<'a> {
    networks: Running<'a>,
    options: DeaotOptions,
    /// Size of the network input, set by the first image.
    ///
    /// The memory needs one grid of cells for all images.
    shown: Option<ImageSize>,
    /// Label of every number; the first has number 1.
    labels: Vec<LabelId>,
    groups: Vec<ObjectGroup>,
    /// The image that was propagated to last.
    ///
    /// It enters the memory only when the pass continues, because its mask may still be given.
    last: Option<Last>,
}

/// An image that was propagated to.
#[derive(Debug)]
struct Last {
    image: Image,
    features: EncoderFeatures,
    seen: Vec<NetworkOutput>,
    /// Object number of every pixel.
    numbers: Vec<usize>,
}

impl<'a> DeaotPass<'a> {
    pub fn new(networks: Running<'a>, options: DeaotOptions) -> Self {
        Self {
            networks,
            options,
            shown: None,
            labels: Vec::new(),
            groups: Vec::new(),
            last: None,
        }
    }

    /// Returns the logits of every group for the last image.
    #[cfg(test)]
    pub fn last_logits(&self) -> Vec<&ostra_compute::nn::Tensor> {
        self.last
            .iter()
            .flat_map(|last| &last.seen)
            .map(|seen| &seen.logits)
            .collect()
    }

    fn shown(&mut self, image: &Image) -> ImageSize {
        let longest = self.options.longest_side;
        *self
            .shown
            .get_or_insert_with(|| shown_size(image.width, image.height, longest))
    }

    fn features(&mut self, image: &Image) -> Result<EncoderFeatures, MaskError> {
        check(image)?;
        let shown = self.shown(image);
        self.networks.encode(&fed(image, shown)?)
    }

    /// Propagates the objects to the next image.
    ///
    /// Also returns the probabilities of the background and of every number.
    fn look(&mut self, image: &Image) -> Result<(Last, Vec<f32>), MaskError> {
        self.keep_last()?;
        let features = self.features(image)?;
        let networks = self.networks;
        let seen = self
            .groups
            .iter_mut()
            .map(|group| group.propagate(networks, &features));
        let seen = seen.collect::<Result<Vec<_>, _>>()?;
        let logits: Vec<_> = seen.iter().map(|seen| &seen.logits).collect();
        let size = image.size();
        let probabilities = probabilities(&logits, self.labels.len(), size);
        let numbers: Vec<usize> = most_probable(&probabilities, size.area())
            .into_iter()
            .map(|(number, _)| number)
            .collect();
        Ok((
            Last {
                image: image.clone(),
                features,
                seen,
                numbers,
            },
            probabilities,
        ))
    }

    /// Adds the last image to the memory, with its propagated mask.
    fn keep_last(&mut self) -> Result<(), MaskError> {
        let Some(last) = self.last.take() else {
            return Ok(());
        };
        let shown = self.shown(&last.image);
        let numbers = NumberMap::new(&last.numbers, &last.image, shown);
        for (group, seen) in self.groups.iter_mut().zip(last.seen) {
            group.keep(self.networks, seen, &numbers, &self.options)?;
        }
        Ok(())
    }

    /// Returns the image's features and the object numbers outside the given labels.
    ///
    /// A label in `given` keeps no pixel here, because the mask is complete for it. Other labels
    /// stay where they are detected.
    fn around(
        &mut self,
        image: &Image,
        given: &BTreeSet<LabelId>,
    ) -> Result<(EncoderFeatures, Vec<usize>), MaskError> {
        let last = match self.last.take() {
            Some(last) if last.image == *image => last,
            other => {
                self.last = other;
                if self.labels.iter().all(|label| given.contains(label)) {
                    self.keep_last()?;
                    return Ok((self.features(image)?, vec![0; image.pixels.len()]));
                }
                self.look(image)?.0
            }
        };
        let is_given: Vec<bool> = self
            .labels
            .iter()
            .map(|label| given.contains(label))
            .collect();
        let numbers = last.numbers.into_iter();
        let others = numbers.map(|number| {
            if number > 0 && is_given[number - 1] {
                0
            } else {
                number
            }
        });
        Ok((last.features, others.collect()))
    }

    /// Returns the number of a label, and assigns a new one if it has none.
    fn number(&mut self, label: LabelId) -> usize {
        let known = self.labels.iter().position(|known| *known == label);
        known.unwrap_or_else(|| {
            self.labels.push(label);
            self.labels.len() - 1
        }) + 1
    }

    /// Stores the labels of `mask` on `image` as given; other labels keep their memory.
    pub fn remember(&mut self, image: &Image, mask: &LabelMask) -> Result<(), MaskError> {
        check(image)?;
        if (mask.width, mask.height) != (image.width, image.height)
            || mask.ids.len() != image.pixels.len()
        {
            let (a, b) = (
                format!("{}×{}", mask.width, mask.height),
                format!("{}×{}", image.width, image.height),
            );
            return Err(MaskError::Request(format!(
                "the mask is {a}, its image {b}; make the mask again"
            )));
        }
        let given = shown_labels(mask);
        if given.is_empty() {
            return Ok(());
        }
        let (features, mut numbers) = self.around(image, &given)?;
        let of_label: Vec<(LabelId, usize)> = given
            .into_iter()
            .map(|label| (label, self.number(label)))
            .collect();
        for (number, label) in numbers.iter_mut().zip(&mask.ids) {
            if let Ok(at) = of_label.binary_search_by_key(label, |&(label, _)| label) {
                *number = of_label[at].1;
            }
        }
        let shown = self.shown(image);
        let numbers = NumberMap::new(&numbers, image, shown);
        for group in &mut self.groups {
            group.remember(self.networks, &features, &numbers)?;
        }
        for at in self.groups.len()..self.labels.len().div_ceil(OBJECTS) {
            self.groups.push(ObjectGroup::new(
                self.networks,
                at,
                &features,
                &numbers,
                &self.options,
            )?);
        }
        Ok(())
    }

    /// Propagates the labels to the next image of the pass.
    pub fn propagate(&mut self, image: &Image) -> Result<LabelProbabilities, MaskError> {
        if self.groups.is_empty() {
            return Err(MaskError::Request(
                "there is no mask to track; prompt or import one first".into(),
            ));
        }
        let (last, by_number) = self.look(image)?;
        self.last = Some(last);
        Ok(LabelProbabilities::sorted(
            &self.labels,
            image.size(),
            by_number,
        ))
    }
}

impl MaskPropagator for DeaotPass<'_> {
    fn start_pass(&mut self, _direction: Direction) {
        *self = Self::new(self.networks, self.options);
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

fn check(image: &Image) -> Result<(), MaskError> {
    let Image {
        width,
        height,
        ref pixels,
    } = *image;
    if pixels.len() == width as usize * height as usize && width > 0 && height > 0 {
        return Ok(());
    }
    Err(MaskError::Request(format!(
        "the image of {width}×{height} has {} pixels; load it again",
        pixels.len()
    )))
}

/// Object number of every pixel of the network input, row by row; 0 is the background.
pub(super) struct NumberMap {
    numbers: Vec<usize>,
    columns: usize,
    rows: usize,
}

impl NumberMap {
    /// Resizes the object numbers of an image to the network input.
    fn new(numbers: &[usize], image: &Image, shown: ImageSize) -> Self {
        Self {
            numbers: nearest(numbers, image.size(), shown),
            columns: shown.width,
            rows: shown.height,
        }
    }
}

/// Memory of up to ten objects that share one run.
#[derive(Debug)]
pub(super) struct ObjectGroup {
    /// Number of the first object; 0 is the background.
    first: usize,
    long: LongMemory,
    short: ImageMemory,
    /// Images since the last one entered long-term memory.
    since: usize,
}

impl ObjectGroup {
    /// Creates group `at` (from 0) from an image whose mask is given.
    pub fn new(
        networks: Running<'_>,
        at: usize,
        features: &EncoderFeatures,
        given: &NumberMap,
        options: &DeaotOptions,
    ) -> Result<Self, MaskError> {
        let first = at * OBJECTS + 1;
        let short = networks.remember(features, &one_hot(given, first)?)?;
        Ok(Self {
            first,
            long: LongMemory::new(&short, options.most_remembered),
            short,
            since: 0,
        })
    }

    /// Adds another image whose mask is given.
    pub fn remember(
        &mut self,
        networks: Running<'_>,
        features: &EncoderFeatures,
        given: &NumberMap,
    ) -> Result<(), MaskError> {
        self.short = networks.remember(features, &one_hot(given, self.first)?)?;
        self.long.push(&self.short, true)?;
        self.since = 0;
        Ok(())
    }

    /// Propagates the objects to the next image.
    pub fn propagate(
        &mut self,
        networks: Running<'_>,
        features: &EncoderFeatures,
    ) -> Result<NetworkOutput, MaskError> {
        self.since += 1;
        networks.propagate(features, &self.long.memory, &self.short)
    }

    /// Adds that image to the memory, now that its mask is known.
    pub fn keep(
        &mut self,
        networks: Running<'_>,
        seen: NetworkOutput,
        found: &NumberMap,
        options: &DeaotOptions,
    ) -> Result<(), MaskError> {
        self.short = networks.identify(seen, &one_hot(found, self.first)?)?;
        if self.since >= options.remembered_every {
            self.long.push(&self.short, false)?;
            self.since = 0;
        }
        Ok(())
    }
}

/// Encodes a map as `[1, 11, rows, columns]`, with 1 where a channel's object is.
///
/// Objects of other groups count as background.
fn one_hot(map: &NumberMap, first: usize) -> Result<Tensor, MaskError> {
    let NumberMap {
        numbers,
        columns,
        rows,
    } = map;
    let mut planes = vec![0.0; (OBJECTS + 1) * numbers.len()];
    for (at, &number) in numbers.iter().enumerate() {
        let channel = (number + 1)
            .checked_sub(first)
            .filter(|channel| *channel <= OBJECTS)
            .unwrap_or(0);
        planes[channel * numbers.len() + at] = 1.0;
    }
    Tensor::floats(&[1, OBJECTS + 1, *rows, *columns], planes).map_err(MaskError::from)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_of_other_groups_are_background() {
        let map = NumberMap {
            numbers: vec![0, 1, 10, 11, 12, 20, 21],
            columns: 7,
            rows: 1,
        };
        let mask = one_hot(&map, 11).unwrap();
        let channel = |at: usize| {
            (0..=OBJECTS)
                .filter(|channel| mask.as_floats()[channel * 7 + at] > 0.0)
                .collect::<Vec<_>>()
        };
        let channels: Vec<Vec<usize>> = (0..7).map(channel).collect();
        assert_eq!(channels, [[0], [0], [0], [1], [2], [10], [0]]);
    }
}
