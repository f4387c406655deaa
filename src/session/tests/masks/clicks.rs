//! Tests of clicks and boxes that are obeyed, repeated with another size, or without effect.

use super::*;
use ostra_masks::{AnswerSize, PxBox, Region};

/// Returns the command of a prompt for the stone with clicks to include, or to exclude.
fn prompt(clicks: &[(f64, f64, bool)], boxes: &[[f64; 4]], size: AnswerSize) -> Command {
    let click = |&(x, y, include): &(f64, f64, bool)| Click {
        at_px: DVec2::new(x, y),
        include,
    };
    let px_box = |&[x0, y0, x1, y1]: &[f64; 4]| PxBox {
        min_px: DVec2::new(x0, y0),
        max_px: DVec2::new(x1, y1),
    };
    Command::Prompt(PromptRequest {
        frame: 0,
        label: STONE,
        prompt: Prompt {
            clicks: clicks.iter().map(click).collect(),
            boxes: boxes.iter().map(px_box).collect(),
            size,
            ..Prompt::default()
        },
        segmenter: SegmenterId::Builtin,
    })
}

/// Executes a prompt and returns the message if it changed nothing.
fn unchanged(session: &mut Session, command: Command) -> Option<String> {
    session.act(command).unwrap();
    let events = session.settle(|_| ControlFlow::Continue(()));
    events.into_iter().find_map(|event| match event {
        Event::Unchanged { text, .. } => Some(text),
        Event::Failed { error, .. } => panic!("{error}"),
        _ => None,
    })
}

fn stone(session: &Session) -> Region {
    mask(session).region(STONE)
}

#[test]
fn click_without_effect_makes_no_step_and_no_keyframe_and_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(folder.path());
    perform(&mut session, square(STONE, 10.0, 30.0, false, true)).unwrap();
    let before = session.project().unwrap().clone();
    let title = session.undo_title().map(str::to_owned);
    for (click, expected) in [
        ((15.5, 15.5, true), "'stone' is here already"),
        ((50.5, 40.5, false), "'stone' is not here"),
    ] {
        let command = prompt(&[click], &[], AnswerSize::Automatic);
        let text = unchanged(&mut session, command).unwrap();
        assert!(
            text.starts_with("The click changed nothing: ") && text.contains(expected),
            "{text}"
        );
        assert_eq!(session.project().unwrap(), &before);
        assert_eq!(session.undo_title().map(str::to_owned), title);
    }
    let lock = RangeRequest {
        labels: vec![STONE],
        from: 0,
        to: 0,
        change: RangeChange::Lock,
        replace: false,
    };
    perform(&mut session, Command::Range(lock)).unwrap();
    let Command::Prompt(other) = prompt(&[(15.5, 15.5, true)], &[], AnswerSize::Automatic) else {
        unreachable!()
    };
    let other = PromptRequest {
        label: PLANT,
        ..other
    };
    session.act(Command::Prompt(other)).unwrap();
    let events = session.settle(|_| ControlFlow::Continue(()));
    let kept = stone(&session);
    assert_eq!(kept.area(), 400, "{events:?}");
}

#[test]
fn clicked_pixel_and_its_surroundings_obey_every_click() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(folder.path());
    perform(&mut session, square(STONE, 4.0, 44.0, false, true)).unwrap();
    let clicks = [(12.5, 12.5, false), (30.5, 30.5, false), (12.5, 13.5, true)];
    for count in 1..=clicks.len() {
        let command = prompt(&clicks[..count], &[], AnswerSize::Automatic);
        assert_eq!(unchanged(&mut session, command), None, "click {count}");
        let region = stone(&session);
        let (x, y, include) = clicks[count - 1];
        for at in [x - 1.0, x, x + 1.0] {
            assert_eq!(region.at(at as u32, y as u32), include, "click {count}");
        }
    }
}

