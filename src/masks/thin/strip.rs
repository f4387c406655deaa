//! The edges left and right of a line, from the colours across it.

use glam::{DVec2, Vec3};
use rayon::prelude::*;

use super::crop::color_at;
use super::ribbon::LinePoint;
use ostra_frames::Image;
use ostra_core::statistics::upper_median;

/// Distance of the samples across the line, in pixels.
const STEP_PX: f64 = 0.5;

/// Points of the line (one a pixel) on each side of one that say what it looks like there.
const WINDOW: usize = 8;

/// What it costs that an edge moves by one sample from one point of the line to the next, in pixels of wrong width.
const BEND_COST: f32 = 0.3;

/// Samples that an edge may move from one point of the line to the next.
const MOST_BEND: usize = 2;

/// How far the edges are from the line on one side (`side` = 1: along the normals, −1: against them), in pixels, not
/// smoothed. The line's own colour is the median of its neighbourhood; the edge is where half of the contrast is
/// reached, and edges of neighbouring points hold together (dynamic programming: Amini, Weymouth and Jain, "Using
/// dynamic programming for solving variational problems in vision", PAMI 1990).
pub(super) fn edge_distances(
    image: &Image,
    line: &[LinePoint],
    side: f64,
    reach_px: f64,
) -> Vec<f64> {
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

/// Half of the ridge's contrast around each point.
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

/// The upper median; the values are reordered.
pub(super) fn median(values: &mut [f32]) -> f32 {
    upper_median(values).unwrap_or(0.0)
}

/// Per point the sample up to which all is the line's: the most pixels like it and the fewest unlike it, with edges that
/// move little from point to point.
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

/// The edge between samples: where the profile crosses half way between its level inside and that just outside.
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

/// The way along the normals to the middle between two edges.
pub(super) fn shift(point: &LinePoint, left_px: f64, right_px: f64) -> DVec2 {
    point.at_px + point.normal * ((right_px - left_px) / 2.0)
}
