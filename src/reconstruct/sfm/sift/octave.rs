//! The pyramid of octaves, and the keypoints of one octave.

use rayon::prelude::*;

use super::blur::{DOUBLING_VARIANCE, Kernel, blur, double, halve};
use super::descriptor::{DescriptorWindow, GRID_REACH};
use super::extrema::find_extrema;
use super::keypoint::{Feature, SiftKeypoint, SiftOptions, Strongest};
use super::orientation::orientations;
use super::refine::{Extremum, FARTHEST, MOST_MOVES, refine};
use super::rows::{Rows, SpareBuffers};

/// Blur of the first level of every octave, in samples of the octave (Lowe 2004, section 3.3).
///
/// The full blur is applied. Lowe subtracts the blur that an image already has, assumed to be 0.5
/// pixels; its noise has none. Applying it in full finds a tenth more true matches in real images.
const FIRST_SIGMA: f32 = 1.6;

/// Returns the blur of level `level` in samples of its octave.
pub(super) fn level_sigma(level: f32, scales: usize) -> f32 {
    FIRST_SIGMA * (level / scales as f32).exp2()
}

/// Returns the blur that takes level `level - 1` to level `level`.
fn step_kernel(level: usize, scales: usize) -> Kernel {
    let [before, after] = [level - 1, level].map(|level| level_sigma(level as f32, scales));
    Kernel::gaussian((after * after - before * before).sqrt())
}

/// Returns the kernels that make the first level of octave -1 from the image.
fn doubling_kernels() -> [Kernel; 2] {
    Kernel::doubling((FIRST_SIGMA * FIRST_SIGMA - DOUBLING_VARIANCE).sqrt())
}

/// Returns the blur that makes the first level of octave 0 from the image.
fn image_kernel() -> Kernel {
    Kernel::gaussian(FIRST_SIGMA)
}

/// Returns the first levels of the requested octaves 0, 1, …, as far as the image is large enough.
pub(super) fn bases(image: &Rows, options: &SiftOptions, spare: &SpareBuffers) -> Vec<Rows> {
    let last = options.first_octave.max(-1) + options.octaves.max(1) as i32 - 1;
    let mut bases = Vec::new();
    if last < 0 {
        return bases;
    }
    let mut base = Rows::new(image.width, image.height, image.height, spare);
    super::blur::blur(image, &image_kernel(), &mut base, 0, image.height);
    let kernel = Kernel::gaussian(FIRST_SIGMA * 3_f32.sqrt());
    for _ in 0..last {
        if base.width.min(base.height) < 2 * SMALLEST_SIDE {
            break;
        }
        let next = halve(&base, &kernel, spare);
        bases.push(std::mem::replace(&mut base, next));
    }
    bases.push(base);
    bases
}

/// Shortest side of an octave in samples; no descriptor fits into a smaller one.
const SMALLEST_SIDE: usize = 12;

/// Rows per task of the search for extrema.
const TASK_ROWS: usize = 16;
/// Maximum number of tasks per block.
const MOST_TASKS: usize = 8;

/// Returns the number of rows by which each level advances.
///
/// No keypoint's surroundings reach farther. Beyond that, a block has as many tasks as there are
/// threads; larger blocks would no longer fit the processor's cache.
fn block_rows(scales: usize) -> usize {
    let coarsest = level_sigma(scales as f32 + FARTHEST, scales);
    let reach = MOST_MOVES as f32 + FARTHEST + GRID_REACH * coarsest;
    let tasks = rayon::current_num_threads().min(MOST_TASKS);
    (reach.ceil() as usize + 2)
        .next_multiple_of(TASK_ROWS)
        .max(tasks * TASK_ROWS)
}

/// One octave of the scale space.
///
/// Its levels are computed block by block of rows: level `l` is at block `k - l` when the first
/// level is at block `k`. Only the rows that are still needed are kept.
pub(super) struct Octave<'a> {
    levels: Vec<Rows>,
    kernels: Vec<Kernel>,
    doubled: Option<(&'a Rows, [Kernel; 2])>,
    describer: DescriptorWindow,
    /// Rows by which each level advances.
    block: usize,
    options: &'a SiftOptions,
    spare: &'a SpareBuffers,
}

impl<'a> Octave<'a> {
    /// Creates the octave whose first level is `base`.
    pub fn of(base: Rows, options: &'a SiftOptions, spare: &'a SpareBuffers) -> Self {
        let (last, block) = (options.scales + 2, block_rows(options.scales));
        let (width, height) = (base.width, base.height);
        let kernels = (1..=last)
            .map(|level| step_kernel(level, options.scales))
            .collect();
        let others =
            (1..=last).map(|level| Rows::new(width, height, (last + 3 - level) * block, spare));
        let levels = std::iter::once(base).chain(others).collect();
        Self {
            levels,
            kernels,
            doubled: None,
            describer: DescriptorWindow::new(),
            block,
            options,
            spare,
        }
    }

    /// Creates the octave of the doubled image.
    pub fn doubled(image: &'a Rows, options: &'a SiftOptions, spare: &'a SpareBuffers) -> Self {
        let held = (options.scales + 5) * block_rows(options.scales);
        let base = Rows::new(2 * image.width, 2 * image.height, held, spare);
        Self {
            doubled: Some((image, doubling_kernels())),
            ..Self::of(base, options, spare)
        }
    }

    /// Adds the features at every extremum that `keypoint` turns into a keypoint to the strongest ones.
    pub fn find(
        mut self,
        keypoint: &(impl Fn(&Extremum) -> Option<SiftKeypoint> + Sync),
        strongest: &mut Strongest,
    ) {
        let blocks = self.levels[0].height.div_ceil(self.block);
        let lag = self.levels.len();
        for step in 0..blocks + lag {
            self.advance(step, blocks);
            if step >= lag {
                let features =
                    self.block_features(step - lag, strongest.least_strength(), keypoint);
                strongest.add(features);
            }
        }
        self.levels
            .into_iter()
            .for_each(|level| self.spare.give(level));
    }

    /// Advances every level to its block of step `step`.
    fn advance(&mut self, step: usize, blocks: usize) {
        let height = self.levels[0].height;
        let rows = self.block;
        let span = |block: usize| (block * rows, ((block + 1) * rows).min(height));
        if let Some((image, kernels)) = &self.doubled
            && step < blocks
        {
            let (first, last) = span(step);
            double(image, kernels, &mut self.levels[0], first, last);
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
            block * self.block,
            ((block + 1) * self.block).min(self.levels[0].height),
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

    /// Returns the features at an extremum, one per orientation.
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
