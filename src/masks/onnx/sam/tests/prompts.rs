//! Prompts, tested with networks that segment flat colours (`tests/parity/flat.py`).

mod close_ups;

use std::sync::Arc;

use glam::DVec2;

use super::super::{CloseUps, EverythingOptions, ImagePart, Sam, SamFrame};
use super::{flat, flat_efficient};
use crate::{Click, PreparedFrame, Prompt, PxBox, Region, SegmentRequest};
use ostra_core::job::Progress;
use ostra_frames::Image;

const WIDTH: u32 = 256;
const HEIGHT: u32 = 192;
const RED: [u32; 4] = [32, 32, 80, 96];
const GREEN: [u32; 4] = [144, 48, 208, 112];

/// Returns an image of two objects on a grey background.
fn image() -> Image {
    let colour = |x: u32, y: u32| {
        let is_in = |[x0, y0, x1, y1]: [u32; 4]| (x0..x1).contains(&x) && (y0..y1).contains(&y);
        if is_in(RED) {
            [220, 40, 30]
        } else if is_in(GREEN) {
            [40, 200, 60]
        } else {
            [120; 3]
        }
    };
    let pixels = (0..WIDTH * HEIGHT)
        .map(|at| colour(at % WIDTH, at / WIDTH))
        .collect();
    Image {
        width: WIDTH,
        height: HEIGHT,
        pixels,
    }
}

fn thing([x0, y0, x1, y1]: [u32; 4]) -> Region {
    let is_in = |at: u32| (x0..x1).contains(&(at % WIDTH)) && (y0..y1).contains(&(at / WIDTH));
    Region {
        width: WIDTH,
        height: HEIGHT,
        inside: (0..WIDTH * HEIGHT).map(is_in).collect(),
    }
}

fn both() -> Region {
    let mut both = thing(RED);
    both.unite(&thing(GREEN));
    both
}

fn click(x: f64, y: f64, include: bool) -> Click {
    Click {
        at_px: DVec2::new(x, y),
        include,
    }
}

fn around([x0, y0, x1, y1]: [u32; 4]) -> PxBox {
    PxBox {
        min_px: DVec2::new(x0.into(), y0.into()),
        max_px: DVec2::new(x1.into(), y1.into()),
    }
}

fn frame(sam: &Sam, part: ImagePart) -> SamFrame {
    sam.frame(&sam.embed(&image(), part, &Progress::default()).unwrap())
        .unwrap()
}

fn whole() -> SamFrame {
    frame(&flat(), ImagePart::whole(WIDTH, HEIGHT))
}

fn answer(
    frame: &SamFrame,
    clicks: &[Click],
    boxes: &[PxBox],
    previous: Option<&Region>,
) -> Region {
    let prompt = Prompt {
        clicks: clicks.to_vec(),
        boxes: boxes.to_vec(),
        ..Prompt::default()
    };
    frame
        .segment(
            &SegmentRequest {
                prompt: &prompt,
                previous,
                taken: None,
            },
            &Progress::default(),
        )
        .unwrap()
}

/// Whether two regions are equal up to the cells of four pixels that bound the masks.
fn alike(a: &Region, b: &Region) -> bool {
    a.iou(b) > 0.9
}

