use super::aggregate::aggregated;
use super::fit::Fit;
use super::group::Group;
use super::networks::{Networks, Seen};
use super::options::XMemOptions;
use crate::propagate::{Propagated, Propagator};
use ostra_core::job::Progress;
use ostra_frames::Image;
use ostra_masks::{LabelId, LabelMask, MaskError};

/// Objects followed through pictures of one size.
pub(super) struct Walk<'a> {
    networks: &'a Networks,
    options: &'a XMemOptions,
    progress: &'a Progress,
    /// In the order in which they came.
    objects: Vec<LabelId>,
    /// One for every frame on which objects came.
    groups: Vec<Group>,
    /// Sensory memory, `[objects][hidden][cells]`.
    hidden: Vec<f32>,
    /// Frames since the last one that was remembered.
    since: usize,
}

impl<'a> Walk<'a> {
    pub fn new(networks: &'a Networks, options: &'a XMemOptions, progress: &'a Progress) -> Self {
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

    /// Elements of working and of long-term memory, by group.
    #[cfg(test)]
    pub fn sizes(&self) -> Vec<(usize, usize)> {
        self.groups.iter().map(Group::sizes).collect()
    }

    fn see(&self, image: &Image) -> Result<Seen, MaskError> {
        let fit = Fit::new(image.width, image.height, self.options.short_side);
        self.networks.see(image, fit, self.progress)
    }

    /// Probabilities `[1 + objects][area]` of the picture, and sensory memory renewed by it.
    fn segment(&mut self, seen: &Seen) -> Result<(Vec<f32>, Vec<f32>), MaskError> {
        let (keys, selections) = (&seen.cells.keys, &seen.cells.selections);
        let mut readout = Vec::new();
        for group in &mut self.groups {
            self.progress.check()?;
            readout.extend(group.read(keys, selections, self.options));
        }
        let mut said = self
            .networks
            .decode(seen, &readout, &self.hidden, self.progress)?;
        said.values
            .iter_mut()
            .for_each(|logit| *logit = 1.0 / (1.0 + (-*logit).exp()));
        Ok((aggregated(&said.values, seen.fit.area()), said.hidden))
    }

    /// Remembers the picture and where objects are in it, `[objects][area]`; objects that came with it form a group.
    fn memorise(&mut self, seen: &Seen, masks: &[f32]) -> Result<(), MaskError> {
        let said = self
            .networks
            .value(seen, masks, &self.hidden, self.progress)?;
        self.hidden = said.hidden;
        let grouped = self.groups.last().map_or(0, |group| group.objects.end);
        if grouped < self.objects.len() {
            self.groups.push(Group::new(
                grouped..self.objects.len(),
                seen.cells.widths,
                seen.cells.len(),
            ));
        }
        let size = seen.cells.widths.value * seen.cells.len();
        for group in &mut self.groups {
            self.progress.check()?;
            let values = &said.values[group.objects.start * size..group.objects.end * size];
            group.remember(&seen.with_values(values), self.options);
        }
        self.since = 0;
        Ok(())
    }

    /// Where objects are, `[objects][area]`, as the mask says; those that it does not show are where they were predicted
    /// (`[1 + objects known before][area]`), less what it gives to others.
    fn as_told(&self, seen: &Seen, mask: &LabelMask, predicted: Option<&[f32]>) -> Vec<f32> {
        let area = seen.fit.area();
        let mut maps = seen.fit.one_hot(mask, &self.objects);
        let Some(predicted) = predicted else {
            return maps;
        };
        let mut is_told = vec![false; area];
        for map in maps.chunks_exact(area) {
            is_told
                .iter_mut()
                .zip(map)
                .for_each(|(told, value)| *told |= *value > 0.5);
        }
        let known = maps
            .chunks_exact_mut(area)
            .zip(&self.objects)
            .zip(predicted[area..].chunks_exact(area));
        for ((map, _), predicted) in known.filter(|((_, object), _)| !mask.ids.contains(object)) {
            for ((out, value), told) in map.iter_mut().zip(predicted).zip(&is_told) {
                *out = if *told { 0.0 } else { *value };
            }
        }
        maps
    }
}

impl Propagator for Walk<'_> {
    fn remember(&mut self, image: &Image, mask: &LabelMask) -> Result<(), MaskError> {
        let mut shown: Vec<LabelId> = mask
            .ids
            .iter()
            .copied()
            .filter(|&id| id != LabelId::NONE)
            .collect();
        shown.sort_unstable();
        shown.dedup();
        if shown.is_empty() && self.objects.is_empty() {
            return Ok(());
        }
        let seen = self.see(image)?;
        let is_all_told = self
            .objects
            .iter()
            .all(|object| shown.binary_search(object).is_ok());
        let predicted = if is_all_told {
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
        let told = self.as_told(&seen, mask, predicted.as_deref());
        let area = seen.fit.area();
        self.memorise(&seen, &aggregated(&told, area)[area..])
    }

    fn propagate(&mut self, image: &Image) -> Result<Propagated, MaskError> {
        let seen = self.see(image)?;
        let area = seen.fit.area();
        let (probabilities, hidden) = self.segment(&seen)?;
        self.since += 1;
        if self.since >= self.options.remember_every {
            self.memorise(&seen, &probabilities[area..])?;
        } else {
            self.hidden = hidden;
        }
        let mut order: Vec<usize> = (0..self.objects.len()).collect();
        order.sort_by_key(|&at| self.objects[at]);
        let maps = std::iter::once(0).chain(order.iter().map(|at| at + 1));
        let sorted: Vec<f32> = maps
            .flat_map(|map| &probabilities[map * area..][..area])
            .copied()
            .collect();
        Ok(Propagated {
            labels: order.iter().map(|&at| self.objects[at]).collect(),
            width: seen.fit.picture.0,
            height: seen.fit.picture.1,
            probabilities: seen.fit.enlarged(&sorted),
        })
    }
}
