//! Tests of brightness and contrast of the shown image.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use egui::epaint::ImageData;
use egui::{
    Color32, Context, FullOutput, Key, Modifiers, PointerButton, TextureFilter, TexturesDelta,
};
use egui_kittest::kittest::{NodeT, Queryable};
use egui_kittest::{Harness, TestRenderer};
use ostra_app::{Panes, Tone};

use crate::desk::{Desk, HEIGHT, WIDTH, click_at, image, on_screen, press};

/// Images of the size of a frame that were drawn, latest last.
type Drawn = Arc<Mutex<Vec<Vec<Color32>>>>;

/// Records what is uploaded to the graphics card.
struct Recorder(Drawn);

impl TestRenderer for Recorder {
    fn handle_delta(&mut self, delta: &mut TexturesDelta) {
        let delta = std::mem::take(delta);
        for change in delta.set.values().flatten() {
            let ImageData::Color(image) = &change.image;
            let is_frame = image.size == [WIDTH as usize, HEIGHT as usize];
            // Thumbnails have another filter.
            if is_frame && change.options.magnification == TextureFilter::Nearest {
                self.0.lock().unwrap().push(image.pixels.clone());
            }
        }
    }

    fn render(&mut self, _: &Context, _: &FullOutput) -> Result<image::RgbaImage, String> {
        Err("nothing is rendered".into())
    }
}

/// Returns a window that shows an image without masks, and its images.
fn shown() -> (Harness<'static, Desk>, Drawn) {
    let mut desk = Desk::sample();
    desk.shell.view.prefs.panes = Panes::Image;
    desk.shell.view.masks_shown = false;
    let drawn = Drawn::default();
    let builder = Harness::builder().renderer(Recorder(Arc::clone(&drawn)));
    (desk.shown_by(builder), drawn)
}

/// Draws until there is another image, and returns its pixels.
#[expect(
    clippy::disallowed_methods,
    reason = "the image is loaded by a thread that the test cannot wait for"
)]
fn next_image((harness, drawn): &mut (Harness<'static, Desk>, Drawn)) -> Vec<Color32> {
    for _ in 0..200 {
        if let Some(pixels) = drawn.lock().unwrap().drain(..).next_back() {
            return pixels;
        }
        harness.step();
        std::thread::sleep(Duration::from_millis(10));
    }
    panic!("no image was drawn");
}

fn original() -> Vec<Color32> {
    let opaque = |[r, g, b]: [u8; 3]| Color32::from_rgb(r, g, b);
    image(0).pixels.into_iter().map(opaque).collect()
}

#[test]
fn drawn_pixels_change_while_those_of_the_frame_do_not() {
    let mut window = shown();
    assert_eq!(next_image(&mut window), original(), "as it is by default");
    window.0.state_mut().shell.view.tone.brightness = 0.5;
    let bright = next_image(&mut window);
    let sum = |pixels: &[Color32]| -> u64 { pixels.iter().map(|p| u64::from(p.g())).sum() };
    assert!(sum(&bright) > sum(&original()) * 5 / 4);
    let loaded = window.0.state().images.image(0).unwrap();
    assert_eq!(loaded.pixels, image(0).pixels, "the frame is unchanged");
    window.0.state_mut().shell.view.tone = Tone::default();
    assert_eq!(next_image(&mut window), original());
    let (mut harness, _) = window;
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
    let (mut harness, _) = shown();
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
    let (mut harness, _) = shown();
    harness.state_mut().shell.view.tone.contrast = 0.4;
    press(&mut harness, Modifiers::NONE, Key::ArrowRight);
    assert_eq!(harness.state().shell.view.tone.contrast, 0.4, "kept");
    harness.state_mut().shell.project_changed();
    assert_eq!(harness.state().shell.view.tone, Tone::default());
}
