use super::super::{Sift, SiftKeypoint, SiftOptions, extract_sift};
use super::{Blob, painted, strewn};
use crate::sfm::FeatureExtractor;
use glam::Vec2;

fn nearest(keypoints: &[SiftKeypoint], at_px: Vec2) -> SiftKeypoint {
    let apart = |keypoint: &&SiftKeypoint| keypoint.at_px.distance(at_px);
    *keypoints
        .iter()
        .min_by(|a, b| apart(a).total_cmp(&apart(b)))
        .unwrap()
}

fn assert_blob_found(
    width: usize,
    height: usize,
    at_px: Vec2,
    sigma_px: f32,
    options: &SiftOptions,
) {
    let grey = painted(
        &[Blob {
            at_px,
            sigma_px,
            contrast: 0.5,
        }],
        width,
        height,
    );
    let found = nearest(
        &extract_sift(&grey, width, height, None, options).keypoints,
        at_px,
    );
    let error = found.at_px - at_px;
    assert!(
        error.length() < 0.02,
        "sigma {sigma_px} at {at_px}: off by {error}"
    );
    // A difference of Gaussians is attributed to the finer of the two.
    let scale_px = sigma_px * (-0.5 / options.scales as f32).exp2();
    assert!(
        (found.scale_px / scale_px - 1.0).abs() < 0.03,
        "sigma {sigma_px}: scale {}",
        found.scale_px
    );
}

#[test]
fn blob_is_found_at_its_position_in_every_octave() {
    for sigma_px in [1.3, 2.6, 5.2, 10.4] {
        for at_px in [
            Vec2::new(101.37, 77.81),
            Vec2::new(98.0, 80.5),
            Vec2::new(110.92, 92.13),
        ] {
            assert_blob_found(210, 170, at_px, sigma_px, &SiftOptions::default());
        }
    }
}

#[test]
fn blob_is_found_when_few_rows_are_kept_at_a_time() {
    for y in [63.8, 127.4, 511.7, 640.3] {
        assert_blob_found(90, 760, Vec2::new(43.3, y), 2.6, &SiftOptions::default());
    }
}

#[test]
fn positions_in_shrunk_images_are_in_original_pixels() {
    let options = SiftOptions {
        max_side: 150,
        ..SiftOptions::default()
    };
    let at_px = Vec2::new(141.4, 122.7);
    let grey = painted(
        &[Blob {
            at_px,
            sigma_px: 9.0,
            contrast: 0.5,
        }],
        300,
        240,
    );
    let found = nearest(
        &extract_sift(&grey, 300, 240, None, &options).keypoints,
        at_px,
    );
    assert!(found.at_px.distance(at_px) < 0.04, "{}", found.at_px);
    assert!(
        (found.scale_px / 9.0 - 1.0).abs() < 0.2,
        "{}",
        found.scale_px
    );
}

#[test]
fn first_octave_can_be_left_out() {
    let grey = painted(&strewn(200, 240, 200), 240, 200);
    let least_scale = |first_octave| {
        let options = SiftOptions {
            first_octave,
            ..SiftOptions::default()
        };
        let keypoints = extract_sift(&grey, 240, 200, None, &options).keypoints;
        keypoints
            .iter()
            .map(|keypoint| keypoint.scale_px)
            .fold(f32::INFINITY, f32::min)
    };
    assert!(least_scale(-1) < 1.6);
    assert!((1.6..3.2).contains(&least_scale(0)));
    assert!(least_scale(1) > 3.2);
}

#[test]
fn features_lie_only_in_the_mask() {
    let grey = painted(&strewn(200, 240, 200), 240, 200);
    let mask: Vec<bool> = (0..240 * 200).map(|pixel| pixel % 240 >= 120).collect();
    let options = SiftOptions::default();
    let (all, some) = (
        extract_sift(&grey, 240, 200, None, &options),
        extract_sift(&grey, 240, 200, Some(&mask), &options),
    );
    let right: Vec<_> = all
        .keypoints
        .into_iter()
        .filter(|keypoint| keypoint.at_px.x >= 120.0)
        .collect();
    assert!(right.len() > 20);
    assert_eq!(some.keypoints, right);
}

#[test]
fn strongest_features_are_kept() {
    let grey = painted(&strewn(300, 240, 200), 240, 200);
    let with = |max_features| {
        extract_sift(
            &grey,
            240,
            200,
            None,
            &SiftOptions {
                max_features,
                ..SiftOptions::default()
            },
        )
    };
    let (all, few) = (with(10_000), with(50));
    assert!(all.keypoints.len() > 100);
    assert_eq!(few.keypoints, all.keypoints[..50]);
    assert_eq!(few.descriptors, all.descriptors[..50]);
    assert!(with(0).keypoints.is_empty());
}

#[test]
fn features_do_not_depend_on_the_number_of_threads() {
    let grey = painted(&strewn(300, 240, 400), 240, 400);
    for scales in [1, 2, 3, 8] {
        let options = SiftOptions {
            max_features: 90,
            scales,
            ..SiftOptions::default()
        };
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| extract_sift(&grey, 240, 400, None, &options))
        };
        let alone = with(1);
        assert_eq!(alone.keypoints.len(), 90);
        for threads in [3, 8] {
            assert_eq!(alone, with(threads), "{scales} scales, {threads} threads");
        }
    }
}

#[test]
fn features_do_not_depend_on_images_before() {
    let [large, small] = [(240, 400), (170, 90)].map(|(width, height)| {
        let grey = painted(&strewn(300, width, height), width, height);
        (grey, width, height)
    });
    let extract = |sift: &Sift, (grey, width, height): &(Vec<f32>, usize, usize)| {
        sift.extract(grey, *width, *height, None).unwrap()
    };
    let sift = Sift::default();
    for image in [&small, &large, &small, &large] {
        assert_eq!(extract(&sift, image), extract(&Sift::default(), image));
    }
}

#[test]
fn empty_images_have_no_features() {
    let options = SiftOptions::default();
    for (width, height) in [(0, 0), (1, 900), (15, 15), (16, 16), (64, 40)] {
        assert!(
            extract_sift(&vec![0.5; width * height], width, height, None, &options)
                .keypoints
                .is_empty()
        );
    }
    assert!(
        extract_sift(&[0.5; 100], 64, 40, None, &options)
            .keypoints
            .is_empty()
    );
}

#[test]
fn blob_is_found_with_any_number_of_scales() {
    for scales in [1, 2, 5, 8] {
        let options = SiftOptions {
            scales,
            ..SiftOptions::default()
        };
        assert_blob_found(210, 170, Vec2::new(101.37, 77.81), 2.6, &options);
    }
}
