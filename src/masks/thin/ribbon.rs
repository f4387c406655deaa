//! A line with a width: the edges left and right of it, smoothing along it, and filling.
//!
//! The edges are found from the colours across the line.

use glam::{DVec2, Vec3};
use rayon::prelude::*;

use super::path::PathPixel;
use super::ridge::{Ridge, color_at};
use crate::edit::polygon_spans;
use crate::{MaskError, Region, stroke};
use ostra_core::statistics::upper_median;
use ostra_frames::Image;

/// Standard deviation by which positions are smoothed along the line, pixels.
const POSITION_SIGMA_PX: f64 = 2.5;

/// Standard deviation by which widths are smoothed along the line, pixels.
const WIDTH_SIGMA_PX: f64 = 3.0;

/// Number of points before and after a point that limit its width.
///
/// [`MOST_SWELL`] is the limit relative to their median: a factor, plus pixels.
const SURROUNDINGS: usize = 24;
const MOST_SWELL: (f64, f64) = (1.25, 0.5);

/// Number of times the edges are measured.
///
/// In between, the line is moved to the middle between its edges.
const ROUNDS: usize = 2;

/// A line with its edges.
#[derive(Debug, Clone)]
pub(crate) struct Ribbon {
    line: Vec<LinePoint>,
    /// Distances of the left and the right edge from the line, pixels.
    edges_px: [Vec<f64>; 2],
}

impl Ribbon {
    /// Measures the edges of a line through positions that are about one pixel apart.
    ///
    /// Edges are searched up to `reach_px` from the line.
    pub(super) fn fit(image: &Image, places: &[DVec2], ridges: &[Ridge], reach_px: f64) -> Self {
        let edges_of = |line: &[LinePoint]| {
            [-1.0, 1.0].map(|side| smooth_widths(&edge_distances(image, line, side, reach_px)))
        };
        let mut line = smooth_line(places, ridges);
        let mut edges_px = edges_of(&line);
        for _ in 1..ROUNDS {
            let middles = line
                .iter()
                .enumerate()
                .map(|(at, point)| shift(point, edges_px[0][at], edges_px[1][at]));
            line = smooth_line(&middles.collect::<Vec<_>>(), ridges);
            edges_px = edges_of(&line);
        }
        Self { line, edges_px }
    }

    /// Returns the length of the line, pixels.
    pub fn length_px(&self) -> f64 {
        let steps = self.line.windows(2);
        steps
            .map(|ends| ends[0].at_px.distance(ends[1].at_px))
            .sum()
    }

    /// Returns the mean width, pixels.
    pub fn mean_width_px(&self) -> f64 {
        let sum: f64 = self.edges_px.iter().flatten().sum();
        sum / self.line.len().max(1) as f64
    }

    /// Returns the mean contrast of the line, ΔE.
    pub fn mean_contrast(&self) -> f32 {
        let sum: f32 = self.line.iter().map(|point| point.ridge.contrast).sum();
        sum / self.line.len().max(1) as f32
    }

    /// Returns the pixels of an image that is `factor` times as large as the one measured.
    ///
    /// # Errors
    /// [`MaskError::Request`] for positions that are not numbers.
    pub fn region(&self, width: u32, height: u32, factor: usize) -> Result<Region, MaskError> {
        let factor = factor as f64;
        let scaled = |point: &LinePoint| LinePoint {
            at_px: point.at_px * factor,
            ..*point
        };
        let line: Vec<LinePoint> = self.line.iter().map(scaled).collect();
        let edges_px = self
            .edges_px
            .each_ref()
            .map(|edge| edge.iter().map(|by| by * factor).collect::<Vec<_>>());
        filled(width, height, &line, [&edges_px[0], &edges_px[1]])
    }
}

/// A point of the line; neighbours are about one pixel apart.
#[derive(Debug, Clone, Copy)]
struct LinePoint {
    /// Position in the image, pixels.
    at_px: DVec2,
    /// Unit vector across the line.
    normal: DVec2,
    /// Ridge at this point.
    ridge: Ridge,
}

/// Returns a smooth line through positions that are about one pixel apart; the ends stay.
fn smooth_line(places: &[DVec2], ridges: &[Ridge]) -> Vec<LinePoint> {
    let smooth = smoothed(places, POSITION_SIGMA_PX);
    let normal = |at: usize| {
        let (before, after) = (
            smooth[at.saturating_sub(2)],
            smooth[(at + 2).min(smooth.len() - 1)],
        );
        (after - before).normalize_or(DVec2::X).perp()
    };
    let point = |(at, (&at_px, &ridge))| LinePoint {
        at_px,
        normal: normal(at),
        ridge,
    };
    smooth.iter().zip(ridges).enumerate().map(point).collect()
}

