use std::collections::BTreeMap;

use super::depth_view::PixelBox;
use super::options::{ReprojectionOptions, Tolerance};
use super::vote::ReprojectedLabels;
use ostra_core::job::{Progress, Stopped};
use ostra_frames::Image;
use ostra_masks::{LabelId, LabelMask};

/// Decides the mask of a target frame; returns it with each label's confidence, 0–1.
///
/// `image` is that of the target.
pub fn decide(
    evidence: &ReprojectedLabels,
    image: &Image,
    options: &ReprojectionOptions,
    progress: &Progress,
) -> Result<(LabelMask, BTreeMap<LabelId, f32>), Stopped> {
    let votes = &evidence.votes;
    let mut mask = LabelMask::empty(image.width, image.height);
    let mut best = vec![0.0f32; mask.ids.len()];
    let boxes: BTreeMap<LabelId, PixelBox> = (votes.boxes().into_iter())
        .map(|(label, around)| {
            (
                label,
                around.grown(options.margin_px, votes.width, votes.height),
            )
        })
        .collect();
    let Some(all) = boxes.values().copied().reduce(|a, b| a.union(&b)) else {
        return Ok((mask, BTreeMap::new()));
    };
    let edge_affinity = edge_affinity(
        image,
        &evidence.depths,
        all,
        &Tolerance::most(&evidence.target, options),
        options,
    );
    for (label, within) in boxes {
        progress.check()?;
        let part = edge_affinity.part(
            within.left - all.left,
            within.top - all.top,
            within.width(),
            within.height(),
        );
        let label_scores = label_scores(&votes.of(label, within), part, options);
        lay_over(&label_scores, label, within, &mut mask, &mut best);
    }
    let confidence = confidence(&mask, &best);
    Ok((mask, confidence))
}

/// Assigns the label to the pixels that have a higher score than for earlier labels.
fn lay_over(
    label_scores: &[f32],
    label: LabelId,
    within: PixelBox,
    mask: &mut LabelMask,
    best: &mut [f32],
) {
    let full = mask.width as usize;
    for (y, row) in (within.top..within.bottom).zip(label_scores.chunks_exact(within.width())) {
        for (at, &share) in (y * full + within.left..).zip(row) {
            if share > best[at] {
                (mask.ids[at], best[at]) = (label, share);
            }
        }
    }
}

/// Returns the mean score of each label's pixels.
fn confidence(mask: &LabelMask, best: &[f32]) -> BTreeMap<LabelId, f32> {
    let mut sums: BTreeMap<LabelId, (f64, f64)> = BTreeMap::new();
    for (ids, shares) in mask
        .ids
        .iter()
        .zip(best)
        .filter(|&(&id, _)| id != LabelId::NONE)
    {
        let (sum, count) = sums.entry(*ids).or_default();
        *sum += f64::from(*shares);
        *count += 1.0;
    }
    sums.into_iter()
        .map(|(id, (sum, count))| (id, (sum / count).clamp(0.0, 1.0) as f32))
        .collect()
}

/// Returns the score of a label for each pixel of a box, −1 to 1.
///
/// The score combines balance and weight of the pixel's own votes and of votes that reach it over
/// smooth surfaces. It is −1 where no votes reach.
pub fn label_scores(
    votes: &[[f32; 2]],
    edge_affinity: EdgeAffinity,
    options: &ReprojectionOptions,
) -> Vec<f32> {
    let mut spread = votes.to_vec();
    smooth(&mut spread, edge_affinity);
    let decide = |(own, spread): (&[f32; 2], &[f32; 2])| {
        let balance = options.own_weight * own[0] + spread[0];
        let weight = options.own_weight * own[1] + spread[1];
        if weight > options.least_weight {
            balance / weight
        } else {
            -1.0
        }
    };
    votes.iter().zip(&spread).map(decide).collect()
}

/// Number of possible colour differences, summed over channels.
const COLORS: usize = 3 * 255 + 1;

