mod leaks;
mod thin;

use std::sync::Arc;

use glam::DVec2;
use proptest::prelude::*;

use super::BuiltinSegmenter;
use crate::{Click, MaskError, PreparedFrame, Prompt, PxBox, Region, SegmentRequest, Segmenter};
use ostra_core::job::Progress;
use ostra_frames::{DepthMap, Image};

const WIDTH: u32 = 160;
const HEIGHT: u32 = 120;

/// Returns a noisy image with a colour chosen per pixel.
fn image(width: u32, height: u32, color: impl Fn(u32, u32) -> [u8; 3]) -> Arc<Image> {
    let pixel = |at: u32| {
        let noise = (at.wrapping_mul(2_654_435_761) >> 28) as u8;
        color(at % width, at / width).map(|channel| channel.saturating_add(noise))
    };
    Arc::new(Image {
        width,
        height,
        pixels: (0..width * height).map(pixel).collect(),
    })
}

fn in_disc(x: u32, y: u32) -> bool {
    (f64::from(x) - 90.0).hypot(f64::from(y) - 60.0) < 30.0
}

/// Returns red inside of an object and green outside.
fn disc_color(is_inside: bool) -> [u8; 3] {
    if is_inside {
        [180, 60, 40]
    } else {
        [70, 110, 90]
    }
}

fn disc_image() -> Arc<Image> {
    image(WIDTH, HEIGHT, |x, y| disc_color(in_disc(x, y)))
}

fn prepared(image: &Arc<Image>, depth: Option<DepthMap>) -> Arc<dyn PreparedFrame> {
    BuiltinSegmenter
        .prepare(image, depth.map(Arc::new).as_ref(), &Progress::default())
        .unwrap()
}

fn click(x: f64, y: f64, include: bool) -> Click {
    Click {
        at_px: DVec2::new(x, y),
        include,
    }
}

fn ask(frame: &dyn PreparedFrame, prompt: &Prompt, taken: Option<&Region>) -> Region {
    frame
        .segment(
            &SegmentRequest {
                prompt,
                previous: None,
                taken,
            },
            &Progress::default(),
        )
        .unwrap()
}

fn of_clicks(clicks: &[Click]) -> Prompt {
    Prompt {
        clicks: clicks.to_vec(),
        ..Prompt::default()
    }
}

fn iou(answer: &Region, truth: impl Fn(u32, u32) -> bool) -> f64 {
    let places = || (0..answer.height).flat_map(|y| (0..answer.width).map(move |x| (x, y)));
    let both = places()
        .filter(|&(x, y)| answer.at(x, y) && truth(x, y))
        .count();
    let any = places()
        .filter(|&(x, y)| answer.at(x, y) || truth(x, y))
        .count();
    both as f64 / any as f64
}

#[test]
fn one_click_selects_a_distinct_object() {
    let frame = prepared(&disc_image(), None);
    let answer = ask(&*frame, &of_clicks(&[click(90.0, 60.0, true)]), None);
    assert!(
        iou(&answer, in_disc) > 0.95,
        "IoU {}",
        iou(&answer, in_disc)
    );
}

#[test]
fn box_selects_the_object_in_it() {
    let frame = prepared(&disc_image(), None);
    let part = PxBox {
        min_px: DVec2::new(58.0, 28.0),
        max_px: DVec2::new(122.0, 92.0),
    };
    let answer = ask(
        &*frame,
        &Prompt {
            boxes: vec![part],
            ..Prompt::default()
        },
        None,
    );
    assert!(
        iou(&answer, in_disc) > 0.95,
        "IoU {}",
        iou(&answer, in_disc)
    );
}

#[test]
fn click_selects_most_of_a_thin_leaf() {
    let on_leaf = |x: u32, y: u32| {
        (f64::from(x) - 30.0 - 0.5 * f64::from(y)).abs() < 2.5 && (5..115).contains(&y)
    };
    let image = image(WIDTH, HEIGHT, |x, y| {
        if on_leaf(x, y) {
            [90, 150, 50]
        } else {
            [120, 105, 100]
        }
    });
    let answer = ask(
        &*prepared(&image, None),
        &of_clicks(&[click(60.5, 60.5, true)]),
        None,
    );
    assert!(iou(&answer, on_leaf) > 0.7, "IoU {}", iou(&answer, on_leaf));
}

