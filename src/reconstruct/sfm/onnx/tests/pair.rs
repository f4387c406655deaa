use std::path::Path;

use super::super::{LighterGlue, LighterGlueOptions, XFeat, XFeatOptions};
use super::view::View;
use super::{data, networks};
use crate::sfm::{Descriptors, FeatureError, FeatureExtractor, FeatureMatcher, Features};

fn xfeat(folder: &Path, options: XFeatOptions) -> XFeat {
    XFeat::load(folder, options).unwrap()
}

fn features(xfeat: &XFeat, view: &View) -> Features {
    xfeat
        .extract(&view.grey, view.width, view.height, None)
        .unwrap()
}

fn rows(features: &Features) -> Vec<&[f32]> {
    let Descriptors::Floats { dim: 64, values } = &features.descriptors else {
        panic!("64 floats")
    };
    values.chunks_exact(64).collect()
}

/// Matches mutually nearest descriptors with a cosine above 0.82, as the paper does.
fn mutual(first: &Features, second: &Features) -> Vec<(u32, u32)> {
    let (first, second) = (rows(first), rows(second));
    let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
    let nearest = |row: &[f32], among: &[&[f32]]| {
        let cosines = among.iter().map(|other| dot(row, other));
        cosines
            .enumerate()
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .unwrap()
    };
    let back: Vec<usize> = second.iter().map(|row| nearest(row, &first).0).collect();
    let there = first.iter().map(|row| nearest(row, &second)).enumerate();
    let confidence = there.filter(|&(at, (other, cosine))| cosine > 0.82 && back[other] == at);
    confidence
        .map(|(at, (other, _))| (at as u32, other as u32))
        .collect()
}

fn share_within(errors: &[f64], most_px: f64) -> f64 {
    errors.iter().filter(|&&error| error < most_px).count() as f64 / errors.len() as f64
}

#[test]
#[ignore = "needs real data sets (OSTRA_DATA), networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
fn matches_agree_with_the_true_geometry() {
    let (models, data) = (networks(), data());
    let views = [20, 21].map(|index| View::read(&data.join("dtu_scan24"), index));
    let xfeat = xfeat(
        &models,
        XFeatOptions {
            most: 1500,
            ..XFeatOptions::default()
        },
    );
    let found = views.each_ref().map(|view| features(&xfeat, view));
    let glue = LighterGlue::load(&models, LighterGlueOptions::default()).unwrap();
    let glued = glue.matches(&found[0], &found[1]).unwrap();
    assert_eq!(
        glued,
        glue.matches(&found[0], &found[1]).unwrap(),
        "the same again"
    );
    for (name, matches, least) in [
        ("nearest", mutual(&found[0], &found[1]), 350),
        ("LighterGlue", glued, 350),
    ] {
        assert!(
            matches.is_sorted_by(|a, b| a.0 < b.0),
            "{name}: ascending and once"
        );
        let errors = views[0].errors(&views[1], [&found[0], &found[1]], &matches);
        let near: Vec<f64> = errors
            .iter()
            .copied()
            .filter(|&error| error < 2.0)
            .collect();
        let reported = format!(
            "{name}: {} matches, {} within 2 px, median of all {}",
            errors.len(),
            near.len(),
            errors[errors.len() / 2]
        );
        println!("{reported}");
        assert!(
            near.len() >= least && share_within(&errors, 2.0) > 0.6,
            "{reported}"
        );
        assert!(
            near[near.len() / 2] < 0.35,
            "median of those within 2 px: {}",
            near[near.len() / 2]
        );
    }
}

#[test]
#[ignore = "needs real data sets (OSTRA_DATA), networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
fn refinement_brings_keypoints_nearer_to_the_true_geometry() {
    let (models, data) = (networks(), data());
    let views = [20, 21].map(|index| View::read(&data.join("dtu_scan24"), index));
    let xfeat = xfeat(
        &models,
        XFeatOptions {
            most: 1500,
            ..XFeatOptions::default()
        },
    );
    let found = views.each_ref().map(|view| features(&xfeat, view));
    let matches = mutual(&found[0], &found[1]);
    let whole = found.clone().map(|mut features| {
        features
            .keypoints
            .iter_mut()
            .for_each(|at| *at = at.floor() + 0.5);
        features
    });
    let median = |features: &[Features; 2]| {
        let errors = views[0].errors(&views[1], [&features[0], &features[1]], &matches);
        errors[errors.len() / 2]
    };
    let (refined, rounded) = (median(&found), median(&whole));
    println!("median distance {refined} px, with whole pixels {rounded} px");
    assert!(refined < 0.92 * rounded, "{refined} < {rounded}");
}

#[test]
#[ignore = "needs real data sets (OSTRA_DATA), networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
fn only_allowed_pixels_get_keypoints_and_the_strongest_come_first() {
    let (models, data) = (networks(), data());
    let view = View::read(&data.join("dtu_scan24"), 0);
    let xfeat = xfeat(
        &models,
        XFeatOptions {
            most: 300,
            ..XFeatOptions::default()
        },
    );
    let allowed: Vec<bool> = (0..view.grey.len())
        .map(|at| at % view.width < 350 && at / view.width > 200)
        .collect();
    let found = xfeat
        .extract(&view.grey, view.width, view.height, Some(&allowed))
        .unwrap();
    assert_eq!(found.keypoints.len(), 300, "those elsewhere take no place");
    assert!(
        found
            .keypoints
            .iter()
            .all(|at| at.x < 350.0 && at.y >= 201.0)
    );
    assert!(found.scores.is_sorted_by(|a, b| a >= b));
    assert!(
        rows(&found)
            .iter()
            .all(|row| (row.iter().map(|value| value * value).sum::<f32>() - 1.0).abs() < 1e-4)
    );
}

