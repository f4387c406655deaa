use super::options::FilterOptions;
use crate::stereo::DepthEstimate;

/// What is nearer than a surface by more than this many times the tolerance within it is in front.
const IN_FRONT: f32 = 2.0;

/// Fills short runs of unknown pixels between two of one surface, along rows, then along columns: inverse depth goes
/// evenly from one end to the other; normal and confidence are those of the nearer end. A run is left open where a pixel
/// of it saw something in front (`seen`: the depths before any were left out): a thin part is no gap of its background.
pub fn fill_gaps(estimate: &mut DepthEstimate, seen: &DepthEstimate, options: &FilterOptions) {
    let (width, height) = (estimate.width(), estimate.height());
    for y in 0..height {
        fill_line(estimate, seen, (y * width, 1, width), options);
    }
    for x in 0..width {
        fill_line(estimate, seen, (x, width, height), options);
    }
}

fn fill_line(
    estimate: &mut DepthEstimate,
    seen: &DepthEstimate,
    (first, stride, count): (usize, usize, usize),
    options: &FilterOptions,
) {
    let mut known: Option<usize> = None;
    for i in 0..count {
        if estimate.depths[first + i * stride] <= 0.0 {
            continue;
        }
        if let Some(before) =
            known.filter(|before| (2..=options.gap_pixels + 1).contains(&(i - before)))
        {
            fill_run(
                estimate,
                seen,
                (first, stride),
                [before, i],
                options.surface_tolerance,
            );
        }
        known = Some(i);
    }
}

fn fill_run(
    estimate: &mut DepthEstimate,
    seen: &DepthEstimate,
    (first, stride): (usize, usize),
    [before, after]: [usize; 2],
    tolerance: f32,
) {
    let [start, end] = [before, after].map(|i| first + i * stride);
    let (a, b) = (estimate.depths[start], estimate.depths[end]);
    let steps = (after - before) as f32;
    let in_front =
        |i: usize| seen.depths[first + i * stride] < (1.0 - IN_FRONT * tolerance) * a.min(b);
    if (a - b).abs() > tolerance * a || (before + 1..after).any(in_front) {
        return;
    }
    for i in before + 1..after {
        let share = (i - before) as f32 / steps;
        let (at, nearer) = (first + i * stride, if share < 0.5 { start } else { end });
        estimate.depths[at] = 1.0 / ((1.0 - share) / a + share / b);
        estimate.normals[at] = estimate.normals[nearer];
        estimate.confidence[at] = estimate.confidence[nearer];
    }
}
