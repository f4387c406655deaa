//! Close-ups: parts of a frame at full resolution.

use super::*;

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn close_up_lies_around_its_prompt() {
    let sam = flat();
    let prompt = Prompt {
        clicks: vec![IN_RED],
        boxes: vec![around(RED)],
        ..Prompt::default()
    };
    let part = ImagePart::around(&prompt, WIDTH, HEIGHT, sam.side()).unwrap();
    assert_eq!(
        part,
        ImagePart {
            x: 0,
            y: 0,
            width: 128,
            height: 128
        }
    );
    let far = PxBox {
        min_px: DVec2::ZERO,
        max_px: DVec2::new(250.0, 20.0),
    };
    assert_eq!(
        ImagePart::around(
            &Prompt {
                boxes: vec![far],
                ..Prompt::default()
            },
            WIDTH,
            HEIGHT,
            256
        ),
        None
    );
    assert_eq!(
        ImagePart::around(&Prompt::default(), WIDTH, HEIGHT, 256),
        None
    );
}

/// Returns the close-up of the 128 × 128 pixels from 16, 16.
fn close_up() -> SamFrame {
    let part = ImagePart {
        x: 16,
        y: 16,
        width: 128,
        height: 128,
    };
    frame(&flat(), part)
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn close_up_covers_only_its_part() {
    let close = close_up();
    let found = answer(&close, &[IN_RED], &[], None);
    assert!(
        found.iou(&thing(RED)) > 0.96,
        "twice as fine: {}",
        found.iou(&thing(RED))
    );
    let prompt = Prompt {
        clicks: vec![IN_GREEN],
        ..Prompt::default()
    };
    let error = close
        .segment(
            &SegmentRequest {
                prompt: &prompt,
                previous: None,
                taken: None,
            },
            &Progress::default(),
        )
        .unwrap_err();
    assert!(
        error.to_string().contains("128×128 pixels from 16, 16"),
        "{error}"
    );
    let box_beyond = answer(
        &close,
        &[],
        &[PxBox {
            min_px: DVec2::ZERO,
            max_px: DVec2::new(100.0, 112.0),
        }],
        None,
    );
    assert!(
        alike(&box_beyond, &thing(RED)),
        "the answer to a box covers only what is visible: {}",
        box_beyond.iou(&thing(RED))
    );
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn painted_strip_outside_the_close_up_stays() {
    let close = close_up();
    // A painted strip that begins outside the part: refining it inside leaves the rest unchanged.
    let strip = thing([0, 60, 80, 70]);
    let refined = answer(&close, &[click(50.5, 40.5, true)], &[], Some(&strip));
    let mut expected = thing(RED);
    expected.unite(&thing([0, 60, 32, 70]));
    assert!(
        refined.at(2, 62) && alike(&refined, &expected),
        "{}",
        refined.iou(&expected)
    );
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn close_up_is_embedded_once_for_all_prompts_in_it() {
    let sam = flat();
    let close = CloseUps::new(Arc::new(sam), Arc::new(image()));
    let answer = |clicks: &[Click], previous: Option<&Region>| {
        let prompt = Prompt {
            clicks: clicks.to_vec(),
            ..Prompt::default()
        };
        let request = SegmentRequest {
            prompt: &prompt,
            previous,
            taken: None,
        };
        close.segment(&request, &Progress::default())
    };
    let red = answer(&[IN_RED], None).unwrap();
    let close_by = |region: &Region| region.inside.iter().filter(|&&inside| inside).count();
    assert!(
        close_by(&red) > 0
            && thing(RED)
                .inside
                .iter()
                .zip(&red.inside)
                .all(|(thing, found)| *thing || !found)
    );
    let stopped = Progress::default();
    stopped.stop();
    let prompt = |clicks: Vec<Click>| Prompt {
        clicks,
        ..Prompt::default()
    };
    let asked = |prompt: &Prompt| {
        close
            .segment(
                &SegmentRequest {
                    prompt,
                    previous: None,
                    taken: None,
                },
                &stopped,
            )
            .map(|region| close_by(&region))
    };
    assert_eq!(
        asked(&prompt(vec![IN_RED])).unwrap(),
        close_by(&red),
        "it is known: nothing is left to stop"
    );
    assert!(
        asked(&prompt(vec![IN_GREEN])).is_err(),
        "a place that was not looked at yet can be stopped"
    );
    // An exclude click far away is not embedded, but still removes what was painted there.
    let painted = thing(GREEN);
    let far = Click {
        include: false,
        ..IN_GREEN
    };
    let both = answer(&[far, IN_RED], Some(&painted)).unwrap();
    assert!(!both.at(far.at_px.x as u32, far.at_px.y as u32));
    let newest = answer(&[IN_RED, far], Some(&painted)).unwrap();
    assert!(
        !newest.at(far.at_px.x as u32, far.at_px.y as u32),
        "the newest click is looked at, wherever it is"
    );
}
