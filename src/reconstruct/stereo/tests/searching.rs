use std::sync::Arc;

use super::wall::{BORDER, SIZE, image, pose, seen};
use crate::stereo::StereoEngine;
use crate::stereo::patchmatch::{DepthSearch, PatchMatchOptions, Plane, PlaneMap, Round};
use ostra_core::job::Progress;

fn found(allowed: Option<&[bool]>) -> PlaneMap {
    let sources = [image(1), image(2)];
    let reference = image(0);
    let task = DepthSearch {
        reference: &reference,
        sources: &sources,
        depth_range: [1.5, 6.0],
        seeds: &[],
        allowed,
    };
    StereoEngine::Cpu
        .search(&task, &PatchMatchOptions::default(), &Progress::default())
        .unwrap()
}

/// Returns the median error of depth as a share of it, away from the borders.
fn median_error(found: &PlaneMap) -> f64 {
    let (width, height) = (SIZE.0 as usize, SIZE.1 as usize);
    let inside = |at: &usize| {
        let (x, y) = (at % width, at / width);
        (BORDER..width - BORDER).contains(&x) && (BORDER..height - BORDER).contains(&y)
    };
    let error = |at: usize| {
        let truth = seen(
            &pose(0),
            glam::DVec2::new((at % width) as f64 + 0.5, (at / width) as f64 + 0.5),
        )
        .1;
        (1.0 / f64::from(found.planes[at].inverse_depth) / truth - 1.0).abs()
    };
    let mut errors: Vec<f64> = (0..width * height).filter(inside).map(error).collect();
    errors.sort_unstable_by(f64::total_cmp);
    errors[errors.len() / 2]
}

#[test]
fn slanted_wall_is_found() {
    let error = median_error(&found(None));
    assert!(error < 1e-3, "{error}");
}

#[test]
fn consistent_round_keeps_the_wall() {
    let first = found(None);
    let planes = |index: usize| {
        let raster = image(index).raster(0);
        let plane = |at: usize| {
            let (x, y) = (at % SIZE.0 as usize, at / SIZE.0 as usize);
            let depth = seen(
                &pose(index),
                glam::DVec2::new(x as f64 + 0.5, y as f64 + 0.5),
            )
            .1;
            Plane::from_normal(depth as f32, glam::Vec3::NEG_Z, &raster, x as f32, y as f32)
        };
        let planes: Vec<Plane> = (0..(SIZE.0 * SIZE.1) as usize).map(plane).collect();
        let costs = vec![0.0; planes.len()];
        Some(Arc::new(PlaneMap {
            width: SIZE.0 as usize,
            height: SIZE.1 as usize,
            planes,
            costs,
        }))
    };
    let (reference, sources) = (image(0), [image(1), image(2)]);
    let task = DepthSearch {
        reference: &reference,
        sources: &sources,
        depth_range: [1.5, 6.0],
        seeds: &[],
        allowed: None,
    };
    let options = PatchMatchOptions::default();
    let round = Round {
        start: &first,
        others: &[planes(1), planes(2)],
        before: 0,
    };
    let again = StereoEngine::Cpu
        .search_consistent(&task, &round, &options, &Progress::default())
        .unwrap();
    let error = median_error(&again);
    assert!(error < 1e-3, "{error}");
}

#[test]
fn result_does_not_depend_on_the_number_of_threads() {
    let with = |threads| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap()
            .install(|| found(None))
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn pixels_outside_the_mask_are_not_searched() {
    let allowed: Vec<bool> = (0..SIZE.0 * SIZE.1).map(|at| at % SIZE.0 < 80).collect();
    let masked = found(Some(&allowed));
    let known = |at: usize| masked.planes[at].inverse_depth > 0.0;
    assert!((0..allowed.len()).all(|at| allowed[at] || !known(at)));
    assert!(
        (0..allowed.len())
            .filter(|&at| allowed[at] && known(at))
            .count()
            > 80 * 120 * 9 / 10
    );
}

#[test]
fn stop_ends_the_search() {
    let progress = Progress::default();
    progress.stop();
    let reference = image(0);
    let task = DepthSearch {
        reference: &reference,
        sources: &[image(1)],
        depth_range: [1.5, 6.0],
        seeds: &[],
        allowed: None,
    };
    assert!(
        StereoEngine::Cpu
            .search(&task, &PatchMatchOptions::default(), &progress)
            .is_err()
    );
}