/// Splits a path into positions and ridges.
pub(super) fn split(path: &[PathPixel]) -> (Vec<DVec2>, Vec<Ridge>) {
    path.iter().map(|pixel| (pixel.at_px, pixel.ridge)).unzip()
}

/// Removes noise from the widths along a line.
///
/// Takes a median of five, limits it by the surroundings (where an object of the same colour
/// touches the line, there is no edge), and then takes a Gaussian mean.
fn smooth_widths(widths_px: &[f64]) -> Vec<f64> {
    let median = |at: usize, reach: usize| {
        let mut near =
            widths_px[at.saturating_sub(reach)..(at + reach + 1).min(widths_px.len())].to_vec();
        upper_median(&mut near).unwrap_or(0.0)
    };
    let settled = |at| median(at, 2).min(median(at, SURROUNDINGS) * MOST_SWELL.0 + MOST_SWELL.1);
    let settled: Vec<DVec2> = (0..widths_px.len())
        .map(|at| DVec2::splat(settled(at)))
        .collect();
    smoothed(&settled, WIDTH_SIGMA_PX)
        .iter()
        .map(|width| width.x)
        .collect()
}

/// Returns Gaussian means along a list, mirrored at its ends, which keep their values.
fn smoothed(values: &[DVec2], sigma: f64) -> Vec<DVec2> {
    let last = values.len() as isize - 1;
    let value = |at: isize| match at {
        _ if at < 0 => 2.0 * values[0] - values[(-at).min(last) as usize],
        _ if at > last => 2.0 * values[last as usize] - values[(2 * last - at).max(0) as usize],
        _ => values[at as usize],
    };
    let reach = (3.0 * sigma).ceil() as isize;
    let weights: Vec<f64> = (-reach..=reach)
        .map(|off| (-0.5 * (off as f64 / sigma).powi(2)).exp())
        .collect();
    let sum: f64 = weights.iter().sum();
    let mean = |at: isize| {
        (-reach..=reach)
            .zip(&weights)
            .map(|(off, &weight)| value(at + off) * weight)
            .sum::<DVec2>()
            / sum
    };
    (0..=last).map(mean).collect()
}

/// Returns the pixels whose centres lie between the edges of a line.
///
/// Pixels that the line itself crosses are included, so that it has no gaps however thin it is.
///
/// # Errors
/// [`MaskError::Request`] for positions that are not numbers.
fn filled(
    width: u32,
    height: u32,
    line: &[LinePoint],
    [left_px, right_px]: [&[f64]; 2],
) -> Result<Region, MaskError> {
    let places: Vec<DVec2> = line.iter().map(|point| point.at_px).collect();
    let mut region = stroke(width, height, &places, f64::MIN_POSITIVE)?;
    let edge = |at: usize, by: f64| line[at].at_px + line[at].normal * by;
    for at in 1..line.len() {
        let quad = vec![
            edge(at - 1, -left_px[at - 1]),
            edge(at, -left_px[at]),
            edge(at, right_px[at]),
            edge(at - 1, right_px[at - 1]),
        ];
        polygon_spans(width, height, &[quad], |pixels| {
            region.inside[pixels].fill(true);
        })?;
    }
    Ok(region)
}

/// Distance of the samples across the line, pixels.
const STEP_PX: f64 = 0.5;

/// Number of points on each side of a point that determine its local colour and contrast.
const WINDOW: usize = 8;

/// Cost of moving an edge by one sample between neighbouring points, in pixels of wrong width.
const BEND_COST: f32 = 0.3;

/// Maximum number of samples by which an edge may move between neighbouring points.
const MOST_BEND: usize = 2;

/// Returns the distance of the edge on one side for every point of the line, in pixels.
///
/// Distances are not smoothed. `side` is 1 along the normals and −1 against them. The line's own
/// colour is the median of its neighbourhood; the edge is where half of the contrast is reached.
/// Edges of neighbouring points are coupled by dynamic programming (Amini, Weymouth and Jain,
/// "Using dynamic programming for solving variational problems in vision", PAMI 1990).
fn edge_distances(image: &Image, line: &[LinePoint], side: f64, reach_px: f64) -> Vec<f64> {
    let count = (reach_px / STEP_PX) as usize + 1;
    let cores = window_medians(
        &line
            .iter()
            .map(|point| color_at(image, point.at_px))
            .collect::<Vec<_>>(),
    );
    let profiles: Vec<Vec<f32>> = line
        .par_iter()
        .zip(&cores)
        .map(|(point, &core)| {
            let place = |k: usize| point.at_px + point.normal * (side * STEP_PX * k as f64);
            (0..count)
                .map(|k| color_at(image, place(k)).distance(core))
                .collect()
        })
        .collect();
    let chosen = best_edges(&profiles, &half_contrasts(line));
    chosen
        .iter()
        .zip(&profiles)
        .map(|(&edge, profile)| refined(profile, edge) * STEP_PX)
        .collect()
}