#[test]
fn depth_separates_objects_of_equal_colour() {
    let image = image(WIDTH, HEIGHT, |x, y| {
        [80 + ((x / 7 + y / 5) % 3 * 20) as u8, 120, 70]
    });
    let depths = (0..WIDTH * HEIGHT)
        .map(|at| {
            if in_disc(at % WIDTH, at / WIDTH) {
                0.9
            } else {
                1.3
            }
        })
        .collect();
    let depth = DepthMap {
        width: WIDTH,
        height: HEIGHT,
        depths,
    };
    let answer = ask(
        &*prepared(&image, Some(depth)),
        &of_clicks(&[click(90.0, 60.0, true)]),
        None,
    );
    assert!(iou(&answer, in_disc) > 0.9, "IoU {}", iou(&answer, in_disc));
}

#[test]
fn taken_pixels_are_excluded() {
    let image = disc_image();
    let taken = Region {
        width: WIDTH,
        height: HEIGHT,
        inside: (0..WIDTH * HEIGHT).map(|at| at % WIDTH < 80).collect(),
    };
    let answer = ask(
        &*prepared(&image, None),
        &of_clicks(&[click(100.0, 60.0, true)]),
        Some(&taken),
    );
    assert!(
        answer
            .inside
            .iter()
            .zip(&taken.inside)
            .all(|(answer, taken)| !(answer & taken))
    );
    assert!(iou(&answer, |x, y| in_disc(x, y) && x >= 80) > 0.9);
}

#[test]
fn distant_click_does_not_change_the_previous_answer() {
    let in_second = |x: u32, y: u32| (5..35).contains(&x) && (5..35).contains(&y);
    let image = image(WIDTH, HEIGHT, |x, y| {
        match (in_disc(x, y), in_second(x, y)) {
            (true, _) => [180, 60, 40],
            (_, true) => [40, 60, 190],
            _ => [70, 110, 90],
        }
    });
    let frame = prepared(&image, None);
    let mut previous = Region::empty(WIDTH, HEIGHT);
    // A ragged mask, as if painted by hand.
    previous
        .inside
        .iter_mut()
        .enumerate()
        .for_each(|(at, inside)| {
            *inside = in_disc(at as u32 % WIDTH, at as u32 / WIDTH) && at % 3 != 0;
        });
    let prompt = of_clicks(&[click(90.0, 60.0, true), click(20.0, 20.0, true)]);
    let request = SegmentRequest {
        prompt: &prompt,
        previous: Some(&previous),
        taken: None,
    };
    let answer = frame.segment(&request, &Progress::default()).unwrap();
    let kept = (0..WIDTH * HEIGHT).filter(|at| at % WIDTH > 50 && in_disc(at % WIDTH, at / WIDTH));
    let changed = kept
        .filter(|&at| answer.inside[at as usize] != previous.inside[at as usize])
        .count();
    assert!(
        changed < 200,
        "{changed} pixels of the first object changed"
    );
    assert!((6..34).all(|x| answer.at(x, 20)));
}

/// The disc with a piece missing at its right side, and with a wrong square next to it.
fn damaged_disc() -> Region {
    let inside = |x: u32, y: u32| {
        let is_missed = (108..116).contains(&x) && (56..64).contains(&y);
        in_disc(x, y) && !is_missed || (20..26).contains(&x) && (20..26).contains(&y)
    };
    let inside = (0..WIDTH * HEIGHT)
        .map(|at| inside(at % WIDTH, at / WIDTH))
        .collect();
    Region {
        width: WIDTH,
        height: HEIGHT,
        inside,
    }
}

fn corrected(
    frame: &dyn PreparedFrame,
    previous: &Region,
    clicks: &[Click],
    taken: Option<&Region>,
) -> Region {
    let prompt = Prompt {
        corrects: true,
        ..of_clicks(clicks)
    };
    let request = SegmentRequest {
        prompt: &prompt,
        previous: Some(previous),
        taken,
    };
    frame.segment(&request, &Progress::default()).unwrap()
}

