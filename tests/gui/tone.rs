//! Tests of brightness and contrast of the shown image.

use std::time::Duration;

use egui::epaint::ImageData;
use egui::{Color32, Key, Modifiers, PointerButton};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use ostra_app::{Panes, Tone};

use crate::desk::{Desk, HEIGHT, WIDTH, click_at, image, on_screen, press};

fn shown() -> Harness<'static, Desk> {
    let mut desk = Desk::sample();
    desk.shell.view.prefs.panes = Panes::Image;
    desk.shell.view.masks_shown = false;
    desk.shown()
}

/// Draws until an image of the size of a frame is drawn again, and returns its pixels.
fn next_image(harness: &mut Harness<'_, Desk>) -> Vec<Color32> {
    for _ in 0..200 {
        harness.step();
        let drawn = &harness.output().textures_delta.set;
        for (_, delta) in drawn {
            let ImageData::Color(pixels) = &delta.image;
            let is_frame = pixels.size == [WIDTH as usize, HEIGHT as usize];
            // The mask has transparent pixels; thumbnails have another filter.
            if is_frame && delta.options.magnification == egui::TextureFilter::Nearest {
                return pixels.pixels.clone();
            }
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    panic!("no image was drawn");
}

fn original() -> Vec<Color32> {
    let opaque = |[r, g, b]: [u8; 3]| Color32::from_rgb(r, g, b);
    image(0).pixels.into_iter().map(opaque).collect()
}

/// Returns a desk whose image is drawn only after the returned harness is stepped.
fn reloaded(tone: Tone) -> Vec<Color32> {
    let mut desk = Desk::sample();
    desk.shell.view.prefs.panes = Panes::Image;
    desk.shell.view.masks_shown = false;
    desk.shell.view.tone = tone;
    let size = desk.size;
    let mut harness = Harness::builder()
        .with_size(size)
        .build_ui_state(|ui, desk: &mut Desk| desk.ui(ui), desk);
    next_image(&mut harness)
}

#[test]
fn image_is_drawn_as_it_is_by_default() {
    assert_eq!(reloaded(Tone::default()), original());
}

#[test]
fn drawn_pixels_change_while_those_of_the_frame_do_not() {
    let mut harness = shown();
    for _ in 0..50 {
        harness.step();
        std::thread::sleep(Duration::from_millis(5));
    }
    harness.state_mut().shell.view.tone.brightness = 0.5;
    let bright = next_image(&mut harness);
    let sum = |pixels: &[Color32]| -> u64 { pixels.iter().map(|p| u64::from(p.g())).sum() };
    assert!(sum(&bright) > sum(&original()) * 5 / 4);
    let loaded = harness.state().images.image(0).unwrap();
    assert_eq!(loaded.pixels, image(0).pixels, "the frame is unchanged");
    harness.state_mut().shell.view.tone = Tone::default();
    assert_eq!(next_image(&mut harness), original());
    let at = on_screen(&harness, 30.5, 20.5);
    click_at(&mut harness, at, PointerButton::Primary);
    let with_default = harness.state().requested.clone();
    harness.state_mut().requested.clear();
    harness.state_mut().shell.view.draft = Default::default();
    harness.state_mut().shell.view.tone.contrast = -0.8;
    harness.run_steps(2);
    click_at(&mut harness, at, PointerButton::Primary);
    assert_eq!(
        harness.state().requested,
        with_default,
        "a click asks for the same mask"
    );
}

#[test]
fn menu_in_the_tool_row_changes_and_resets_both() {
    let mut harness = shown();
    harness.get_by_label("Brightness and contrast").click();
    harness.run_steps(4);
    let reset = harness.get_by_label("Reset");
    assert!(reset.accesskit_node().is_disabled(), "nothing to reset");
    for name in ["Brightness", "Contrast"] {
        harness
            .get_by_role_and_label(egui::Role::Slider, name)
            .focus();
        harness.run_steps(2);
        press(&mut harness, Modifiers::NONE, Key::ArrowRight);
    }
    let tone = harness.state().shell.view.tone;
    assert!(tone.brightness > 0.0 && tone.contrast > 0.0, "{tone:?}");
    harness.get_by_label("Reset").click();
    harness.run_steps(3);
    assert_eq!(harness.state().shell.view.tone, Tone::default());
}

#[test]
fn tone_belongs_to_the_open_project() {
    let mut harness = shown();
    harness.state_mut().shell.view.tone.contrast = 0.4;
    press(&mut harness, Modifiers::NONE, Key::ArrowRight);
    assert_eq!(harness.state().shell.view.tone.contrast, 0.4, "kept");
    harness.state_mut().shell.project_changed();
    assert_eq!(harness.state().shell.view.tone, Tone::default());
}
