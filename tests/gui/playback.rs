//! Tests of playback, by its key and its buttons. All times are those of the harness.

use std::collections::BTreeSet;
use std::sync::{Arc, Condvar, Mutex};

use egui::{Event, Key, Modifiers, PointerButton};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use ostra_app::PlaySpeed;
use ostra_session::{Command, Images};

use crate::desk::{Desk, click_at, drag, image, on_screen, press, until};

type Shown = Harness<'static, Desk>;

/// Runs the window until the first frames are prepared for playback, and pauses again.
fn prepared(desk: Desk) -> Shown {
    let mut harness = desk.shown();
    let last = harness.state().project.frames.len() - 1;
    let frames: Vec<usize> = (0..=last).collect();
    until(&mut harness, |harness| {
        harness.state().images.play(&frames).len() == frames.len()
    });
    // Playback past the last mask has prepared all masks too.
    tap(&mut harness, Key::Space);
    until(&mut harness, |harness| frame(harness) == 7);
    tap(&mut harness, Key::Space);
    press(&mut harness, Modifiers::NONE, Key::Home);
    harness
}

fn frame(harness: &Shown) -> usize {
    harness.state().shell.view.frame
}

fn is_playing(harness: &Shown) -> bool {
    harness.state().shell.view.playback.is_playing()
}

/// Presses and releases a key within one frame of the window.
fn tap(harness: &mut Shown, key: Key) {
    harness.key_press(key);
    harness.run_steps(1);
}

/// Returns the frames shown in the next steps of a quarter of a second.
fn next(harness: &mut Shown, steps: usize) -> Vec<usize> {
    let step = |_| {
        harness.run_steps(1);
        frame(harness)
    };
    (0..steps).map(step).collect()
}

#[test]
fn space_plays_four_photos_a_second_and_pauses() {
    let mut harness = prepared(Desk::sample());
    harness.get_by_label("Play");
    tap(&mut harness, Key::Space);
    let shown = next(&mut harness, 5);
    assert_eq!(shown[4] - shown[0], 4, "{shown:?}");
    harness.get_by_label("Pause");
    harness.get_by_label(&format!("Frame {} ({} of 12)", shown[4], shown[4] + 1));
    tap(&mut harness, Key::Space);
    let paused = frame(&harness);
    assert_eq!(next(&mut harness, 4), [paused; 4]);
    assert!(harness.state().requested.is_empty(), "nothing was changed");
}

#[test]
fn speed_loop_and_range_are_chosen_in_the_timeline() {
    let mut harness = prepared(Desk::sample());
    harness.state_mut().shell.view.range = Some((4, 6));
    harness.run_steps(1);
    harness.get_by_label("Play").click();
    harness.run_steps(2);
    let shown: BTreeSet<usize> = next(&mut harness, 8).into_iter().collect();
    assert_eq!(shown, BTreeSet::from([4, 5, 6]));
    harness.get_by_label("Loop").click();
    let rest = next(&mut harness, 8);
    assert_eq!(rest[7], 6);
    assert!(!is_playing(&harness), "the end of the range");
    harness
        .get_by_role_and_label(egui::Role::ComboBox, "Playback speed")
        .click();
    harness.run_steps(3);
    harness.get_by_label("¼×").click();
    harness.run_steps(3);
    let speed = harness.state().shell.view.prefs.playback.speed;
    assert_eq!(speed, PlaySpeed::Quarter);
    harness.get_by_label("Play").click();
    harness.run_steps(2);
    let shown = next(&mut harness, 4);
    assert!(shown.iter().all(|&frame| frame <= 5), "{shown:?}");
}

#[test]
fn playback_pauses_at_frames_to_check() {
    let mut harness = prepared(Desk::sample());
    harness.get_by_label("Stop at frames to check").click();
    harness.run_steps(1);
    for expected in [2, 5, 2] {
        tap(&mut harness, Key::Space);
        let shown = next(&mut harness, 16);
        assert_eq!((shown[15], is_playing(&harness)), (expected, false));
    }
}

