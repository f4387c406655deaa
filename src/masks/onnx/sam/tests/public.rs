//! Networks with the interfaces of public files (`tests/parity/public.py`), which segment flat colours.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec2;

use super::super::{CloseUps, ImagePart, Sam};
use super::{networks, runtime};
use crate::{Click, PreparedFrame, Prompt, PxBox, Region, SegmentRequest, Segmenter};
use ostra_compute::nn::{Dialect, Network};
use ostra_core::job::Progress;
use ostra_frames::Image;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/parity/public")
}

/// Every pair of public files, by interface.
fn all() -> Vec<(String, Sam)> {
    let pairs = [
        (Dialect::Sam, "encoder-image.onnx", "decoder-multi.onnx"),
        (Dialect::SamX, "encoder-x.onnx", "decoder-single.onnx"),
        (Dialect::SamHwc, "encoder-hwc.onnx", "decoder-single.onnx"),
        (Dialect::SamHwc, "encoder-hwc.onnx", "decoder-multi.onnx"),
        (Dialect::Sam2, "encoder-sam2.onnx", "decoder-sam2.onnx"),
    ];
    let load = |(dialect, encoder, decoder)| {
        let sam = networks(dialect, &folder(), encoder, decoder);
        (format!("{dialect:?} {decoder}"), sam)
    };
    pairs.map(load).into()
}

// Borders lie on those of cells, also where the image is stretched to a square.
const WIDTH: u32 = 1024;
const HEIGHT: u32 = 704;
const RED: [u32; 4] = [160, 176, 416, 352];
const GREEN: [u32; 4] = [544, 352, 864, 528];

fn is_in([x0, y0, x1, y1]: [u32; 4], x: u32, y: u32) -> bool {
    (x0..x1).contains(&x) && (y0..y1).contains(&y)
}

/// Returns an image of two rectangles, which is not square.
fn image() -> Arc<Image> {
    let colour = |at: u32| match (at % WIDTH, at / WIDTH) {
        (x, y) if is_in(RED, x, y) => [220, 40, 30],
        (x, y) if is_in(GREEN, x, y) => [40, 200, 60],
        _ => [120; 3],
    };
    Arc::new(Image {
        width: WIDTH,
        height: HEIGHT,
        pixels: (0..WIDTH * HEIGHT).map(colour).collect(),
    })
}

fn thing(extent: [u32; 4]) -> Region {
    Region {
        width: WIDTH,
        height: HEIGHT,
        inside: (0..WIDTH * HEIGHT)
            .map(|at| is_in(extent, at % WIDTH, at / WIDTH))
            .collect(),
    }
}

fn click(x: f64, y: f64, include: bool) -> Click {
    Click {
        at_px: DVec2::new(x, y),
        include,
    }
}

fn answer(frame: &dyn PreparedFrame, clicks: &[Click], boxes: &[[u32; 4]]) -> Region {
    refined(frame, clicks, boxes, None)
}

fn refined(
    frame: &dyn PreparedFrame,
    clicks: &[Click],
    boxes: &[[u32; 4]],
    previous: Option<&Region>,
) -> Region {
    let around = |&[x0, y0, x1, y1]: &[u32; 4]| PxBox {
        min_px: DVec2::new(x0.into(), y0.into()),
        max_px: DVec2::new(x1.into(), y1.into()),
    };
    let prompt = Prompt {
        clicks: clicks.to_vec(),
        boxes: boxes.iter().map(around).collect(),
        ..Prompt::default()
    };
    let request = SegmentRequest {
        prompt: &prompt,
        previous,
        taken: None,
    };
    frame.segment(&request, &Progress::default()).unwrap()
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn every_interface_answers_clicks_and_boxes() {
    for (name, sam) in all() {
        let frame = sam.prepare(&image(), None, &Progress::default()).unwrap();
        let red = answer(&*frame, &[click(250.0, 250.0, true)], &[]);
        assert!(
            red.iou(&thing(RED)) > 0.9,
            "{name}: {}",
            red.iou(&thing(RED))
        );
        let green = answer(&*frame, &[], &[GREEN]);
        assert!(
            green.iou(&thing(GREEN)) > 0.9,
            "{name}: {}",
            green.iou(&thing(GREEN))
        );
        let mut both = thing(RED);
        both.unite(&thing(GREEN));
        let clicks = [click(250.0, 250.0, true), click(600.0, 400.0, true)];
        let found = answer(&*frame, &clicks, &[]);
        assert!(found.iou(&both) > 0.9, "{name}: {}", found.iou(&both));
        // An exclude click removes one of the two again, and the earlier mask is the start.
        let clicks = [clicks[0], clicks[1], click(800.0, 500.0, false)];
        let found = refined(&*frame, &clicks, &[], Some(&found));
        assert!(
            found.iou(&thing(RED)) > 0.9,
            "{name}: {}",
            found.iou(&thing(RED))
        );
    }
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn every_interface_answers_in_a_part_at_full_resolution() {
    for (name, sam) in all() {
        let frame = CloseUps::new(Arc::new(sam), image());
        let found = answer(&frame, &[click(250.0, 250.0, true)], &[RED]);
        let iou = found.iou(&thing(RED));
        assert!(iou > 0.9, "{name}: {iou}");
    }
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn embedding_of_several_maps_is_stored_and_not_mixed_up() {
    let all: Vec<_> = all().into_iter().collect();
    let (sam, sam2) = (&all[0].1, &all[4].1);
    let whole = ImagePart::whole(WIDTH, HEIGHT);
    let embed = |sam: &Sam| sam.embed(&image(), whole, &Progress::default()).unwrap();
    let (one, three) = (embed(sam), embed(sam2));
    assert_eq!((one.maps.len(), three.maps.len()), (1, 3));
    let shapes: Vec<_> = three
        .maps
        .iter()
        .map(|map| (map.channels, map.cells))
        .collect();
    assert_eq!(shapes, [(256, 64), (32, 256), (64, 128)]);
    let bytes = three.to_bytes();
    assert_eq!(super::super::Embedding::from_bytes(&bytes).unwrap(), three);
    assert!(super::super::Embedding::from_bytes(&bytes[..bytes.len() - 4]).is_err());
    let text = sam.frame(&three).unwrap_err().to_string();
    assert!(
        text.contains("32×256×256") && !text.contains('\n'),
        "{text}"
    );
    assert!(sam2.frame(&one).is_err());
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn encoder_of_another_interface_is_rejected() {
    let runtime = runtime();
    let load = |file: &str| Network::load(&runtime, &folder().join(file), None).unwrap();
    let cases = [
        (
            Dialect::SamX,
            "encoder-image.onnx",
            "decoder-multi.onnx",
            "`x` f32 [1, 3, 1024, 1024]",
        ),
        (
            Dialect::SamHwc,
            "encoder-x.onnx",
            "decoder-multi.onnx",
            "`input_image` f32 [any, any, 3]",
        ),
        (
            Dialect::Sam2,
            "encoder-image.onnx",
            "decoder-sam2.onnx",
            "`input` f32 [1, 3, 1024, 1024]",
        ),
        (
            Dialect::Sam2,
            "encoder-sam2.onnx",
            "decoder-multi.onnx",
            "`high_res_features1`",
        ),
    ];
    for (dialect, encoder, decoder, reported) in cases {
        let text = Sam::new(dialect, load(encoder), load(decoder))
            .unwrap_err()
            .to_string();
        assert!(text.contains(reported) && !text.contains('\n'), "{text}");
    }
}