/// Computes how votes pass between neighbouring pixels of a box.
///
/// Less passes over colour edges and depth jumps.
pub fn edge_affinity(
    image: &Image,
    depths: &[f32],
    within: PixelBox,
    tolerance: &Tolerance,
    options: &ReprojectionOptions,
) -> EdgeAffinity {
    let even = shares(0.0, options);
    let jump = shares(options.depth_edge_px, options);
    let depths = bridged(depths, image.width as usize);
    let share = |a: usize, b: usize| {
        let (p, q) = (image.pixels[a], image.pixels[b]);
        let difference: u16 = (0..3).map(|c| u16::from(p[c].abs_diff(q[c]))).sum();
        let (near, far) = (depths[a].min(depths[b]), depths[a].max(depths[b]));
        let jumps = near > 0.0 && far - near > tolerance.at(near);
        if jumps {
            jump[usize::from(difference)]
        } else {
            even[usize::from(difference)]
        }
    };
    let (width, full) = (within.width(), image.width as usize);
    let mut across = vec![0.0; width * within.height()];
    let mut down = across.clone();
    for (y, (across, down)) in (within.top..).zip(
        across
            .chunks_exact_mut(width)
            .zip(down.chunks_exact_mut(width)),
    ) {
        let first = y * full + within.left;
        for (x, across) in across.iter_mut().enumerate().skip(1) {
            *across = share(first + x - 1, first + x);
        }
        if y > within.top {
            for (x, down) in down.iter_mut().enumerate() {
                *down = share(first + x - full, first + x);
            }
        }
    }
    EdgeAffinity {
        width,
        across,
        down,
    }
}

/// Fills each hole with the depth of the nearest pixel that has one.
///
/// A hole between two surfaces then does not connect them.
fn bridged(depths: &[f32], width: usize) -> Vec<f32> {
    let mut bridged = depths.to_vec();
    let mut steps: Vec<u32> = depths
        .iter()
        .map(|&depth| if depth > 0.0 { 0 } else { u32::MAX / 2 })
        .collect();
    let mut take = |at: usize, from: Option<usize>| {
        if let Some(from) = from.filter(|&from| steps[from] + 1 < steps[at]) {
            (steps[at], bridged[at]) = (steps[from] + 1, bridged[from]);
        }
    };
    for at in 0..depths.len() {
        take(at, at.checked_sub(1).filter(|_| at % width > 0));
        take(at, at.checked_sub(width));
    }
    for at in (0..depths.len()).rev() {
        take(
            at,
            Some(at + 1).filter(|next| next % width > 0 && *next < depths.len()),
        );
        take(at, Some(at + width).filter(|&next| next < depths.len()));
    }
    bridged
}

/// Returns the share that passes a step `extra_px` longer, by colour difference.
fn shares(extra_px: f32, options: &ReprojectionOptions) -> [f32; COLORS] {
    let rate = -(2f32.sqrt()) / (options.reach_px * first_round_share());
    std::array::from_fn(|difference| {
        let color = options.color_edge_px * difference as f32 / 255.0;
        (rate * (1.0 + color + extra_px)).exp()
    })
}

/// Share of a value that passes between neighbouring pixels of a box.
///
/// It is 1 on a smooth surface with unlimited reach, and less over edges.
#[derive(Debug, Clone)]
pub struct EdgeAffinity {
    pub width: usize,
    /// From the left neighbour; the first of each row is unused.
    pub across: Vec<f32>,
    /// From the pixel above; the first row is unused.
    pub down: Vec<f32>,
}

impl EdgeAffinity {
    /// Returns the part in a smaller box that starts at column `left`, row `top`.
    pub fn part(&self, left: usize, top: usize, width: usize, height: usize) -> Self {
        let rows = |all: &[f32]| -> Vec<f32> {
            let rows = all.chunks_exact(self.width).skip(top).take(height);
            rows.flat_map(|row| &row[left..left + width])
                .copied()
                .collect()
        };
        Self {
            width,
            across: rows(&self.across),
            down: rows(&self.down),
        }
    }
}

/// Rounds of the filter, each with half the reach of the one before.
const ROUNDS: i32 = 3;

/// Returns the ratio of the first round's standard deviation to that of all rounds.
fn first_round_share() -> f32 {
    3f32.sqrt() * 2f32.powi(ROUNDS - 1) / (4f32.powi(ROUNDS) - 1.0).sqrt()
}