#[test]
fn click_on_the_image_only_pauses_and_the_next_one_labels() {
    let mut harness = prepared(Desk::sample());
    let at = on_screen(&harness, 30.0, 20.0);
    tap(&mut harness, Key::Space);
    harness.run_steps(2);
    click_at(&mut harness, at, PointerButton::Primary);
    assert!(!is_playing(&harness));
    let paused = frame(&harness);
    assert_eq!(harness.state().requested, [], "no prompt");
    click_at(&mut harness, at, PointerButton::Primary);
    let requested = &harness.state().requested;
    assert!(
        matches!(requested[..], [Command::Prompt(ref prompt)] if prompt.frame == paused),
        "{requested:?}"
    );
}

#[test]
fn step_keys_edits_and_dialogs_pause() {
    for (modifiers, key) in [
        (Modifiers::NONE, Key::ArrowLeft),
        (Modifiers::NONE, Key::Home),
        (Modifiers::NONE, Key::D),
        (Modifiers::NONE, Key::F1),
        (Modifiers::NONE, Key::T),
    ] {
        let mut harness = prepared(Desk::sample());
        tap(&mut harness, Key::Space);
        assert!(is_playing(&harness));
        press(&mut harness, modifiers, key);
        assert!(!is_playing(&harness), "{key:?}");
    }
}

#[test]
fn space_with_a_drag_moves_the_image_and_does_not_play() {
    let mut harness = prepared(Desk::sample());
    let at = on_screen(&harness, 30.0, 20.0);
    let space = |pressed| Event::Key {
        key: Key::Space,
        physical_key: None,
        pressed,
        repeat: false,
        modifiers: Modifiers::NONE,
    };
    harness.hover_at(at);
    harness.event(space(true));
    harness.run_steps(1);
    drag(
        &mut harness,
        at,
        at + egui::vec2(40.0, 0.0),
        PointerButton::Primary,
    );
    harness.event(space(false));
    harness.run_steps(2);
    assert!(!is_playing(&harness));
    assert_eq!(frame(&harness), 0);
    assert!(harness.state().shell.view.zoom.scale.is_some(), "moved");
}

#[test]
fn space_types_in_a_field_and_presses_the_focused_control() {
    let mut harness = Desk::sample().shown();
    for name in ["New label name", "Loop"] {
        harness.get_by_label(name).focus();
        harness.run_steps(2);
        tap(&mut harness, Key::Space);
        harness.run_steps(1);
        assert!(!is_playing(&harness), "{name}");
    }
}

#[test]
fn frame_that_is_not_decoded_is_waited_for() {
    let gate = Arc::new((Mutex::new(2), Condvar::new()));
    let opened = Arc::clone(&gate);
    let load = move |frame: usize| {
        let (least, changed) = &*gate;
        let closed = least.lock().unwrap();
        drop(changed.wait_while(closed, |least| frame > *least).unwrap());
        Ok(Arc::new(image(frame)))
    };
    let mut desk = Desk::sample();
    desk.images = Images::new(load, || {});
    // Thumbnails would wait for the gate in the same threads.
    desk.shell.view.steps.is_bare = true;
    let mut harness = desk.shown();
    tap(&mut harness, Key::Space);
    until(&mut harness, |harness| frame(harness) == 2);
    assert_eq!(next(&mut harness, 12), [2; 12]);
    assert!(is_playing(&harness));
    *opened.0.lock().unwrap() = 11;
    opened.1.notify_all();
    until(&mut harness, |harness| frame(harness) > 4);
}

#[test]
fn one_frame_cannot_be_played_and_the_button_says_why() {
    let mut desk = Desk::sample();
    let frames = desk.project.frames[..1].to_vec();
    desk.project.frames = Arc::new(frames);
    desk.project.masks.retain(|&frame, _| frame == 0);
    let mut harness = desk.shown();
    let play = harness.get_by_label("Play");
    assert!(play.accesskit_node().is_disabled());
    play.hover();
    harness.run_steps(8);
    harness.get_by_label("Needs at least two frames");
    tap(&mut harness, Key::Space);
    assert!(!is_playing(&harness));
}