const IN_RED: Click = Click {
    at_px: DVec2::new(50.5, 60.5),
    include: true,
};
const IN_GREEN: Click = Click {
    at_px: DVec2::new(180.5, 80.5),
    include: true,
};

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn click_and_box_each_select_one_object() {
    let frame = whole();
    assert!(alike(&answer(&frame, &[IN_RED], &[], None), &thing(RED)));
    assert!(alike(
        &answer(&frame, &[], &[around(GREEN)], None),
        &thing(GREEN)
    ));
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn objects_of_one_label_are_prompted_one_at_a_time() {
    let frame = whole();
    let found = answer(&frame, &[IN_RED, IN_GREEN], &[], None);
    assert!(alike(&found, &both()), "together they would find neither");
    let found = answer(&frame, &[], &[around(RED), around(GREEN)], None);
    assert!(alike(&found, &both()));
    let found = answer(
        &frame,
        &[IN_GREEN, click(170.5, 60.5, true)],
        &[around(RED)],
        None,
    );
    assert!(
        alike(&found, &both()),
        "clicks outside a box are not of its thing"
    );
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn exclude_clicks_on_other_labels_have_no_effect() {
    let frame = whole();
    let rivals = [click(180.5, 80.5, false), click(10.5, 10.5, false)];
    let found = answer(&frame, &[rivals[0], rivals[1], IN_RED], &[], None);
    assert!(alike(&found, &thing(RED)));
    assert_eq!(
        answer(&frame, &rivals, &[], None).area(),
        0,
        "nothing is asked for"
    );
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn excluded_object_is_removed_and_the_other_stays() {
    let frame = whole();
    let clicks = [IN_RED, IN_GREEN, click(170.5, 60.5, false)];
    let found = answer(&frame, &clicks, &[], None);
    assert!(alike(&found, &thing(RED)), "{}", found.iou(&thing(RED)));
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn box_selects_the_object_in_its_middle() {
    let frame = whole();
    let all = PxBox {
        min_px: DVec2::ZERO,
        max_px: DVec2::new(256.0, 192.0),
    };
    let ground = answer(&frame, &[], &[all], None);
    assert!(
        alike(&ground, &both().inverted()),
        "{}",
        ground.iou(&both().inverted())
    );
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn mask_from_elsewhere_is_refined_only_where_it_is_clicked() {
    let frame = whole();
    // Painted: half of the red object, and the green one with background around it.
    let half = thing([32, 32, 56, 96]);
    let mut painted = thing([112, 32, 224, 128]);
    painted.unite(&half);
    let found = answer(&frame, &[click(120.5, 40.5, false)], &[], Some(&painted));
    let mut expected = thing(GREEN);
    expected.unite(&half);
    assert!(alike(&found, &expected), "{}", found.iou(&expected));
    assert!(
        found.at(32, 32) && found.at(55, 95),
        "what was not clicked stays to the pixel"
    );
    let found = answer(&frame, &[click(70.5, 60.5, true)], &[], Some(&half));
    assert!(alike(&found, &thing(RED)), "{}", found.iou(&thing(RED)));
    assert_eq!(
        answer(&frame, &[click(40.5, 40.5, true)], &[], Some(&half)),
        half,
        "that is inside already"
    );
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn answers_do_not_depend_on_earlier_questions() {
    let frame = whole();
    let clicks = [
        IN_RED,
        IN_GREEN,
        click(120.5, 170.5, false),
        click(60.5, 40.5, true),
    ];
    let steps: Vec<Region> = (1..=clicks.len())
        .map(|count| answer(&frame, &clicks[..count], &[], None))
        .collect();
    for (count, step) in (1..).zip(&steps) {
        assert_eq!(
            answer(&whole(), &clicks[..count], &[], None),
            *step,
            "a fresh frame"
        );
        let previous = (count > 1).then(|| &steps[count - 2]);
        assert_eq!(
            answer(&frame, &clicks[..count], &[], previous),
            *step,
            "as a refinement"
        );
    }
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn clicks_are_enforced_and_taken_pixels_are_excluded() {
    let frame = whole();
    let prompt = Prompt {
        clicks: vec![IN_RED, click(40.5, 40.5, false)],
        ..Prompt::default()
    };
    let taken = thing([60, 32, 80, 96]);
    let found = frame
        .segment(
            &SegmentRequest {
                prompt: &prompt,
                previous: None,
                taken: Some(&taken),
            },
            &Progress::default(),
        )
        .unwrap();
    assert!(
        found.at(50, 60) && !found.at(40, 40),
        "both lie on one colour"
    );
    assert!(!found.at(70, 60));
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn everything_is_found_once() {
    let frame = whole();
    let options = EverythingOptions {
        points_per_side: 8,
        ..EverythingOptions::default()
    };
    let found = frame.everything(&options, &Progress::default()).unwrap();
    let (all, least) = (
        found.len(),
        found.iter().map(|one| one.stability).fold(1.0, f32::min),
    );
    assert_eq!(
        all, 3,
        "two things and the ground; what is only possible does not count"
    );
    assert!(found.iter().any(|one| alike(&one.region, &thing(RED))));
    assert!(
        found
            .iter()
            .any(|one| alike(&one.region, &thing(GREEN)) && one.extent.iou(&around(GREEN)) > 0.9)
    );
    assert!(least >= 0.95 && found.iter().all(|one| one.score > 0.88));
    let stopped = Progress::default();
    stopped.stop();
    assert!(frame.everything(&options, &stopped).is_err());
}

/// If one of the masks of a network without exclude clicks leaves them out, it is taken.
#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn exclude_click_selects_among_masks_without_support_by_the_network() {
    let sam = flat_efficient();
    let frame = frame(&sam, ImagePart::whole(WIDTH, HEIGHT));
    let all = answer(&frame, &[IN_RED], &[], None);
    assert_eq!(all.area(), (WIDTH * HEIGHT) as usize, "the surest");
    let found = answer(&frame, &[IN_RED, click(180.5, 80.5, false)], &[], None);
    assert!(alike(&found, &thing(RED)), "{}", found.iou(&thing(RED)));
}

/// If no mask leaves the click out, the mask of a click there is subtracted.
///
/// If that mask is most of the answer, only the clicked pixels are removed.
#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn excluded_object_is_subtracted_without_support_by_the_network() {
    let sam = flat_efficient();
    let frame = frame(&sam, ImagePart::whole(WIDTH, HEIGHT));
    let around_both = [PxBox {
        min_px: DVec2::new(16.0, 16.0),
        max_px: DVec2::new(240.0, 160.0),
    }];
    let found = answer(&frame, &[], &around_both, None);
    assert!(alike(&found, &both()), "{}", found.iou(&both()));
    let found = answer(&frame, &[click(50.5, 60.5, false)], &around_both, None);
    assert!(alike(&found, &thing(GREEN)), "{}", found.iou(&thing(GREEN)));
    let kept = answer(&frame, &[click(180.5, 80.5, false)], &around_both, None);
    assert!(
        kept.iou(&both()) > 0.9 && !kept.at(180, 80),
        "the green one is most of it: only the pixel goes"
    );
}

/// A part fills the square whatever its shape, and positions are scaled accordingly.
#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn close_up_fills_the_square_of_a_network_that_stretches() {
    let sam = flat_efficient();
    let frame = frame(
        &sam,
        ImagePart {
            x: 16,
            y: 16,
            width: 96,
            height: 128,
        },
    );
    let found = answer(&frame, &[IN_RED, click(100.5, 120.5, false)], &[], None);
    assert!(alike(&found, &thing(RED)), "{}", found.iou(&thing(RED)));
}

/// A painted or tracked mask is not replaced by the network's prediction at its middle.
#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn excluded_object_is_removed_from_a_mask_from_elsewhere_without_support_by_the_network() {
    let sam = flat_efficient();
    let frame = frame(&sam, ImagePart::whole(WIDTH, HEIGHT));
    let mut painted = thing([32, 32, 240, 176]);
    painted.subtract(&thing([100, 32, 140, 90]));
    let mut expected = painted.clone();
    expected.subtract(&thing(RED));
    let found = answer(&frame, &[click(50.5, 60.5, false)], &[], Some(&painted));
    assert!(alike(&found, &expected), "{}", found.iou(&expected));
}
