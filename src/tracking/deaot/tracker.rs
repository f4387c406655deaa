use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

use super::network::{Features, LongMemory, Memory, Networks, OBJECTS, Running, Seen};
use super::picture::{fed, nearest, probabilities, shown_size};
use crate::networks::network_error;
use crate::propagate::{
    Answer, KeyframeUse, LabelProbabilities, LookAhead, MaskPropagator, PassFrame, Section,
    most_probable, propagate, shown_labels,
};
use ostra_compute::nn::{Network, NnError, Tensor, load};
use ostra_core::job::Progress;
use ostra_frames::Image;
use ostra_masks::{Direction, LabelId, LabelMask, MaskError, TrackRequest, TrackedFrame, Tracker};

/// Settings of [`Deaot`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DeaotOptions {
    /// Longest side of what the network sees, px; larger pictures are shrunk to it. Time grows with its fourth power.
    pub longest_side: u32,
    /// Every how many pictures one more is remembered for long, at least 1.
    pub remembered_every: usize,
    /// Pictures remembered for long at most, at least 1: those whose mask was given, and the latest others. The official
    /// code sets no bound; up to `remembered_every · most_remembered` pictures nothing differs from it.
    pub most_remembered: usize,
}

impl Default for DeaotOptions {
    /// As the official evaluation runs R50-DeAOT-L, with its memory bounded.
    fn default() -> Self {
        Self {
            longest_side: 1040,
            remembered_every: 5,
            most_remembered: 16,
        }
    }
}

/// DeAOT: carries masks of any number of labels through a video, ten at once. Clones share the networks.
#[derive(Debug, Clone)]
pub struct Deaot {
    networks: Arc<Networks>,
    /// How much it sees and remembers.
    pub options: DeaotOptions,
}

impl Deaot {
    /// The networks `deaot` of a folder of networks.
    ///
    /// # Errors
    /// When they are not installed there, do not load, or ONNX Runtime is missing.
    pub fn load(folder: &Path) -> Result<Self, NnError> {
        let four = <[Network; 4]>::try_from(load(folder, "deaot")?);
        Self::new(four.map_err(|_| NnError::Request("`deaot` is four networks".into()))?)
    }

    /// Of encoder, remember, propagate and identify, as `assets/export/deaot.py` makes them.
    ///
    /// # Errors
    /// [`NnError::Mismatch`] where one has other inputs or outputs.
    pub fn new(networks: [Network; 4]) -> Result<Self, NnError> {
        Ok(Self {
            networks: Arc::new(Networks::new(networks)?),
            options: DeaotOptions::default(),
        })
    }

    /// A pass through frames that remembers nothing yet.
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

/// A pass through frames: labels are numbered as they appear, every ten are a group of their own, and the groups'
/// answers are brought together.
#[derive(Debug)]
pub(super) struct DeaotPass<'a> {
    networks: Running<'a>,
    options: DeaotOptions,
    /// Columns and rows that the network sees, as of the first picture: what is remembered lies on one grid of cells.
    shown: Option<(usize, usize)>,
    /// The label of every number, from 1.
    labels: Vec<LabelId>,
    groups: Vec<Group>,
    /// The picture that was propagated to last; remembered only when the pass goes on, for its mask may be given.
    last: Option<Last>,
}

/// A picture that was propagated to.
#[derive(Debug)]
struct Last {
    image: Image,
    features: Features,
    seen: Vec<Seen>,
    /// The number of every pixel.
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

    /// Logits of every group for the picture that was propagated to last.
    #[cfg(test)]
    pub fn last_logits(&self) -> Vec<&ostra_compute::nn::Tensor> {
        self.last
            .iter()
            .flat_map(|last| &last.seen)
            .map(|seen| &seen.logits)
            .collect()
    }

    fn shown(&mut self, image: &Image) -> (usize, usize) {
        let longest = self.options.longest_side;
        *self
            .shown
            .get_or_insert_with(|| shown_size(image.width, image.height, longest))
    }

    fn features(&mut self, image: &Image) -> Result<Features, MaskError> {
        check(image)?;
        let shown = self.shown(image);
        self.networks
            .encode(&fed(image, shown).map_err(network_error)?)
    }

    /// Finds the objects in the next picture, with the probabilities of nothing and of every number.
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
        let size = (image.width as usize, image.height as usize);
        let probabilities = probabilities(&logits, self.labels.len(), size);
        let numbers: Vec<usize> = most_probable(&probabilities, size.0 * size.1)
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

    /// Remembers the last picture as it was answered.
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

