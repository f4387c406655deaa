//! Tests of the ways to see and reach frames: filmstrip, legend, and the dialog that goes to one.

use std::sync::{Arc, Condvar, Mutex};

use egui::{Key, Modifiers, Rect, TextureId};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use ostra_app::Dialog;
use ostra_masks::{LabelId, RunMask};
use ostra_session::Images;

use crate::desk::{Desk, image, press, until};

type Shown = Harness<'static, Desk>;

const CTRL: Modifiers = Modifiers {
    ctrl: true,
    command: true,
    ..Modifiers::NONE
};

/// Returns the textures that are painted inside a rectangle, with the rectangle of each.
fn painted(harness: &Shown, rect: Rect) -> Vec<(TextureId, Rect)> {
    let shapes = harness.output().shapes.iter();
    let textures = shapes.map(|clipped| {
        let bounds = clipped.shape.visual_bounding_rect();
        (clipped.shape.texture_id(), bounds)
    });
    textures
        .filter(|(id, bounds)| *id != TextureId::default() && rect.contains_rect(*bounds))
        .collect()
}

#[test]
fn thumbnails_show_the_masks_and_follow_their_changes() {
    let mut harness = Desk::sample().shown();
    let tile = |harness: &Shown, name: &str| {
        let rect = harness.get_by_label(name).rect();
        painted(harness, rect).len()
    };
    until(&mut harness, |harness| {
        tile(harness, "Frame 0, keyframe") == 2 && tile(harness, "Frame 3, no mask") == 1
    });
    press(&mut harness, Modifiers::NONE, Key::M);
    assert_eq!(tile(&harness, "Frame 0, keyframe"), 1, "masks are off");
    press(&mut harness, Modifiers::NONE, Key::M);
    let before = {
        let rect = harness.get_by_label("Frame 0, keyframe").rect();
        painted(&harness, rect)[1].0
    };
    let mask = harness.state_mut().project.masks.get_mut(&0).unwrap();
    mask.runs = Arc::new(RunMask::new(64, 48, vec![(LabelId(3), 64 * 48)]).unwrap());
    until(&mut harness, |harness| {
        let rect = harness.get_by_label("Frame 0, keyframe").rect();
        painted(harness, rect)
            .get(1)
            .is_some_and(|(id, _)| *id != before)
    });
}

#[test]
fn frame_that_is_not_loaded_shows_its_thumbnail_enlarged() {
    let gate = Arc::new((Mutex::new(false), Condvar::new()));
    let opened = Arc::clone(&gate);
    // Only the first request of a frame, that of its thumbnail, is answered at once.
    let asked = Mutex::new(std::collections::BTreeSet::new());
    let load = move |frame: usize| {
        let is_first = asked.lock().unwrap().insert(frame);
        if frame == 7 && !is_first {
            let (is_open, changed) = &*gate;
            let closed = is_open.lock().unwrap();
            drop(changed.wait_while(closed, |is_open| !*is_open).unwrap());
        }
        Ok(Arc::new(image(frame)))
    };
    let mut desk = Desk::sample();
    desk.images = Images::new(load, || {});
    let mut harness = desk.shown();
    until(&mut harness, |harness| {
        let rect = harness.get_by_label("Frame 7, no mask").rect();
        !painted(harness, rect).is_empty()
    });
    harness.state_mut().shell.view.go_to(7);
    harness.run_steps(4);
    let pane = harness.get_by_label("Image 007.png").rect();
    let shown = painted(&harness, pane);
    assert_eq!(shown.len(), 1);
    let image = shown[0].1;
    assert!(image.width() > 0.9 * pane.width() || image.height() > 0.9 * pane.height());
    *opened.0.lock().unwrap() = true;
    opened.1.notify_all();
    until(&mut harness, |harness| {
        painted(harness, pane)
            .first()
            .is_some_and(|full| full.0 != shown[0].0)
    });
}

#[test]
fn legend_explains_the_marks() {
    let mut harness = Desk::sample().shown();
    harness.get_by_label("Legend").click();
    harness.run_steps(3);
    for text in [
        "keyframe: you gave or confirmed the mask",
        "stale: made from inputs that changed since",
        "uncertain; flagged below 50 %",
        "line in the middle: marked as absent",
        "very uncertain, or an object is lost",
    ] {
        harness.get_by_label(text);
    }
}

#[test]
fn ctrl_g_goes_to_a_frame_by_number_or_name() {
    let mut harness = Desk::sample().shown();
    for (text, expected) in [("7", 7), ("011", 11), ("004.PNG", 4)] {
        press(&mut harness, CTRL, Key::G);
        assert_eq!(harness.state().shell.view.dialog, Some(Dialog::GoToFrame));
        harness.event(egui::Event::Text(text.into()));
        harness.run_steps(2);
        let found = format!(
            "Frame {expected} ({} of 12) · {expected:03}.png",
            expected + 1
        );
        harness.get_by_label(&found);
        press(&mut harness, Modifiers::NONE, Key::Enter);
        let view = &harness.state().shell.view;
        assert_eq!((view.frame, view.dialog), (expected, None));
    }
}

#[test]
fn unknown_frame_is_an_error_and_esc_stays() {
    let mut harness = Desk::sample().shown();
    harness.get_by_label("Frame 0 (1 of 12)").click();
    harness.run_steps(3);
    harness.event(egui::Event::Text("12".into()));
    harness.run_steps(2);
    harness.get_by_label("No frame has this number or name");
    let go = harness.get_by_label("Show");
    assert!(go.accesskit_node().is_disabled());
    press(&mut harness, Modifiers::NONE, Key::Enter);
    assert_eq!(harness.state().shell.view.dialog, Some(Dialog::GoToFrame));
    press(&mut harness, Modifiers::NONE, Key::Escape);
    let view = &harness.state().shell.view;
    assert_eq!((view.frame, view.dialog), (0, None));
}