#[test]
fn click_on_a_given_mask_corrects_only_the_clicked_error() {
    let frame = prepared(&disc_image(), None);
    let damaged = damaged_disc();
    let missed = click(112.0, 60.0, true);
    let repaired = corrected(&*frame, &damaged, &[missed], None);
    let pixels = || (0..WIDTH * HEIGHT).map(|at| (at % WIDTH, at / WIDTH));
    assert!(
        pixels().all(|(x, y)| repaired.at(x, y) || !damaged.at(x, y)),
        "who includes takes nothing away"
    );
    let added = || pixels().filter(|&(x, y)| repaired.at(x, y) && !damaged.at(x, y));
    let (right, wrong) = (
        added().filter(|&(x, y)| in_disc(x, y)).count(),
        added().filter(|&(x, y)| !in_disc(x, y)).count(),
    );
    assert!(
        right > 50 && wrong < 4,
        "{right} of the 64 missed, {wrong} outside the disc"
    );
    let both = corrected(
        &*frame,
        &repaired,
        &[missed, click(23.0, 23.0, false)],
        None,
    );
    let disc = |x: u32, y: u32| x > 40 && repaired.at(x, y);
    assert_eq!(iou(&both, disc), 1.0, "the square goes, and nothing else");
    assert_eq!(
        corrected(&*frame, &both, &[missed, click(90.0, 60.0, true)], None),
        both,
        "what is right already stays"
    );
}

#[test]
fn given_masks_are_corrected_at_full_size_up_to_the_edge_and_by_regions_with_depth() {
    let inside = |x: u32, y: u32| (x > 900) && (300..900).contains(&y);
    let image = image(1601, 1203, |x, y| disc_color(inside(x, y)));
    let is_missed = |x: u32, y: u32| x >= 1585 && (590..606).contains(&y);
    let mut damaged = Region::empty(1601, 1203);
    for at in 0..1601 * 1203 {
        damaged.inside[at as usize] =
            inside(at % 1601, at / 1601) && !is_missed(at % 1601, at / 1601);
    }
    let frame = prepared(&image, None);
    let repaired = corrected(&*frame, &damaged, &[click(1600.5, 598.0, true)], None);
    let added = || {
        (0..1601 * 1203u32)
            .filter(|&at| repaired.inside[at as usize] && !damaged.inside[at as usize])
    };
    assert!(
        added().count() > 150 && added().all(|at| is_missed(at % 1601, at / 1601)),
        "{} of 256",
        added().count()
    );
    let depth = || {
        Some(DepthMap {
            width: WIDTH,
            height: HEIGHT,
            depths: vec![1.0; (WIDTH * HEIGHT) as usize],
        })
    };
    let frame = prepared(&disc_image(), depth());
    let prompt = of_clicks(&[click(112.0, 60.0, true)]);
    let request = SegmentRequest {
        prompt: &prompt,
        previous: Some(&damaged_disc()),
        taken: None,
    };
    let by_regions = frame.segment(&request, &Progress::default()).unwrap();
    assert_eq!(
        corrected(&*frame, &damaged_disc(), &prompt.clicks, None),
        by_regions
    );
}

#[test]
fn correction_respects_earlier_clicks_and_taken_pixels() {
    let frame = prepared(&disc_image(), None);
    let damaged = damaged_disc();
    let clicks = [click(109.5, 57.5, false), click(112.0, 60.0, true)];
    let repaired = corrected(&*frame, &damaged, &clicks, None);
    assert!(
        repaired.at(112, 60) && !repaired.at(109, 57),
        "the earlier click holds"
    );
    let again = [click(112.0, 60.0, false), click(112.0, 60.0, true)];
    assert!(
        corrected(&*frame, &damaged, &again, None).at(112, 60),
        "who clicks there again takes it back"
    );
    let mut taken = Region::empty(WIDTH, HEIGHT);
    (56..64).for_each(|y| taken.inside[(y * WIDTH + 114) as usize] = true);
    let repaired = corrected(&*frame, &damaged, &clicks[1..], Some(&taken));
    assert!(repaired.at(112, 60) && (56..64).all(|y| !repaired.at(114, y)));
}

#[test]
fn large_image_is_answered_at_full_size() {
    let inside = |x: u32, y: u32| (f64::from(x) - 901.0).hypot(f64::from(y) - 600.0) < 300.0;
    let image = image(1601, 1203, |x, y| disc_color(inside(x, y)));
    let frame = prepared(&image, None);
    let answer = ask(&*frame, &of_clicks(&[click(901.0, 600.0, true)]), None);
    assert!(iou(&answer, inside) > 0.97, "IoU {}", iou(&answer, inside));
}

