use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::wall::{SIZE, camera, pose, seen};
use crate::stereo::DepthEstimate;
use crate::stereo::filter::{FilterOptions, Neighbour, completed};
use crate::stereo::patchmatch::{PosedImage, Tones};

const WIDTH: usize = SIZE.0 as usize;

/// Depth of a rod in front of the wall, half its width, and its colour in front of that of the wall.
const ROD: (f64, f64) = (1.5, 0.02);
const GREEN: [f32; 2] = [-60.0, -60.0];
const RED: [f32; 2] = [0.0, 60.0];

/// Returns the depth of the rod where a view's pixel sees it.
fn rod(view: usize, at: usize) -> Option<f32> {
    let at_px = DVec2::new((at % WIDTH) as f64 + 0.5, (at / WIDTH) as f64 + 0.5);
    let (centre, ray) = (
        pose(view).centre(),
        pose(view).rotation.conjugate() * camera().unproject(at_px).extend(1.0),
    );
    let depth = (ROD.0 - centre.z) / ray.z;
    ((centre + depth * ray).x.abs() <= ROD.1).then_some(depth as f32)
}

/// Returns a view's depth of the wall, with the rod in front if it `knows` of the rod.
fn estimate(view: usize, knows: bool) -> DepthEstimate {
    let mut estimate = DepthEstimate::empty(camera());
    for at in 0..estimate.depths.len() {
        let at_px = DVec2::new((at % WIDTH) as f64 + 0.5, (at / WIDTH) as f64 + 0.5);
        let rod = rod(view, at).filter(|_| knows);
        let towards = if rod.is_some() {
            DVec3::NEG_Z
        } else {
            DVec3::new(0.4, -0.3, -1.0).normalize()
        };
        estimate.depths[at] = rod.unwrap_or(seen(&pose(view), at_px).1 as f32);
        estimate.normals[at] = (127.0 * (pose(view).rotation * towards))
            .round()
            .to_array()
            .map(|value| value as i8);
        estimate.confidence[at] = 255;
    }
    estimate
}

/// Returns a view's image of both, of one grey; of the wall alone unless it `shows` the rod.
fn image(view: usize, shows: bool) -> PosedImage {
    let count = WIDTH * SIZE.1 as usize;
    let chroma = (0..count)
        .map(|at| {
            if shows && rod(view, at).is_some() {
                GREEN
            } else {
                RED
            }
        })
        .collect();
    let tones = Tones {
        width: WIDTH,
        height: SIZE.1 as usize,
        luma: vec![120.0; count],
        chroma,
    };
    PosedImage::new(tones, camera(), pose(view), 60)
}

/// Completes the first view's depth by two others, which know of the rod or not.
fn complete(
    own: &DepthEstimate,
    shows: bool,
    allowed: Option<&[bool]>,
    know: [bool; 2],
) -> DepthEstimate {
    let view = image(0, shows);
    let neighbours: Vec<Neighbour> = [1, 2]
        .into_iter()
        .zip(know)
        .map(|(other, knows)| {
            Neighbour::new(&view, &image(other, true), Arc::new(estimate(other, knows)))
        })
        .collect();
    completed(own, &view, allowed, &neighbours, &FilterOptions::default())
}

/// Returns the share of the first view's pixels of the rod whose depth is the rod's.
fn share_of_rod(depth: &DepthEstimate) -> f64 {
    let rod: Vec<(usize, f32)> = (0..depth.depths.len())
        .filter_map(|at| Some((at, rod(0, at)?)))
        .collect();
    let right = rod
        .iter()
        .filter(|&&(at, truth)| (depth.depths[at] - truth).abs() < 0.002 * truth);
    right.count() as f64 / rod.len() as f64
}

#[test]
fn thin_part_seen_by_others_is_taken_over() {
    let own = estimate(0, false);
    let found = complete(&own, true, None, [true; 2]);
    assert!(
        share_of_rod(&own) == 0.0 && share_of_rod(&found) > 0.95,
        "{}",
        share_of_rod(&found)
    );
    let is_wall = |&at: &usize| rod(0, at).is_none();
    assert!(
        (0..own.depths.len())
            .filter(is_wall)
            .all(|at| found.depths[at] == own.depths[at]),
        "the wall stays"
    );
    let mut unknown = own;
    unknown.depths.fill(0.0);
    let found = complete(&unknown, true, None, [true; 2]);
    assert!(
        share_of_rod(&found) > 0.95,
        "where nothing is known: {}",
        share_of_rod(&found)
    );
}

#[test]
fn depth_seen_by_one_or_not_shown_or_not_allowed_is_not_taken_over() {
    let own = estimate(0, false);
    assert!(
        complete(&own, true, None, [true, false]) == own,
        "a single view may be wrong"
    );
    assert!(
        complete(&own, false, None, [true; 2]) == own,
        "the image does not show it"
    );
    let upper: Vec<bool> = (0..own.depths.len())
        .map(|at| at < own.depths.len() / 2)
        .collect();
    let (found, all) = (
        complete(&own, true, Some(&upper), [true; 2]),
        complete(&own, true, None, [true; 2]),
    );
    for (at, is_requested) in upper.into_iter().enumerate() {
        assert_eq!(
            found.depths[at],
            if is_requested {
                all.depths[at]
            } else {
                own.depths[at]
            },
            "what is asked for alone"
        );
    }
    let mut nearer = own.clone();
    nearer.depths.fill(1.0);
    assert!(
        complete(&nearer, true, None, [true; 2]) == nearer,
        "what lies behind stays behind"
    );
}
