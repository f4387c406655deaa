//! Tests of exclude clicks in a tracked mask that leaked into something else.

use super::*;
use crate::AnswerSize;

const WIDE: u32 = 240;
const HIGH: u32 = 180;

fn in_object(x: u32, y: u32) -> bool {
    (30..130).contains(&x) && (40..140).contains(&y)
}

/// A patch of carpet of 45×45 pixels next to the object.
fn in_leak(x: u32, y: u32) -> bool {
    (130..175).contains(&x) && (70..115).contains(&y)
}

/// Returns a red object before a chequered carpet with a grey wall behind it.
fn leaked_image() -> Arc<Image> {
    image(WIDE, HIGH, |x, y| {
        let is_carpet = (120..200).contains(&x) && (60..125).contains(&y);
        match (in_object(x, y), is_carpet) {
            (true, _) => [180, 60, 40],
            (_, true) if (x / 3 + y / 3) % 2 == 0 => [70, 110, 90],
            (_, true) => [90, 130, 70],
            _ => [150, 150, 155],
        }
    })
}

fn leaked_mask() -> Region {
    let inside = |at: u32| {
        let (x, y) = (at % WIDE, at / WIDE);
        in_object(x, y) || in_leak(x, y)
    };
    Region {
        width: WIDE,
        height: HIGH,
        inside: (0..WIDE * HIGH).map(inside).collect(),
    }
}

fn excluded(clicks: &[Click], size: AnswerSize) -> Region {
    let frame = prepared(&leaked_image(), None);
    let prompt = Prompt {
        corrects: true,
        size,
        ..of_clicks(clicks)
    };
    let previous = leaked_mask();
    let request = SegmentRequest {
        prompt: &prompt,
        previous: Some(&previous),
        taken: None,
    };
    frame.segment(&request, &Progress::default()).unwrap()
}

/// Returns the shares of the leak and of the object that an answer keeps.
fn kept(answer: &Region) -> [f64; 2] {
    let share = |is_in: fn(u32, u32) -> bool| {
        let places = || {
            (0..WIDE * HIGH)
                .map(|at| (at % WIDE, at / WIDE))
                .filter(|&(x, y)| is_in(x, y))
        };
        let left = places().filter(|&(x, y)| answer.at(x, y)).count();
        left as f64 / places().count() as f64
    };
    [share(in_leak), share(in_object)]
}

#[test]
fn exclude_click_in_the_middle_of_a_leak_removes_it_and_nothing_else() {
    let [leak, object] = kept(&excluded(
        &[click(152.0, 92.0, false)],
        AnswerSize::Automatic,
    ));
    assert!(
        leak < 0.1 && object > 0.97,
        "{leak:.3} of the leak and {object:.3} of the object left"
    );
    let include = click(80.0, 90.0, true);
    let clicks = [include, click(152.0, 92.0, false)];
    let [leak, object] = kept(&excluded(&clicks, AnswerSize::Automatic));
    assert!(
        leak < 0.1 && object > 0.97,
        "{leak:.3} of the leak and {object:.3} of the object left"
    );
}

#[test]
fn second_click_near_the_first_and_a_smaller_answer_are_local() {
    let clicks = [click(120.0, 92.0, false), click(152.0, 92.0, false)];
    let [second, _] = kept(&excluded(&clicks, AnswerSize::Automatic));
    let [smaller, _] = kept(&excluded(&clicks[1..], AnswerSize::Smaller));
    for leak in [second, smaller] {
        assert!((0.3..0.98).contains(&leak), "{leak:.3} of the leak left");
    }
}
