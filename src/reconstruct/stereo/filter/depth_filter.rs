//! Filtering: keeps depths that other views agree with, on surfaces of some size, and fills small
//! gaps.

use rayon::prelude::*;

use super::complete::FilterOptions;
use super::consistency::{Neighbour, PixelPoint};
use crate::stereo::DepthEstimate;

/// Keeps the depths that enough neighbours agree with, removes speckles and fills small gaps.
#[must_use]
pub fn filter(
    own: &DepthEstimate,
    neighbours: &[Neighbour],
    options: &FilterOptions,
) -> DepthEstimate {
    let width = own.width().max(1);
    let needed = options.min_agreeing.clamp(1, neighbours.len().max(1));
    let least = (255.0 * options.min_confidence) as u8;
    let agreeing = |at: usize| {
        let depth = own.depths[at];
        if depth <= 0.0 || own.confidence[at] < least {
            return 0;
        }
        let point = PixelPoint::new(at, width, 1.0 / depth, own.normal(at));
        let agrees =
            |neighbour: &&Neighbour| neighbour.matched(&point, &options.agreement).is_some();
        neighbours.iter().filter(agrees).count() as u8
    };
    let support: Vec<u8> = (0..own.depths.len())
        .into_par_iter()
        .map(agreeing)
        .collect();
    let mut kept = own.clone();
    (0..support.len())
        .filter(|&at| usize::from(support[at]) < needed)
        .for_each(|at| kept.clear(at));
    remove_speckles(
        &mut kept,
        &support,
        options.min_support,
        options.surface_tolerance,
    );
    fill_gaps(&mut kept, own, options);
    kept
}

/// A depth is in front of a surface if it is nearer by more than this many times the tolerance within the surface.
const IN_FRONT: f32 = 2.0;

/// Fills short runs of unknown pixels between two pixels of one surface, along rows, then along columns.
///
/// Inverse depth is interpolated linearly; normal and confidence are those of the nearer end. A run
/// stays open if one of its pixels saw something in front (`seen`: the depths before any were
/// removed): a thin part is not a gap of its background.
fn fill_gaps(estimate: &mut DepthEstimate, seen: &DepthEstimate, options: &FilterOptions) {
    let (width, height) = (estimate.width(), estimate.height());
    for y in 0..height {
        let row = PixelLine {
            first: y * width,
            stride: 1,
            count: width,
        };
        fill_line(estimate, seen, row, options);
    }
    for x in 0..width {
        let column = PixelLine {
            first: x,
            stride: width,
            count: height,
        };
        fill_line(estimate, seen, column, options);
    }
}

/// A row or column of pixels.
#[derive(Clone, Copy)]
struct PixelLine {
    /// Index of the first pixel.
    first: usize,
    /// Distance of pixels by index.
    stride: usize,
    /// Number of pixels.
    count: usize,
}

impl PixelLine {
    /// Returns the index of a pixel of the line.
    #[inline(always)]
    fn at(self, i: usize) -> usize {
        self.first + i * self.stride
    }
}

fn fill_line(
    estimate: &mut DepthEstimate,
    seen: &DepthEstimate,
    line: PixelLine,
    options: &FilterOptions,
) {
    let mut known: Option<usize> = None;
    for i in 0..line.count {
        if estimate.depths[line.at(i)] <= 0.0 {
            continue;
        }
        if let Some(before) =
            known.filter(|before| (2..=options.gap_pixels + 1).contains(&(i - before)))
        {
            fill_run(estimate, seen, line, [before, i], options.surface_tolerance);
        }
        known = Some(i);
    }
}

fn fill_run(
    estimate: &mut DepthEstimate,
    seen: &DepthEstimate,
    line: PixelLine,
    [before, after]: [usize; 2],
    tolerance: f32,
) {
    let [start, end] = [before, after].map(|i| line.at(i));
    let (a, b) = (estimate.depths[start], estimate.depths[end]);
    let steps = (after - before) as f32;
    let in_front = |i: usize| seen.depths[line.at(i)] < (1.0 - IN_FRONT * tolerance) * a.min(b);
    if (a - b).abs() > tolerance * a || (before + 1..after).any(in_front) {
        return;
    }
    for i in before + 1..after {
        let share = (i - before) as f32 / steps;
        let (at, nearer) = (line.at(i), if share < 0.5 { start } else { end });
        estimate.depths[at] = 1.0 / ((1.0 - share) / a + share / b);
        estimate.normals[at] = estimate.normals[nearer];
        estimate.confidence[at] = estimate.confidence[nearer];
    }
}

impl DepthEstimate {
    /// Clears all depths but those of connected surfaces of at least `pixels` pixels.
    ///
    /// Pixels below the confidence `least`, 0–255, are cleared first. Neighbouring pixels belong to
    /// one surface if their depths differ by at most the share `tolerance`, 0–1.
    pub fn keep_surfaces(&mut self, least: u8, pixels: usize, tolerance: f32) {
        for at in 0..self.depths.len() {
            if self.confidence[at] < least {
                self.clear(at);
            }
        }
        let support = vec![1; self.depths.len()];
        remove_speckles(self, &support, pixels, tolerance);
    }
}

/// Removes connected surfaces that other views support too little.
///
/// A small surface stays if many views see it, as for the pieces of a thin part. `support` counts
/// the views by pixel; `least` is the required sum over a surface.
fn remove_speckles(estimate: &mut DepthEstimate, support: &[u8], least: usize, tolerance: f32) {
    let mut seen = vec![false; estimate.depths.len()];
    let mut surface = Vec::new();
    for start in 0..seen.len() {
        if seen[start] || estimate.depths[start] <= 0.0 {
            continue;
        }
        grow(estimate, start, tolerance, &mut seen, &mut surface);
        if surface
            .iter()
            .map(|&at| usize::from(support[at]))
            .sum::<usize>()
            < least
        {
            surface.iter().for_each(|&at| estimate.clear(at));
        }
    }
}

/// Returns the pixels that form one surface with a pixel.
fn grow(
    estimate: &DepthEstimate,
    start: usize,
    tolerance: f32,
    seen: &mut [bool],
    surface: &mut Vec<usize>,
) {
    let (width, height) = (estimate.width(), estimate.height());
    surface.clear();
    surface.push(start);
    seen[start] = true;
    let mut next = 0;
    while let Some(&at) = surface.get(next) {
        next += 1;
        let (x, y) = (at % width, at / width);
        let (columns, rows) = (
            x.saturating_sub(1)..(x + 2).min(width),
            y.saturating_sub(1)..(y + 2).min(height),
        );
        for to in rows.flat_map(|row| columns.clone().map(move |column| row * width + column)) {
            let (depth, other) = (estimate.depths[at], estimate.depths[to]);
            if !seen[to] && other > 0.0 && (other - depth).abs() <= tolerance * depth {
                seen[to] = true;
                surface.push(to);
            }
        }
    }
}
