use super::blur::{blur, double};
use super::descriptor::Describer;
use super::extrema::find_extrema;
use super::kernel::Kernel;
use super::keypoint::SiftKeypoint;
use super::options::SiftOptions;
use super::orientation::orientations;
use super::pyramid::{doubling_kernels, level_sigma, step_kernel};
use super::refine::{Extremum, refine};
use super::rows::Rows;
use super::strongest::{Feature, Strongest};
use rayon::prelude::*;

/// Rows that each level moves on by; no keypoint's surroundings reach farther.
const BLOCK: usize = 128;
/// Rows per task of the search for extrema.
const TASK_ROWS: usize = 16;

/// One octave of the scale space. Its levels pass through block by block of rows: level `l` is at block `k - l` when
/// the first level is at block `k`, and only the rows that are still needed are held.
pub(super) struct Octave<'a> {
    levels: Vec<Rows>,
    kernels: Vec<Kernel>,
    doubled: Option<(&'a Rows, [Kernel; 2])>,
    describer: Describer,
    options: &'a SiftOptions,
}

impl<'a> Octave<'a> {
    /// The octave whose first level is `base`.
    pub fn of(base: Rows, options: &'a SiftOptions) -> Self {
        Self::new(base, None, options)
    }

    /// The octave of the doubled picture.
    pub fn doubled(picture: &'a Rows, options: &'a SiftOptions) -> Self {
        let held = (options.scales + 5) * BLOCK;
        let base = Rows::new(2 * picture.width, 2 * picture.height, held);
        Self::new(base, Some((picture, doubling_kernels())), options)
    }

    fn new(base: Rows, doubled: Option<(&'a Rows, [Kernel; 2])>, options: &'a SiftOptions) -> Self {
        let last = options.scales + 2;
        let (width, height) = (base.width, base.height);
        let kernels = (1..=last)
            .map(|level| step_kernel(level, options.scales))
            .collect();
        let others = (1..=last).map(|level| Rows::new(width, height, (last + 3 - level) * BLOCK));
        let levels = std::iter::once(base).chain(others).collect();
        Self {
            levels,
            kernels,
            doubled,
            describer: Describer::new(),
            options,
        }
    }

    /// Lets the strongest have the features at every extremum that `keypoint` turns into a keypoint.
    pub fn find(
        mut self,
        keypoint: &(impl Fn(&Extremum) -> Option<SiftKeypoint> + Sync),
        strongest: &mut Strongest,
    ) {
        let blocks = self.levels[0].height.div_ceil(BLOCK);
        let lag = self.levels.len();
        for step in 0..blocks + lag {
            self.advance(step, blocks);
            if step >= lag {
                let features =
                    self.block_features(step - lag, strongest.least_strength(), keypoint);
                strongest.add(features);
            }
        }
    }

    /// Moves every level on to its block of step `step`.
    fn advance(&mut self, step: usize, blocks: usize) {
        let height = self.levels[0].height;
        let span = |block: usize| (block * BLOCK, ((block + 1) * BLOCK).min(height));
        if let Some((picture, kernels)) = &self.doubled
            && step < blocks
        {
            let (first, last) = span(step);
            double(picture, kernels, &mut self.levels[0], first, last);
        }
        for level in 1..self.levels.len() {
            let Some(block) = step.checked_sub(level).filter(|&block| block < blocks) else {
                continue;
            };
            let (first, last) = span(block);
            let (finer, coarser) = self.levels.split_at_mut(level);
            blur(
                &finer[level - 1],
                &self.kernels[level - 1],
                &mut coarser[0],
                first,
                last,
            );
        }
    }

    fn block_features(
        &self,
        block: usize,
        least_strength: f32,
        keypoint: &(impl Fn(&Extremum) -> Option<SiftKeypoint> + Sync),
    ) -> Vec<Feature> {
        let (first, last) = (
            block * BLOCK,
            ((block + 1) * BLOCK).min(self.levels[0].height),
        );
        let starts: Vec<usize> = (first..last).step_by(TASK_ROWS).collect();
        let extrema = starts.par_iter().flat_map_iter(|&start| {
            find_extrema(
                &self.levels,
                start,
                (start + TASK_ROWS).min(last),
                self.options.peak_threshold,
            )
            .into_iter()
            .filter_map(|candidate| refine(&self.levels, candidate, self.options))
            .filter(|extremum| extremum.strength >= least_strength)
            .filter_map(|extremum| keypoint(&extremum).map(|keypoint| (extremum, keypoint)))
        });
        let extrema: Vec<(Extremum, SiftKeypoint)> = extrema.collect();
        extrema
            .par_iter()
            .flat_map_iter(|(extremum, keypoint)| self.described(extremum, *keypoint))
            .collect()
    }

    /// The features at an extremum, one per orientation.
    fn described(&self, extremum: &Extremum, keypoint: SiftKeypoint) -> Vec<Feature> {
        let level = &self.levels[extremum.level];
        let sigma = level_sigma(extremum.scale, self.options.scales);
        let feature = |angle| Feature {
            keypoint: SiftKeypoint { angle, ..keypoint },
            strength: extremum.strength,
            descriptor: self.describer.describe(level, extremum, sigma, angle),
        };
        orientations(level, extremum, sigma, self.options.max_orientations)
            .into_iter()
            .map(feature)
            .collect()
    }
}