/// Returns half of the ridge's contrast around each point.
fn half_contrasts(line: &[LinePoint]) -> Vec<f32> {
    let contrasts: Vec<f32> = line.iter().map(|point| point.ridge.contrast).collect();
    let around = |at: usize| median(&mut contrasts[window(at, contrasts.len())].to_vec());
    (0..contrasts.len())
        .map(|at| (around(at) / 2.0).max(1.0))
        .collect()
}

fn window_medians(colors: &[Vec3]) -> Vec<Vec3> {
    let channel = |at: usize, k: usize| {
        let mut values: Vec<f32> = colors[window(at, colors.len())]
            .iter()
            .map(|color| color[k])
            .collect();
        median(&mut values)
    };
    (0..colors.len())
        .map(|at| Vec3::new(channel(at, 0), channel(at, 1), channel(at, 2)))
        .collect()
}

fn window(at: usize, count: usize) -> std::ops::Range<usize> {
    at.saturating_sub(WINDOW)..(at + WINDOW + 1).min(count)
}

/// Returns the upper median; reorders the values.
pub(super) fn median(values: &mut [f32]) -> f32 {
    upper_median(values).unwrap_or(0.0)
}

/// Returns the edge of each point as a number of samples that belong to the line.
///
/// Maximises similar pixels inside minus dissimilar ones, with edges that move little between
/// neighbouring points.
fn best_edges(profiles: &[Vec<f32>], halves: &[f32]) -> Vec<usize> {
    let count = profiles[0].len();
    let mut total = vec![0.0; count];
    let mut came_from: Vec<Vec<usize>> = Vec::with_capacity(profiles.len());
    for (profile, &half) in profiles.iter().zip(halves) {
        let from: Vec<usize> = (0..count).map(|k| best_before(&total, k)).collect();
        let mut gained = 0.0;
        let next = (0..count).map(|k| {
            let value = total[from[k]] - BEND_COST * from[k].abs_diff(k) as f32 + gained;
            gained += (1.0 - profile[k] / half).clamp(-1.0, 1.0) * STEP_PX as f32;
            value
        });
        total = next.collect();
        came_from.push(from);
    }
    let last = (0..count)
        .max_by(|&a, &b| total[a].total_cmp(&total[b]))
        .unwrap_or(0);
    let mut edges = vec![last; profiles.len()];
    for at in (1..profiles.len()).rev() {
        edges[at - 1] = came_from[at][edges[at]];
    }
    edges
}

fn best_before(total: &[f32], k: usize) -> usize {
    let near = k.saturating_sub(MOST_BEND)..(k + MOST_BEND + 1).min(total.len());
    let worth = |from: usize| total[from] - BEND_COST * from.abs_diff(k) as f32;
    near.max_by(|&a, &b| {
        worth(a)
            .total_cmp(&worth(b))
            .then(b.abs_diff(k).cmp(&a.abs_diff(k)))
    })
    .unwrap_or(k)
}

/// Refines an edge between samples.
///
/// The edge is where the profile crosses the middle between its level inside and its level just
/// outside.
fn refined(profile: &[f32], edge: usize) -> f64 {
    const NEAR: usize = 4;
    let outside = edge..(edge + NEAR).min(profile.len());
    let inside = &profile[edge.saturating_sub(NEAR)..=edge.min(profile.len() - 1)];
    let low = inside.iter().copied().fold(f32::INFINITY, f32::min);
    let high = profile[outside].iter().copied().fold(0.0, f32::max);
    let half = (low + high) / 2.0;
    let first = edge.saturating_sub(NEAR);
    let crossing = (first..(edge + NEAR).min(profile.len() - 1))
        .filter(|&k| profile[k] <= half && profile[k + 1] > half)
        .min_by_key(|&k| k.abs_diff(edge));
    let between =
        |k: usize| k as f64 + f64::from((half - profile[k]) / (profile[k + 1] - profile[k]));
    crossing.map_or(edge as f64, between)
}

/// Moves a point along its normal to the middle between two edges.
fn shift(point: &LinePoint, left_px: f64, right_px: f64) -> DVec2 {
    point.at_px + point.normal * ((right_px - left_px) / 2.0)
}