#[test]
fn another_size_replaces_the_step_of_the_last_click() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(folder.path());
    let steps = session.undo_title().map(str::to_owned);
    let sized = |size| prompt(&[(30.5, 20.5, true)], &[], size);
    assert_eq!(session.last_prompt(), None);
    perform(&mut session, sized(AnswerSize::Automatic)).unwrap();
    assert_eq!(session.last_prompt(), Some((0, STONE)));
    let automatic = stone(&session);
    let mut areas = Vec::new();
    for size in AnswerSize::ALL {
        if unchanged(&mut session, sized(size)).is_none() {
            let stored = session.project().unwrap().prompts[&(0, STONE)].size;
            assert_eq!(stored, size);
        }
        assert!(stone(&session).at(30, 20), "{size:?}");
        areas.push(stone(&session).area());
    }
    assert!(areas.is_sorted(), "{areas:?}");
    assert!(areas[0] < areas[4], "{areas:?}");
    perform(&mut session, sized(AnswerSize::Automatic)).unwrap();
    assert_eq!(
        stone(&session),
        automatic,
        "the sizes are of the same click"
    );
    perform(&mut session, Command::Undo).unwrap();
    assert!(session.project().unwrap().prompts.is_empty(), "one step");
    assert_eq!(session.undo_title().map(str::to_owned), steps);
    let error = perform(
        &mut session,
        prompt(&[], &[[2.0, 2.0, 9.0, 9.0]], AnswerSize::Larger),
    );
    let error = error.unwrap_err().to_string();
    assert!(error.contains("the prompt has none"), "{error}");
}

#[test]
fn size_of_a_later_click_keeps_the_answers_before_it() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(folder.path());
    perform(&mut session, square(STONE, 2.0, 12.0, false, true)).unwrap();
    let clicks = [(30.5, 20.5, true)];
    perform(&mut session, prompt(&clicks, &[], AnswerSize::Automatic)).unwrap();
    let first = stone(&session);
    let text = unchanged(&mut session, prompt(&clicks, &[], AnswerSize::Smaller));
    let smaller = stone(&session);
    assert!(
        smaller.at(30, 20) && smaller.at(5, 5),
        "the drawn mask stays"
    );
    assert!(smaller.area() <= first.area());
    assert_eq!(text.is_some(), smaller == first, "{text:?}");
    if let Some(text) = text {
        assert!(text.contains("no smaller answer"), "{text}");
    }
}

#[test]
fn box_on_a_drawn_mask_keeps_what_is_outside_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(folder.path());
    perform(&mut session, square(STONE, 2.0, 10.0, false, true)).unwrap();
    // A box around a part of the red bar.
    let boxed = prompt(&[], &[[18.0, 20.0, 42.0, 44.0]], AnswerSize::Automatic);
    session.act(boxed).unwrap();
    let events = session.settle(|_| ControlFlow::Continue(()));
    let says = |event: &Event| matches!(event, Event::Notice(text) if text.contains("outside the box is kept"));
    assert!(events.iter().any(says), "{events:?}");
    let region = stone(&session);
    assert!(region.at(4, 4) && region.at(9, 9), "the drawn square stays");
    assert!(
        region.at(30, 30) && !region.at(50, 30),
        "and the bar is added"
    );
    let clicked = prompt(
        &[(5.5, 5.5, false)],
        &[[18.0, 20.0, 42.0, 44.0]],
        AnswerSize::Automatic,
    );
    perform(&mut session, clicked).unwrap();
    let region = stone(&session);
    assert!(
        !region.at(5, 5) && region.at(30, 30),
        "a click then corrects it"
    );
}

#[test]
fn box_on_a_prompted_mask_begins_again() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(folder.path());
    perform(
        &mut session,
        prompt(&[(5.5, 5.5, true)], &[], AnswerSize::Automatic),
    )
    .unwrap();
    let boxed = prompt(&[], &[[18.0, 20.0, 42.0, 44.0]], AnswerSize::Automatic);
    perform(&mut session, boxed).unwrap();
    let region = stone(&session);
    assert!(region.at(30, 30) && !region.at(5, 5));
}
