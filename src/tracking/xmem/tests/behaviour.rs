//! Tests of what the reference does not cover: many labels, long passes, stops, wrong files.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::super::XMem;
use super::{networks, tiny};
use ostra_compute::nn::NnError;
use ostra_core::job::Progress;
use ostra_frames::{Frame, FrameStore, Image, ImageSource, Orientation};
use ostra_masks::{Direction, LabelId, LabelMask, MaskError, TrackRequest, Tracker};

const SIDE: u32 = 64;

fn files() -> [String; 3] {
    ["key-encoder", "value-encoder", "decoder"].map(|part| format!("xmem-tiny-{part}.onnx"))
}

/// A tracker that uses images at their own size and has a small memory.
fn small() -> XMem {
    let mut xmem = networks(&tiny(), &files());
    xmem.options.short_side = None;
    (
        xmem.options.remember_every,
        xmem.options.most_frames,
        xmem.options.least_frames,
    ) = (2, 4, 2);
    (xmem.options.prototypes, xmem.options.most_prototypes) = (8, 30);
    xmem
}

/// Draws moving waves.
fn image(at: u32) -> Image {
    let wave = |x: u32, y: u32, by: u32| {
        (127.0 + 120.0 * ((x * by + 3 * y + 2 * at) as f32 / 9.0).sin()) as u8
    };
    let pixel = |place: u32| {
        let (x, y) = (place % SIDE, place / SIDE);
        [wave(x, y, 1), wave(x, y, 4), (4 * (place % 61)) as u8]
    };
    Image {
        width: SIDE,
        height: SIDE,
        pixels: (0..SIDE * SIDE).map(pixel).collect(),
    }
}

/// Draws one box of 12 × 12 pixels per label.
fn boxes(labels: impl Iterator<Item = u16>) -> LabelMask {
    let mut mask = LabelMask::empty(SIDE, SIDE);
    for (place, label) in labels.enumerate() {
        let (left, upper) = (place as u32 % 4 * 16, place as u32 / 4 * 16);
        for y in upper..upper + 12 {
            (left..left + 12).for_each(|x| mask.ids[(y * SIDE + x) as usize] = LabelId(label));
        }
    }
    mask
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn twelve_labels_are_tracked_in_any_order() {
    let xmem = small();
    let progress = Progress::default();
    let follow = |mask: &LabelMask| {
        let mut pass = xmem.pass(&progress);
        pass.remember(&image(0), mask).unwrap();
        for at in 1..7 {
            pass.propagate(&image(at)).unwrap();
        }
        pass.propagate(&image(7)).unwrap()
    };
    let (forth, back) = (follow(&boxes(1..=12)), follow(&boxes((1..=12).rev())));
    assert_eq!(forth.labels, (1..=12).map(LabelId).collect::<Vec<_>>());
    let area = (SIDE * SIDE) as usize;
    let map = |of: &[f32], at: usize| of[at * area..][..area].to_vec();
    for label in 1..=12 {
        let pairs = map(&forth.probabilities, label)
            .into_iter()
            .zip(map(&back.probabilities, 13 - label));
        let apart = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(apart < 1e-3, "label {label}: {apart}");
    }
    for at in 0..area {
        let sum: f32 = forth.probabilities[at..].iter().step_by(area).sum();
        assert!((sum - 1.0).abs() < 1e-4, "{sum}");
    }
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn memory_is_bounded_and_later_labels_have_their_own_group() {
    let xmem = small();
    let progress = Progress::default();
    let mut pass = xmem.pass(&progress);
    pass.remember(&image(0), &boxes(1..=2)).unwrap();
    let cells = (SIDE / 16 * SIDE / 16) as usize;
    for at in 1..100 {
        if at == 9 {
            let mut later = boxes(1..=3);
            later
                .ids
                .iter_mut()
                .filter(|id| id.0 < 3)
                .for_each(|id| *id = LabelId::NONE);
            pass.remember(&image(at), &later).unwrap();
            assert_eq!(pass.sizes()[1], (cells, 0));
            continue;
        }
        let answer = pass.propagate(&image(at)).unwrap();
        assert_eq!(answer.labels.len(), if at < 9 { 2 } else { 3 });
        for (working, long_term) in pass.sizes() {
            assert!(
                working < 4 * cells && long_term <= 30,
                "frame {at}: {working} {long_term}"
            );
        }
    }
    assert_eq!(pass.sizes().len(), 2);
    assert!(
        pass.sizes().iter().all(|(_, long_term)| *long_term > 8),
        "both were consolidated: {:?}",
        pass.sizes()
    );
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn video_is_tracked_and_stopped() {
    let xmem = small();
    let folder = tempfile::tempdir().unwrap();
    let frame = |at: u32| {
        let (path, image) = (folder.path().join(format!("{at}.png")), image(at));
        let bytes = image.pixels.into_flattened();
        image::RgbImage::from_raw(SIDE, SIDE, bytes)
            .unwrap()
            .save(&path)
            .unwrap();
        let image = ImageSource::File {
            path,
            orientation: Orientation::default(),
        };
        Frame {
            name: at.to_string(),
            width: SIDE,
            height: SIDE,
            image,
            depth: None,
            camera: None,
        }
    };
    let request = TrackRequest {
        frames: Arc::new((0..6).map(frame).collect()),
        store: Arc::new(FrameStore::new(1 << 20)),
        keyframes: BTreeMap::from([(2, Arc::new(boxes([7, 4].into_iter())))]),
        from: 0,
        to: 5,
        direction: Direction::Both,
        labels: None,
    };
    let mut given = Vec::new();
    let warnings = xmem
        .track(
            &request,
            &mut |frame| given.push(frame),
            &Progress::default(),
        )
        .unwrap();
    assert!(warnings.is_empty());
    assert_eq!(
        given.iter().map(|frame| frame.frame).collect::<Vec<_>>(),
        [3, 4, 5, 1, 0]
    );
    let progress = Progress::default();
    let mut pass = xmem.pass(&progress);
    pass.remember(&image(2), &request.keyframes[&2]).unwrap();
    let answer = pass.propagate(&image(3)).unwrap();
    let area = (SIDE * SIDE) as usize;
    for (at, id) in given[0].mask.ids.iter().enumerate() {
        let place = answer
            .labels
            .iter()
            .position(|label| label == id)
            .map_or(0, |place| 1 + place);
        let most = answer.probabilities[at..]
            .iter()
            .step_by(area)
            .copied()
            .fold(0.0, f32::max);
        assert_eq!(
            answer.probabilities[place * area + at].to_bits(),
            most.to_bits(),
            "the same for any run"
        );
    }
    progress.stop();
    assert!(matches!(
        pass.propagate(&image(4)),
        Err(MaskError::Stopped(_))
    ));
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn networks_in_the_wrong_order_are_rejected() {
    let _ = small();
    let runtime = ostra_compute::nn::Runtime::find().unwrap();
    let [key, value, decoder] = files();
    for (order, reported) in [
        ([&value, &key, &decoder], "image"),
        ([&key, &decoder, &value], "others"),
    ] {
        let load = |file: &String| {
            ostra_compute::nn::Network::load(&runtime, &tiny().join(file), None).unwrap()
        };
        let error = XMem::new(order.map(load)).unwrap_err();
        let text = error.to_string();
        assert!(
            matches!(error, NnError::Mismatch { .. }) && !text.contains('\n'),
            "{text}"
        );
        assert!(text.contains(reported), "{text}");
    }
    let text = XMem::load(&tiny()).unwrap_err().to_string();
    assert!(
        text.contains("is not installed") && text.contains("ostra models add xmem"),
        "{text}"
    );
}
