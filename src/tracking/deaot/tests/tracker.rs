//! Tests of the tracker, with small networks of random weights.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use super::super::DeaotOptions;
use super::labels::{image, mask};
use super::{tiny_networks, winner};
use ostra_core::job::Progress;
use ostra_frames::{Frame, FrameStore, ImageSource, Orientation};
use ostra_masks::{Direction, LabelMask, TrackRequest, Tracker};

/// Writes images 0 to `last` to files.
fn frames(folder: &Path, last: u32) -> Vec<Frame> {
    let one = |at: u32| {
        let (path, image) = (folder.join(format!("{at}.png")), image(at));
        let pixels = image.pixels.as_flattened().to_vec();
        image::RgbImage::from_raw(image.width, image.height, pixels)
            .unwrap()
            .save(&path)
            .unwrap();
        let source = ImageSource::File {
            path,
            orientation: Orientation::default(),
        };
        let (width, height) = (image.width, image.height);
        Frame {
            name: at.to_string(),
            width,
            height,
            image: source,
            depth: None,
            camera: None,
        }
    };
    (0..=last).map(one).collect()
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn masks_propagate_in_both_directions_from_a_keyframe() {
    let deaot = tiny_networks(DeaotOptions::default());
    let (folder, progress) = (tempfile::tempdir().unwrap(), Progress::default());
    let keyframe = mask(&[(1, 26, 51), (2, 70, 100)]);
    let request = TrackRequest {
        frames: Arc::new(frames(folder.path(), 4)),
        store: Arc::new(FrameStore::new(1 << 20)),
        keyframes: BTreeMap::from([(2, Arc::new(keyframe.clone()))]),
        from: 0,
        to: 4,
        direction: Direction::Both,
        labels: None,
    };
    let mut found: BTreeMap<usize, LabelMask> = BTreeMap::new();
    let warnings = deaot
        .track(
            &request,
            &mut |given| drop(found.insert(given.frame, given.mask)),
            &progress,
        )
        .unwrap();
    assert!(warnings.is_empty(), "{warnings:?}");
    let mut expected = BTreeMap::new();
    for way in [[3, 4], [1, 0]] {
        let mut pass = deaot.pass(&progress);
        pass.remember(&image(2), &keyframe).unwrap();
        for at in way {
            expected.insert(at as usize, winner(&pass.propagate(&image(at)).unwrap()));
        }
    }
    assert_eq!(found, expected);
    assert_eq!(deaot.name(), "deaot");
}
