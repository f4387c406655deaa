use std::sync::Arc;

use super::wall::{SIZE, camera, image};
use crate::stereo::DepthEstimate;
use crate::stereo::filter::{FilterOptions, Neighbour, filter};

/// Returns a wall at depth 2 with a strip of three columns at `depth` that is not confident enough to be kept.
fn with_strip(depth: f32) -> DepthEstimate {
    let mut wall = DepthEstimate::empty(camera());
    wall.depths.fill(2.0);
    wall.normals.fill([0, 0, -127]);
    wall.confidence.fill(255);
    for at in 0..wall.depths.len() {
        if (70..73).contains(&(at % SIZE.0 as usize)) {
            (wall.depths[at], wall.confidence[at]) = (depth, 0);
        }
    }
    wall
}

/// Filters it with the same image as a neighbour; pixels that are not confident are removed.
fn filtered(depth: f32) -> DepthEstimate {
    let (own, image) = (with_strip(depth), image(0));
    let neighbour = Neighbour::new(&image, &image, Arc::new(own.clone()));
    filter(&own, &[neighbour], &FilterOptions::default())
}

#[test]
fn gap_in_a_wall_is_filled_but_not_over_a_thin_part() {
    let strip = |estimate: &DepthEstimate| estimate.depths[60 * SIZE.0 as usize + 71];
    assert_eq!(strip(&filtered(1.0)), 0.0);
    assert_eq!(strip(&filtered(3.0)), 2.0);
}

#[test]
fn only_large_confident_surfaces_are_kept() {
    let (width, patch) = (SIZE.0 as usize, 5);
    let mut wall = with_strip(1.0);
    // A small patch in front of the wall, left of the strip.
    let is_patch = |at: usize| {
        let (x, y) = (at % width, at / width);
        (20..20 + patch).contains(&x) && (40..40 + patch).contains(&y)
    };
    let patch_at: Vec<usize> = (0..wall.depths.len()).filter(|&at| is_patch(at)).collect();
    patch_at.iter().for_each(|&at| wall.depths[at] = 1.5);
    let known = |estimate: &DepthEstimate| estimate.depths.iter().filter(|&&z| z > 0.0).count();
    let confident = wall
        .confidence
        .iter()
        .filter(|&&value| value >= 160)
        .count();

    let mut all = wall.clone();
    all.keep_surfaces(160, patch * patch, 0.01);
    assert_eq!(known(&all), confident, "the strip is not confident");

    let mut large = wall.clone();
    large.keep_surfaces(160, patch * patch + 1, 0.01);
    assert_eq!(known(&large), confident - patch * patch);
    assert!(patch_at.iter().all(|&at| large.depths[at] == 0.0));
}
