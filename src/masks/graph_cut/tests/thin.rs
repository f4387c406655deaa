//! First clicks on thin structures.

use glam::DVec2;

use super::{ask, click, image, iou, of_clicks, prepared};
use crate::{AnswerSize, Prompt, Region};

const SIDE: u32 = 200;

/// Returns whether a pixel lies on a thin arc, four pixels wide.
fn on_arc(x: u32, y: u32) -> bool {
    let at = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
    (at.distance(DVec2::new(100.0, 180.0)) - 120.0).abs() <= 2.0
}

/// Returns the colour of a green arc before a wall of two colours.
fn arc_color(x: u32, y: u32) -> [u8; 3] {
    match (on_arc(x, y), x < 90) {
        (true, _) => [60, 140, 50],
        (false, true) => [170, 150, 130],
        (false, false) => [140, 150, 190],
    }
}

#[test]
fn first_click_takes_a_thin_structure_at_any_size_of_the_image() {
    // The larger one is segmented at half of its size.
    for scale in [1, 7] {
        let side = SIDE * scale;
        let frame = prepared(
            &image(side, side, |x, y| arc_color(x / scale, y / scale)),
            None,
        );
        let (x, y) = (f64::from(100 * scale), f64::from(60 * scale));
        let found = ask(&*frame, &of_clicks(&[click(x, y, true)]), None);
        let iou = iou(&found, |x, y| on_arc(x / scale, y / scale));
        assert!(iou > 0.8, "{side} pixels: {iou:.3}");
    }
}

#[test]
fn other_sizes_of_a_thin_answer_are_clearly_smaller_and_larger() {
    let frame = prepared(&image(SIDE, SIDE, arc_color), None);
    let area = |size| {
        let prompt = Prompt {
            size,
            ..of_clicks(&[click(100.0, 60.0, true)])
        };
        ask(&*frame, &prompt, None).area() as f64
    };
    let automatic = area(AnswerSize::Automatic);
    assert!(area(AnswerSize::Smaller) < 0.7 * automatic);
    assert!(area(AnswerSize::Larger) > 1.5 * automatic);
}

#[test]
fn thin_answer_leaves_other_labels_and_other_kinds_of_clicks_alone() {
    let frame = prepared(&image(SIDE, SIDE, arc_color), None);
    let mut taken = Region::empty(SIDE, SIDE);
    for (at, inside) in taken.inside.iter_mut().enumerate() {
        *inside = at % (SIDE as usize) < 60;
    }
    let first = of_clicks(&[click(100.0, 60.0, true)]);
    let mut beyond = ask(&*frame, &first, Some(&taken));
    assert!(beyond.at(150, 71), "the rest of it is found");
    beyond.intersect(&taken);
    assert!(beyond.is_empty(), "pixels of another label were taken");

    let excluded = ask(&*frame, &of_clicks(&[click(100.0, 60.0, false)]), None);
    assert!(excluded.is_empty(), "nothing is there to exclude from");

    let both = of_clicks(&[click(100.0, 60.0, true), click(100.0, 140.0, true)]);
    let both = ask(&*frame, &both, None);
    assert!(both.at(100, 60) && both.at(100, 140) && both.at(40, 76));
}