/// Smooths pairs of values within regions of similar appearance.
///
/// This is the recursive filter of E. Gastal and M. Oliveira, *Domain transform for edge-aware
/// image and video processing*, SIGGRAPH 2011. `edge_affinity` is that of the first round.
fn smooth(values: &mut [[f32; 2]], mut edge_affinity: EdgeAffinity) {
    for round in 0..ROUNDS {
        if round > 0 {
            // Half the reach: e^(−2d) is the square of e^(−d).
            edge_affinity
                .across
                .iter_mut()
                .chain(&mut edge_affinity.down)
                .for_each(|share| *share *= *share);
        }
        along_rows(values, &edge_affinity);
        along_columns(values, &edge_affinity);
    }
}

fn blend(to: &mut [f32; 2], from: [f32; 2], share: f32) {
    to[0] += share * (from[0] - to[0]);
    to[1] += share * (from[1] - to[1]);
}

fn along_rows(values: &mut [[f32; 2]], edge_affinity: &EdgeAffinity) {
    for (row, share) in values
        .chunks_exact_mut(edge_affinity.width)
        .zip(edge_affinity.across.chunks_exact(edge_affinity.width))
    {
        for x in 1..row.len() {
            let from = row[x - 1];
            blend(&mut row[x], from, share[x]);
        }
        for x in (1..row.len()).rev() {
            let from = row[x];
            blend(&mut row[x - 1], from, share[x]);
        }
    }
}

fn along_columns(values: &mut [[f32; 2]], edge_affinity: &EdgeAffinity) {
    let width = edge_affinity.width;
    let rows = values.len() / width;
    for y in 1..rows {
        let (above, below) = values.split_at_mut(y * width);
        for ((from, to), share) in above[(y - 1) * width..]
            .iter()
            .zip(below)
            .zip(&edge_affinity.down[y * width..])
        {
            blend(to, *from, *share);
        }
    }
    for y in (1..rows).rev() {
        let (above, below) = values.split_at_mut(y * width);
        for ((to, from), share) in above[(y - 1) * width..]
            .iter_mut()
            .zip(below)
            .zip(&edge_affinity.down[y * width..])
        {
            blend(to, *from, *share);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hole_takes_the_depth_of_the_nearer_side() {
        let depths = [1.0, 0.0, 0.0, 0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        assert_eq!(
            bridged(&depths, 6),
            [1.0, 1.0, 1.0, 3.0, 3.0, 3.0, 1.0, 1.0, 1.0, 3.0, 3.0, 3.0]
        );
        assert_eq!(bridged(&[0.0; 4], 2), [0.0; 4]);
    }

    fn even(width: usize, height: usize, share: f32) -> EdgeAffinity {
        EdgeAffinity {
            width,
            across: vec![share; width * height],
            down: vec![share; width * height],
        }
    }

    #[test]
    fn smoothing_keeps_constants_and_spreads_a_peak_in_all_directions() {
        let mut constant = vec![[2.0, -1.0]; 63];
        smooth(&mut constant, even(9, 7, 0.8));
        assert!(
            constant
                .iter()
                .all(|v| (v[0] - 2.0).abs() < 1e-5 && (v[1] + 1.0).abs() < 1e-5)
        );
        let mut peak = vec![[0.0, 0.0]; 81];
        peak[40] = [1.0, 0.0];
        smooth(&mut peak, even(9, 9, 0.5));
        assert!(peak[40][0] < 1.0 && peak.iter().all(|v| v[0] > 0.0));
        assert!((peak[39][0] / peak[41][0] - 1.0).abs() < 0.2);
    }

    #[test]
    fn values_do_not_pass_an_edge_with_zero_affinity() {
        let mut values = vec![[0.0, 0.0]; 40];
        values[0] = [1.0, 1.0];
        let mut edge_affinity = even(10, 4, 0.9);
        edge_affinity
            .across
            .iter_mut()
            .skip(5)
            .step_by(10)
            .for_each(|share| *share = 0.0);
        smooth(&mut values, edge_affinity);
        assert!((0..40).all(|i| (values[i][0] > 0.0) == (i % 10 < 5)));
    }
}
