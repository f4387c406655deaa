//! Invalid requests and networks that do not fit.

use std::sync::Arc;

use super::super::GroundingDino;
use super::{image, network, phrases, runtime, tiny};
use crate::{GroundRequest, MaskError, TextGrounder};
use ostra_compute::nn::{Dialect, Network};
use ostra_core::job::Progress;
use ostra_frames::Image;

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn invalid_requests_are_errors_of_one_line() {
    let dino = network(&tiny(), "grounding-tiny.onnx");
    let small = Image {
        width: 2,
        height: 2,
        pixels: vec![[0; 3]; 4],
    };
    let narrow = Image {
        width: 2,
        height: 4000,
        pixels: vec![[0; 3]; 8000],
    };
    let empty = Image {
        width: 0,
        height: 0,
        pixels: Vec::new(),
    };
    let many = vec!["cat"; 200];
    let asked: [(&Image, &[&str], &str); 5] = [
        (&small, &[], "nothing to search for"),
        (&small, &["cat", " . "], "' . '"),
        (&small, &many, "402 tokens"),
        (&narrow, &["cat"], "2×4000"),
        (&empty, &["cat"], "empty"),
    ];
    for (image, words, reported) in asked {
        let words = phrases(words);
        let request = GroundRequest {
            phrases: &words,
            threshold: None,
        };
        let text = dino
            .ground(image, &request, &Progress::default())
            .unwrap_err()
            .to_string();
        assert!(text.contains(reported) && !text.contains('\n'), "{text}");
    }
    assert_eq!((dino.name(), dino.vocabulary()), ("grounding-dino", None));
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn other_networks_and_vocabularies_are_rejected() {
    let runtime = runtime();
    let words = std::fs::read_to_string(tiny().join("vocab.txt")).unwrap();
    let other = tiny().join("../sam-tiny/sam-tiny-encoder.onnx");
    let refused = |path: &std::path::Path, words: &str| {
        let network = Network::load(&runtime, path, None).unwrap();
        GroundingDino::new(Dialect::GroundingDino, network, words)
            .unwrap_err()
            .to_string()
    };
    let text = refused(&other, &words);
    assert!(
        text.contains("sam-tiny-encoder.onnx: expected the inputs image, input_ids"),
        "{text}"
    );
    let text = refused(&tiny().join("grounding-tiny.onnx"), "cat\ndog\n");
    assert!(text.contains("the vocabulary has no '[CLS]'"), "{text}");
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn stopped_run_returns_no_answer() {
    let dino = network(&tiny(), "grounding-tiny.onnx");
    let (image, stopped) = (image(&tiny().join("frame-0.png")), Progress::default());
    stopped.stop();
    let found = dino.detect(&image, &phrases(&["cat"]), &stopped);
    assert!(matches!(found, Err(MaskError::Stopped(_))), "{found:?}");
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn new_threshold_reuses_the_last_answer() {
    let dino = network(&tiny(), "grounding-tiny.onnx");
    let image = image(&tiny().join("frame-1.png"));
    let detect = |image: &Image, words: &[&str]| {
        dino.detect(image, &phrases(words), &Progress::default())
            .unwrap()
    };
    let first = detect(&image, &["leaf"]);
    assert!(
        Arc::ptr_eq(&first, &detect(&image, &["leaf"])),
        "the same image and phrase"
    );
    let mut other = image.clone();
    other.pixels.iter_mut().for_each(|pixel| pixel.reverse());
    let second = detect(&other, &["leaf"]);
    assert!(second.boxes != first.boxes, "another image");
    assert!(
        detect(&other, &["cat"]).caption != second.caption,
        "another phrase"
    );
    let all = first.above(0.0);
    assert!(all.len() > 1 && all.windows(2).all(|pair| pair[0].score >= pair[1].score));
    let words = phrases(&["leaf"]);
    let request = GroundRequest {
        phrases: &words,
        threshold: Some(all[0].score),
    };
    assert!(
        dino.ground(&image, &request, &Progress::default())
            .unwrap()
            .is_empty()
    );
    let request = GroundRequest {
        phrases: &words,
        threshold: Some(all[1].score),
    };
    assert_eq!(
        dino.ground(&image, &request, &Progress::default()).unwrap(),
        all[..1]
    );
}
