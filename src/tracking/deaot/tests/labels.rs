//! Tests of labels and memory, with small networks of random weights.

use super::super::DeaotOptions;
use super::tiny_networks;
use crate::propagate::LabelProbabilities;
use ostra_core::job::Progress;
use ostra_frames::Image;
use ostra_masks::{LabelId, LabelMask, MaskError};

const WIDTH: u32 = 110;
const HEIGHT: u32 = 60;

/// Draws a bright square that moves over a gradient.
pub(super) fn image(at: u32) -> Image {
    let pixel = |x: u32, y: u32| {
        let is_in = (20 + 3 * at..45 + 3 * at).contains(&x) && (15..40).contains(&y);
        if is_in {
            [230, 210, 60]
        } else {
            [x as u8, 2 * y as u8, (x + y) as u8]
        }
    };
    let pixels = (0..WIDTH * HEIGHT)
        .map(|at| pixel(at % WIDTH, at / WIDTH))
        .collect();
    Image {
        width: WIDTH,
        height: HEIGHT,
        pixels,
    }
}

/// Fills columns `first..last` with each label.
pub(super) fn mask(labels: &[(u16, u32, u32)]) -> LabelMask {
    let mut mask = LabelMask::empty(WIDTH, HEIGHT);
    for &(label, first, last) in labels {
        for at in (0..WIDTH * HEIGHT).filter(|at| (first..last).contains(&(at % WIDTH))) {
            mask.ids[at as usize] = LabelId(label);
        }
    }
    mask
}