    /// The picture's features and the number of every pixel where the mask says nothing: labels that it shows lie nowhere
    /// else, the others where they are seen.
    fn around(
        &mut self,
        image: &Image,
        given: &BTreeSet<LabelId>,
    ) -> Result<(Features, Vec<usize>), MaskError> {
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

    /// The number of a label, a new one where it has none.
    fn number(&mut self, label: LabelId) -> usize {
        let known = self.labels.iter().position(|known| *known == label);
        known.unwrap_or_else(|| {
            self.labels.push(label);
            self.labels.len() - 1
        }) + 1
    }

    /// Takes the labels of `mask` on `image` as given. Labels that it does not show keep what is remembered of them.
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
                "the mask is {a}, its picture {b}; make the mask anew"
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
            self.groups.push(Group::new(
                self.networks,
                at,
                &features,
                &numbers,
                &self.options,
            )?);
        }
        Ok(())
    }

    /// Where the labels are in the next image of the pass.
    pub fn propagate(&mut self, image: &Image) -> Result<LabelProbabilities, MaskError> {
        if self.groups.is_empty() {
            return Err(MaskError::Request(
                "there is no mask to carry; prompt or import one first".into(),
            ));
        }
        let (last, by_number) = self.look(image)?;
        self.last = Some(last);
        let size = (image.width as usize, image.height as usize);
        Ok(LabelProbabilities::sorted(&self.labels, size, by_number))
    }
}

impl MaskPropagator for DeaotPass<'_> {
    fn start_pass(&mut self, _direction: Direction) {
        *self = Self::new(self.networks, self.options);
    }

    fn add_keyframe(&mut self, frame: &PassFrame, mask: &LabelMask) -> Result<(), MaskError> {
        self.remember(&frame.image, mask)
    }

    fn carry_to(
        &mut self,
        frame: &PassFrame,
        _ahead: &mut LookAhead<'_, '_>,
    ) -> Result<Answer, MaskError> {
        Ok(Answer::most_probable(self.propagate(&frame.image)?))
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
        "the picture of {width}×{height} has {} pixels; load it anew",
        pixels.len()
    )))
}

/// The number of the object in every pixel that the network sees, row by row; 0 is nothing.
pub(super) struct NumberMap {
    numbers: Vec<usize>,
    columns: usize,
    rows: usize,
}

impl NumberMap {
    /// From the numbers in the pixels of an image.
    fn new(numbers: &[usize], image: &Image, shown: (usize, usize)) -> Self {
        let size = (image.width as usize, image.height as usize);
        Self {
            numbers: nearest(numbers, size, shown),
            columns: shown.0,
            rows: shown.1,
        }
    }
}

/// What is remembered of up to ten objects that are distinguished in one run.
#[derive(Debug)]
pub(super) struct Group {
    /// Number of its first object; 0 is nothing.
    first: usize,
    long: LongMemory,
    short: Memory,
    /// Pictures since one was remembered for long.
    since: usize,
}

impl Group {
    /// Of group `at`, from 0, and an image in which its objects are given.
    pub fn new(
        networks: Running<'_>,
        at: usize,
        features: &Features,
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

    /// A further picture in which the objects are given.
    pub fn remember(
        &mut self,
        networks: Running<'_>,
        features: &Features,
        given: &NumberMap,
    ) -> Result<(), MaskError> {
        self.short = networks.remember(features, &one_hot(given, self.first)?)?;
        self.long.push(&self.short, true).map_err(network_error)?;
        self.since = 0;
        Ok(())
    }

    /// The objects in the next picture.
    pub fn propagate(
        &mut self,
        networks: Running<'_>,
        features: &Features,
    ) -> Result<Seen, MaskError> {
        self.since += 1;
        networks.propagate(features, &self.long.memory, &self.short)
    }

    /// Keeps of that picture what the next one needs, now that its mask is known.
    pub fn keep(
        &mut self,
        networks: Running<'_>,
        seen: Seen,
        found: &NumberMap,
        options: &DeaotOptions,
    ) -> Result<(), MaskError> {
        self.short = networks.identify(seen, &one_hot(found, self.first)?)?;
        if self.since >= options.remembered_every {
            self.long.push(&self.short, false).map_err(network_error)?;
            self.since = 0;
        }
        Ok(())
    }
}

/// `[1, 11, rows, columns]`: one where a channel's object is; what is not of this group is nothing.
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
    Tensor::floats(&[1, OBJECTS + 1, *rows, *columns], planes).map_err(network_error)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_of_other_groups_are_nothing() {
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
