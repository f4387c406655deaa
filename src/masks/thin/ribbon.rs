//! A line with a width: smoothing along it and filling.

use glam::DVec2;

use super::path::PathPixel;
use super::ridge::Ridge;
use crate::edit::polygon_spans;
use crate::{MaskError, Region, stroke};
use ostra_core::statistics::upper_median;

/// How far positions of the line are smoothed along it (standard deviation, in pixels).
const POSITION_SIGMA_PX: f64 = 2.5;

/// How far its widths are smoothed along it.
const WIDTH_SIGMA_PX: f64 = 3.0;

/// Points before and after one that say how wide the line may be there, and by how much it may be wider than their
/// median: a factor and pixels.
const SURROUNDINGS: usize = 24;
const MOST_SWELL: (f64, f64) = (1.25, 0.5);

/// A point of the line; neighbours are about one pixel apart.
#[derive(Debug, Clone, Copy)]
pub(super) struct LinePoint {
    /// Position in the picture, in pixels.
    pub at_px: DVec2,
    /// Unit vector across the line.
    pub normal: DVec2,
    /// How it lies in the structure.
    pub ridge: Ridge,
}

/// The smooth line through positions that are about a pixel apart; the ends stay.
pub(super) fn smooth_line(places: &[DVec2], ridges: &[Ridge]) -> Vec<LinePoint> {
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

/// Positions and ridges of a path.
pub(super) fn split(path: &[PathPixel]) -> (Vec<DVec2>, Vec<Ridge>) {
    path.iter().map(|pixel| (pixel.at_px, pixel.ridge)).unzip()
}

/// Widths along a line without their noise: a median of five, no more than its surroundings allow (where another thing
/// of the same colour touches, there is no edge), then a Gaussian mean.
pub(super) fn smooth_widths(widths_px: &[f64]) -> Vec<f64> {
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

/// Gaussian means along a list, mirrored through its ends, which stay where they are.
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

/// The pixels whose centres lie between the edges of a line, and those that the line itself goes through, so that it has
/// no gaps however thin it is.
///
/// # Errors
/// [`MaskError::Request`] for positions that are not numbers.
pub(super) fn filled(
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
