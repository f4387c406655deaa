use std::collections::BTreeSet;

use glam::DVec2;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::view::TiltedView;
use super::*;
use crate::sfm::matching::NearestMatcher;
use crate::sfm::{
    Descriptors, FeatureError, FeatureExtractor, FeatureMatcher, Features, ImageFeatures, Sift,
};

const SIDE: usize = 320;
/// Longest side of an image that is not shrunk.
const MAX_SIDE: usize = 1600;

fn original<'a>(grey: &'a [f32], allowed: Option<&'a [bool]>) -> Original<'a> {
    Original {
        grey,
        size: [SIDE, SIDE],
        allowed,
    }
}

/// Returns round spots of many sizes and shades on grey.
fn spotted(seed: u64) -> Vec<f32> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut grey = vec![0.5; SIDE * SIDE];
    for _ in 0..900 {
        let at = DVec2::new(
            random.random_range(0.0..SIDE as f64),
            random.random_range(0.0..SIDE as f64),
        );
        let (size, shade) = (
            random.random_range(1.5..6.0),
            random.random_range(-0.3..0.3),
        );
        spot(&mut grey, at, size, shade);
    }
    grey
}

fn spot(grey: &mut [f32], at: DVec2, size: f64, shade: f64) {
    let reach = (3.0 * size) as usize;
    let range = |at: f64| (at as usize).saturating_sub(reach)..(at as usize + reach).min(SIDE);
    for y in range(at.y) {
        for x in range(at.x) {
            let distance = (DVec2::new(x as f64, y as f64) + 0.5).distance(at);
            grey[y * SIDE + x] += (shade * (-0.5 * (distance / size).powi(2)).exp()) as f32;
        }
    }
}

/// Returns the image at a third of its width.
fn foreshortened(grey: &[f32]) -> (Vec<f32>, usize) {
    let width = SIDE / 3;
    let mean = |y: usize, x: usize| (0..3).map(|i| grey[y * SIDE + 3 * x + i]).sum::<f32>() / 3.0;
    (
        (0..SIDE)
            .flat_map(|y| (0..width).map(move |x| (y, x)))
            .map(|(y, x)| mean(y, x))
            .collect(),
        width,
    )
}

#[test]
fn view_positions_map_to_the_image() {
    let at = DVec2::new(200.3, 120.8);
    let mut grey = vec![0.0; SIDE * SIDE];
    spot(&mut grey, at, 5.0, 1.0);
    for tilt in Tilt::all() {
        let view = TiltedView::new(&grey, [SIDE, SIDE], tilt, MAX_SIDE);
        let place = |i: usize| DVec2::new((i % view.width) as f64, (i / view.width) as f64) + 0.5;
        let sum: f64 = view.grey.iter().map(|&v| f64::from(v)).sum();
        let mean = view
            .grey
            .iter()
            .enumerate()
            .map(|(i, &v)| f64::from(v) * place(i))
            .sum::<DVec2>()
            / sum;
        assert!(
            view.shows(mean) && view.original(mean).distance(at) < 0.1,
            "{tilt:?}: {}",
            view.original(mean)
        );
        // A tilted image has less of everything.
        let expected = 2.0 * std::f64::consts::PI * 25.0 / tilt.by;
        assert!(
            (sum / expected - 1.0).abs() < 0.02,
            "{tilt:?}: {sum:.1} of {expected:.1}"
        );
    }
}

#[test]
fn positions_in_large_images_are_in_their_own_pixels() {
    let (width, height, at) = (3301, 40, DVec2::new(2001.3, 22.1));
    let shade = |i: usize| {
        let distance = (DVec2::new((i % width) as f64, (i / width) as f64) + 0.5).distance(at);
        (-0.5 * (distance / 4.0).powi(2)).exp() as f32
    };
    let grey: Vec<f32> = (0..width * height).map(shade).collect();
    let view = TiltedView::new(
        &grey,
        [width, height],
        Tilt {
            along: 0.0,
            by: 2.0,
        },
        MAX_SIDE,
    );
    let brightest = (0..view.grey.len())
        .max_by(|&a, &b| view.grey[a].total_cmp(&view.grey[b]))
        .unwrap();
    let found = DVec2::new(
        (brightest % view.width) as f64,
        (brightest / view.width) as f64,
    ) + 0.5;
    assert!(
        view.width < 600 && view.original(found).distance(at) < 4.0,
        "{}",
        view.original(found)
    );
}

#[test]
fn larger_tilts_have_more_directions() {
    let all = Tilt::all();
    let sides = |by: f64| {
        all.iter()
            .filter(|tilt| (tilt.by - by).abs() < 1e-9)
            .count()
    };
    assert_eq!([2f64.sqrt(), 2.0, 8f64.sqrt()].map(sides), [4, 5, 7]);
    assert_eq!(all.len(), 16);
}