fn difference(a: &LabelProbabilities, b: &LabelProbabilities) -> f32 {
    let pairs = a.probabilities.iter().zip(&b.probabilities);
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn labels_are_ascending_in_whatever_order_they_were_given() {
    let deaot = tiny_networks(DeaotOptions::default());
    let progress = Progress::default();
    let pass = |first: u16, second: u16| {
        let mut pass = deaot.pass(&progress);
        pass.remember(&image(0), &mask(&[(first, 20, 45)])).unwrap();
        pass.propagate(&image(1)).unwrap();
        pass.remember(&image(1), &mask(&[(second, 70, 100)]))
            .unwrap();
        pass.propagate(&image(2)).unwrap()
    };
    let (ascending, descending) = (pass(4, 9), pass(9, 4));
    assert_eq!(ascending.labels, [LabelId(4), LabelId(9)]);
    assert_eq!(descending.labels, ascending.labels);
    let plane = (WIDTH * HEIGHT) as usize;
    let planes = |of: &LabelProbabilities| -> Vec<Vec<f32>> {
        of.probabilities
            .chunks_exact(plane)
            .map(<[f32]>::to_vec)
            .collect()
    };
    let [nothing, first, second] = planes(&ascending).try_into().unwrap();
    assert_eq!(
        planes(&descending),
        [nothing.clone(), second.clone(), first.clone()]
    );
    assert_ne!(first, second);
    let sums = nothing
        .iter()
        .zip(&first)
        .zip(&second)
        .map(|((a, b), c)| a + b + c);
    assert!(sums.into_iter().all(|sum| (sum - 1.0).abs() < 1e-5));
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn mask_given_before_or_after_propagation_has_the_same_effect() {
    let deaot = tiny_networks(DeaotOptions::default());
    let progress = Progress::default();
    let reported = mask(&[(2, 60, 90)]);
    let pass = |is_answered: bool| {
        let mut pass = deaot.pass(&progress);
        pass.remember(&image(0), &mask(&[(1, 20, 45)])).unwrap();
        // The fifth image would enter long-term memory if no mask were given.
        (1..5).for_each(|at| drop(pass.propagate(&image(at)).unwrap()));
        if is_answered {
            pass.propagate(&image(5)).unwrap();
        }
        pass.remember(&image(5), &reported).unwrap();
        (6..8)
            .map(|at| pass.propagate(&image(at)).unwrap())
            .next_back()
            .unwrap()
    };
    assert_eq!(pass(true), pass(false));
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn corrected_mask_changes_the_result_and_an_empty_one_does_not() {
    let deaot = tiny_networks(DeaotOptions::default());
    let progress = Progress::default();
    let pass = |reported: Option<LabelMask>| {
        let mut pass = deaot.pass(&progress);
        pass.remember(&image(0), &mask(&[(1, 20, 45), (2, 60, 80)]))
            .unwrap();
        pass.propagate(&image(1)).unwrap();
        reported
            .into_iter()
            .for_each(|reported| pass.remember(&image(1), &reported).unwrap());
        pass.propagate(&image(2)).unwrap()
    };
    let plain = pass(None);
    assert_eq!(
        pass(Some(mask(&[]))),
        plain,
        "labels that are not shown stay"
    );
    let corrected = pass(Some(mask(&[(1, 80, 105), (2, 0, 20)])));
    assert!(
        difference(&plain, &corrected) > 0.01,
        "{}",
        difference(&plain, &corrected)
    );
    let of_one = pass(Some(mask(&[(1, 80, 105)])));
    assert!(
        difference(&of_one, &corrected) > 0.01,
        "without new information the other label stays as it was"
    );
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn memory_bound_has_no_effect_until_it_is_reached() {
    let progress = Progress::default();
    let pass = |most_remembered: usize| -> Vec<LabelProbabilities> {
        let options = DeaotOptions {
            remembered_every: 1,
            most_remembered,
            ..DeaotOptions::default()
        };
        let deaot = tiny_networks(options);
        let mut pass = deaot.pass(&progress);
        pass.remember(&image(0), &mask(&[(1, 20, 45)])).unwrap();
        (1..7)
            .map(|at| pass.propagate(&image(at)).unwrap())
            .collect()
    };
    let (bounded, free) = (pass(4), pass(100));
    assert_eq!(bounded[..4], free[..4]);
    assert!(difference(&bounded[5], &free[5]) > 1e-4);
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn probabilities_have_the_size_of_each_image() {
    let options = DeaotOptions {
        longest_side: 97,
        ..DeaotOptions::default()
    };
    let deaot = tiny_networks(options);
    let progress = Progress::default();
    let mut pass = deaot.pass(&progress);
    pass.remember(&image(0), &mask(&[(1, 20, 45)])).unwrap();
    let turned = Image {
        width: HEIGHT,
        height: WIDTH,
        pixels: image(1).pixels,
    };
    let found = pass.propagate(&turned).unwrap();
    assert_eq!(
        (found.width, found.height),
        (HEIGHT as usize, WIDTH as usize)
    );
    assert_eq!(found.probabilities.len(), 2 * turned.pixels.len());
    assert_eq!(pass.propagate(&image(2)).unwrap().width, WIDTH as usize);
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn missing_empty_or_ill_sized_masks_are_rejected() {
    let deaot = tiny_networks(DeaotOptions::default());
    let progress = Progress::default();
    let mut pass = deaot.pass(&progress);
    let error = pass.propagate(&image(0)).unwrap_err();
    assert!(error.to_string().contains("no mask to track"), "{error}");
    pass.remember(&image(0), &mask(&[])).unwrap();
    assert!(
        pass.propagate(&image(1)).is_err(),
        "an empty mask gives nothing to track"
    );
    let error = pass
        .remember(&image(0), &LabelMask::empty(WIDTH, 3))
        .unwrap_err();
    assert!(error.to_string().contains("110×3"), "{error}");
    let cut = Image {
        pixels: Vec::new(),
        ..image(0)
    };
    assert!(pass.remember(&cut, &mask(&[(1, 0, 9)])).is_err());
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn stopped_pass_ends_with_an_error() {
    let deaot = tiny_networks(DeaotOptions::default());
    let progress = Progress::default();
    let mut pass = deaot.pass(&progress);
    pass.remember(&image(0), &mask(&[(1, 20, 45)])).unwrap();
    progress.stop();
    assert!(matches!(
        pass.propagate(&image(1)),
        Err(MaskError::Stopped(_))
    ));
}
