//! The export of Hugging Face, by a network with its interface (`tests/parity/public.py`).

use std::path::Path;

use glam::DVec2;

use super::super::GroundingDino;
use super::{phrases, runtime, tiny};
use crate::{GroundRequest, TextGrounder};
use ostra_compute::nn::{Dialect, Network};
use ostra_core::job::Progress;
use ostra_frames::Image;

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn every_phrase_is_asked_alone_and_boxes_are_of_the_image() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/parity/public");
    let network = Network::load(&runtime(), &folder.join("grounding.onnx"), None).unwrap();
    let vocabulary = std::fs::read_to_string(tiny().join("vocab.txt")).unwrap();
    let dino = GroundingDino::new(Dialect::GroundingDinoHf, network, &vocabulary).unwrap();
    let (width, height) = (300, 200);
    let is_dark = |at: u32| (60..150).contains(&(at % width)) && (40..120).contains(&(at / width));
    let colour = |at| if is_dark(at) { [10; 3] } else { [200; 3] };
    let image = Image {
        width,
        height,
        pixels: (0..width * height).map(colour).collect(),
    };
    let asked = phrases(&["cat", "dog"]);
    let request = GroundRequest {
        phrases: &asked,
        threshold: None,
    };
    let found = dino.ground(&image, &request, &Progress::default()).unwrap();
    assert_eq!(found.len(), 2, "{found:?}");
    let mut of: Vec<usize> = found.iter().map(|one| one.phrase).collect();
    of.sort_unstable();
    assert_eq!(of, [0, 1], "one box for each phrase");
    for one in &found {
        let error = (one.extent.min_px - DVec2::new(60.0, 40.0)).abs()
            + (one.extent.max_px - DVec2::new(150.0, 120.0)).abs();
        assert!(error.max_element() < 3.0, "{one:?}");
        assert!((one.score - 0.88).abs() < 0.01, "{one:?}");
    }
}