#[test]
fn smallest_images_have_answers() {
    for (width, height) in [(1, 1), (1, 7), (9, 1), (2, 2), (5, 4)] {
        let frame = prepared(&image(width, height, |x, _| [x as u8 * 20, 80, 90]), None);
        let answer = ask(&*frame, &of_clicks(&[click(0.5, 0.5, true)]), None);
        assert!(answer.at(0, 0) && answer.inside.len() == (width * height) as usize);
    }
}

#[test]
fn invalid_requests_are_errors() {
    let frame = prepared(&disc_image(), None);
    let fails = |prompt: &Prompt, previous: Option<&Region>| {
        matches!(
            frame.segment(
                &SegmentRequest {
                    prompt,
                    previous,
                    taken: None
                },
                &Progress::default()
            ),
            Err(MaskError::Request(_))
        )
    };
    let outside = PxBox {
        min_px: DVec2::new(200.0, 0.0),
        max_px: DVec2::new(210.0, 9.0),
    };
    assert!(fails(&Prompt::default(), None));
    assert!(fails(&of_clicks(&[click(-1.0, 5.0, true)]), None));
    assert!(fails(&of_clicks(&[click(f64::NAN, 5.0, true)]), None));
    assert!(fails(
        &Prompt {
            boxes: vec![outside],
            ..Prompt::default()
        },
        None
    ));
    assert!(fails(
        &of_clicks(&[click(5.0, 5.0, true)]),
        Some(&Region::empty(3, 3))
    ));
    let wrong = Arc::new(DepthMap {
        width: 2,
        height: 2,
        depths: vec![1.0; 4],
    });
    assert!(
        BuiltinSegmenter
            .prepare(&disc_image(), Some(&wrong), &Progress::default())
            .is_err()
    );
    let stopped = Progress::default();
    stopped.stop();
    assert!(matches!(
        BuiltinSegmenter.prepare(&disc_image(), None, &stopped),
        Err(MaskError::Stopped(_))
    ));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn clicks_hold_and_answers_repeat(
        places in prop::collection::vec((0.0..f64::from(WIDTH), 0.0..f64::from(HEIGHT), any::<bool>()), 1..7),
    ) {
        hold_and_repeat(&places);
    }
}

#[test]
fn click_in_the_corner_holds_next_to_two_close_clicks() {
    hold_and_repeat(&[
        (121.189, 118.250, false),
        (117.620, 101.477, true),
        (0.0, 0.0, true),
    ]);
}

/// Clicks the disc image at `places` (x, y in pixels, whether to include), one after the other.
///
/// Asserts that every earlier click holds in each answer, that answers are reproducible, and that
/// the last answer equals the answer to all clicks at once.
fn hold_and_repeat(places: &[(f64, f64, bool)]) {
    // One click per pixel: a pixel cannot be both included and excluded.
    let mut clicks: Vec<Click> = Vec::new();
    for &(x, y, include) in places {
        if clicks
            .iter()
            .all(|other| other.at_px.distance(DVec2::new(x, y)) > 3.0)
        {
            clicks.push(click(x.floor() + 0.5, y.floor() + 0.5, include));
        }
    }
    let frame = prepared(&disc_image(), None);
    let mut answer: Option<Region> = None;
    for count in 1..=clicks.len() {
        let prompt = of_clicks(&clicks[..count]);
        let request = SegmentRequest {
            prompt: &prompt,
            previous: answer.as_ref(),
            taken: None,
        };
        let found = frame.segment(&request, &Progress::default()).unwrap();
        assert!(
            found == frame.segment(&request, &Progress::default()).unwrap(),
            "the answer of {count} clicks repeats"
        );
        for click in &clicks[..count] {
            let at = click.at_px;
            assert_eq!(
                found.at(at.x as u32, at.y as u32),
                click.include,
                "{at} after {count} clicks"
            );
        }
        answer = Some(found);
    }
    assert!(
        answer == Some(ask(&*frame, &of_clicks(&clicks), None)),
        "one by one as at once"
    );
}