#[test]
#[ignore = "needs real data sets (OSTRA_DATA), networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
fn black_bars_at_the_sides_get_no_keypoints() {
    let (models, data) = (networks(), data());
    let mut view = View::read(&data.join("dtu_scan24"), 0);
    let is_bar = |column: usize| !(100..700).contains(&column);
    view.grey
        .iter_mut()
        .enumerate()
        .filter(|(at, _)| is_bar(at % view.width))
        .for_each(|(_, value)| *value = 0.0);
    let found = features(&xfeat(&models, XFeatOptions::default()), &view);
    assert!(found.keypoints.len() > 500, "{}", found.keypoints.len());
    assert!(
        found
            .keypoints
            .iter()
            .all(|at| (116.0..=684.0).contains(&at.x))
    );
}

#[test]
#[ignore = "needs real data sets (OSTRA_DATA), networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
fn images_with_few_first_matches_are_not_matched_further() {
    let (models, data) = (networks(), data());
    let xfeat = xfeat(&models, XFeatOptions::default());
    let [first, second] =
        [0, 3].map(|index| features(&xfeat, &View::read(&data.join("dtu_scan24"), index)));
    let matched = |first_keypoints: usize| {
        let options = LighterGlueOptions {
            first_keypoints,
            ..Default::default()
        };
        LighterGlue::load(&models, options)
            .unwrap()
            .matches(&first, &second)
            .unwrap()
    };
    let whole = matched(LighterGlueOptions::default().most);
    assert!(whole.len() > 20, "{}", whole.len());
    assert_eq!(
        matched(LighterGlueOptions::default().first_keypoints),
        whole,
        "they overlap"
    );
    // Of so few keypoints hardly any are the same; the result is then only these.
    let glanced = matched(16);
    assert!(
        glanced.len() < 10 && glanced.iter().all(|&(a, b)| a.max(b) < 16),
        "{glanced:?}"
    );
}

#[test]
#[ignore = "needs real data sets (OSTRA_DATA), networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
fn positions_in_shrunk_images_are_in_original_pixels() {
    let (models, data) = (networks(), data());
    let view = View::read(&data.join("dtu_scan24"), 20);
    let options = XFeatOptions {
        most: 1000,
        ..XFeatOptions::default()
    };
    let whole = features(&xfeat(&models, options), &view);
    let shrunk = features(
        &xfeat(
            &models,
            XFeatOptions {
                max_side: 500,
                ..options
            },
        ),
        &view,
    );
    assert_eq!((shrunk.width, shrunk.height), (800, 600));
    let matches = mutual(&whole, &shrunk);
    let shifts = matches
        .iter()
        .map(|&(a, b)| shrunk.keypoints[b as usize] - whole.keypoints[a as usize]);
    let near: Vec<glam::DVec2> = shifts.filter(|shift| shift.length() < 3.0).collect();
    let mean = near.iter().sum::<glam::DVec2>() / near.len() as f64;
    assert!(near.len() > 200, "{} of {}", near.len(), matches.len());
    // A wrong convention would move points down as well; to the left the network itself moves them,
    // by 0.7 of its pixels.
    assert!(
        mean.y.abs() < 0.15 && mean.x.abs() < 0.6,
        "no common shift: {mean}"
    );
}

#[test]
#[ignore = "needs networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
fn images_without_keypoints_are_no_error() {
    let models = networks();
    let blank = xfeat(&models, XFeatOptions::default())
        .extract(&[0.5; 35 * 21], 35, 21, None)
        .unwrap();
    let glue = LighterGlue::load(&models, LighterGlueOptions::default()).unwrap();
    let none = Features {
        keypoints: Vec::new(),
        scores: Vec::new(),
        descriptors: Descriptors::Floats {
            dim: 64,
            values: Vec::new(),
        },
        ..blank
    };
    assert_eq!(glue.matches(&none, &none), Ok(Vec::new()));
}

#[test]
#[ignore = "needs networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
fn descriptors_of_another_kind_are_refused() {
    let models = networks();
    let glue = LighterGlue::load(&models, LighterGlueOptions::default()).unwrap();
    let sift = Features {
        width: 4,
        height: 4,
        keypoints: vec![glam::DVec2::ONE],
        scales_px: Vec::new(),
        orientations: Vec::new(),
        scores: Vec::new(),
        descriptors: Descriptors::Bytes {
            dim: 128,
            values: vec![1; 128],
        },
    };
    assert!(matches!(
        glue.matches(&sift, &sift),
        Err(FeatureError::Kinds(_))
    ));
}

#[test]
fn missing_network_is_reported() {
    let scratch = tempfile::tempdir().unwrap();
    let error = XFeat::load(scratch.path(), XFeatOptions::default())
        .unwrap_err()
        .to_string();
    assert!(error.contains("ostra models add xfeat FILE"), "{error}");
}