#[test]
fn tilted_view_matches_foreshortened_content() {
    let grey = spotted(3);
    let (narrow, width) = foreshortened(&grey);
    let (sift, matcher) = (Sift::default(), NearestMatcher::for_bytes());
    let seen = sift.extract(&narrow, width, SIDE, None).unwrap();
    let right = |found: &Features| {
        let fits = |&(a, b): &(u32, u32)| {
            let (at, narrow) = (found.keypoints[a as usize], seen.keypoints[b as usize]);
            at.distance(narrow * DVec2::new(3.0, 1.0)) < 4.0
        };
        matcher
            .matches(found, &seen)
            .unwrap()
            .iter()
            .filter(|pair| fits(pair))
            .count()
    };
    let plain = right(&sift.extract(&grey, SIDE, SIDE, None).unwrap());
    let tilt = Tilt {
        along: 0.0,
        by: 8f64.sqrt(),
    };
    let asift = right(&tilted_features(&sift, original(&grey, None), tilt, MAX_SIDE).unwrap());
    assert!(
        asift >= 60 && asift > 4 * plain,
        "{plain} without, {asift} with a tilt"
    );
}

/// Finds two keypoints, of which the first one points to the second one.
struct Pointing;

impl FeatureExtractor for Pointing {
    fn name(&self) -> &'static str {
        "pointing"
    }

    fn extract(
        &self,
        _: &[f32],
        width: usize,
        height: usize,
        _: Option<&[bool]>,
    ) -> Result<Features, FeatureError> {
        let mut found = image(&[[40.0, 50.0], [52.0, 41.0]]).features;
        (found.width, found.height) = (width as u32, height as u32);
        found.orientations = vec![(-9f32).atan2(12.0).rem_euclid(std::f32::consts::TAU), 0.0];
        Ok(found)
    }
}

#[test]
fn orientations_in_views_are_turned_into_the_image() {
    for tilt in Tilt::all() {
        let found =
            tilted_features(&Pointing, original(&spotted(4), None), tilt, MAX_SIDE).unwrap();
        let along = found.keypoints[1] - found.keypoints[0];
        let expected = along.to_angle().rem_euclid(std::f64::consts::TAU);
        let angle = f64::from(found.orientations[0]);
        assert!(
            (angle - expected).abs() < 1e-5,
            "{tilt:?}: {angle} {expected}"
        );
    }
}

#[test]
fn features_lie_only_in_allowed_pixels() {
    let allowed: Vec<bool> = (0..SIDE * SIDE).map(|i| i % SIDE < SIDE / 2).collect();
    for tilt in Tilt::all() {
        let (grey, sift) = (spotted(4), Sift::default());
        let found =
            tilted_features(&sift, original(&grey, Some(&allowed)), tilt, MAX_SIDE).unwrap();
        assert!(
            found.keypoints.len() > 50,
            "{tilt:?}: {}",
            found.keypoints.len()
        );
        assert!(
            found
                .keypoints
                .iter()
                .all(|at| at.x < SIDE as f64 / 2.0 + 1.5),
            "{tilt:?}"
        );
    }
}

/// Returns one feature per position, described by its number.
fn image(places: &[[f64; 2]]) -> ImageFeatures {
    let features = Features {
        width: 100,
        height: 100,
        keypoints: places.iter().map(|&at| at.into()).collect(),
        scales_px: vec![1.0; places.len()],
        orientations: vec![0.0; places.len()],
        scores: Vec::new(),
        descriptors: Descriptors::Bytes {
            dim: 2,
            values: (0..places.len()).flat_map(|i| [i as u8; 2]).collect(),
        },
    };
    ImageFeatures {
        features,
        colors: (0..places.len()).map(|i| [i as u8; 3]).collect(),
        unreadable: None,
        kept: None,
    }
}

#[test]
fn keypoints_at_one_position_are_merged() {
    let (own, view) = (
        image(&[[10.0, 10.0], [50.0, 50.0]]),
        image(&[[51.0, 50.9], [70.0, 70.0], [10.0, 12.0]]),
    );
    let mut merged = Merged::new(&own);
    assert_eq!(
        [0, 1, 2].map(|index| merged.number(&view, index)),
        [1, 2, 3]
    );
    assert_eq!(merged.number(&image(&[[70.6, 69.4]]), 0), 2);
    let all = merged.into_image();
    assert_eq!(all.features.keypoints[..2], own.features.keypoints[..]);
    assert_eq!(all.features.keypoints[2..], view.features.keypoints[1..]);
    assert_eq!(
        all.features.descriptors.as_bytes().unwrap(),
        [0, 0, 1, 1, 1, 1, 2, 2]
    );
    assert_eq!(
        (
            all.colors.len(),
            all.colors[3],
            all.features.scales_px.len()
        ),
        (4, [2; 3], 4)
    );
}

#[test]
fn matches_of_many_views_become_one_to_one() {
    // 1 and 7 were matched twice, each of them once with another.
    let pairs = one_to_one([(1, 6), (1, 7), (2, 7), (3, 9), (1, 7), (2, 6)]);
    assert_eq!(pairs, [(1, 7), (2, 6), (3, 9)]);
    let firsts: BTreeSet<u32> = pairs.iter().map(|pair| pair.0).collect();
    assert_eq!(firsts.len(), pairs.len());
}
