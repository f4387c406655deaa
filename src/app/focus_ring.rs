//! Ring around the control that has the keyboard.

use egui::{Color32, Context, Key, Stroke, StrokeKind, Visuals};

/// Width of the ring in points.
const WIDTH: f32 = 2.0;

/// Whether the user moves from control to control by keys.
#[derive(Default)]
pub(super) struct FocusRing {
    is_shown: bool,
}

impl FocusRing {
    /// Draws the ring after everything else; a press of the pointer hides it.
    pub(super) fn ui(&mut self, ctx: &Context) {
        let (travels, points) = ctx.input(|input| {
            (
                input.key_pressed(Key::Tab) || input.key_pressed(Key::F10),
                input.pointer.any_pressed(),
            )
        });
        self.is_shown = (self.is_shown || travels) && !points;
        if !self.is_shown {
            return;
        }
        let focused = ctx.memory(egui::Memory::focused);
        let Some(response) = focused.and_then(|id| ctx.read_response(id)) else {
            return;
        };
        // The part in sight: in a scrolled list the rest is cut off.
        let rect = response.interact_rect;
        if rect.is_positive() {
            let style = ctx.style_of(ctx.theme());
            let stroke = Stroke::new(WIDTH, ring_color(&style.visuals));
            ctx.layer_painter(response.layer_id).rect_stroke(
                rect.expand(1.0),
                4.0,
                stroke,
                StrokeKind::Outside,
            );
        }
    }
}

/// Returns the colour of the ring, which stands out from panels, buttons and fields.
pub(super) fn ring_color(visuals: &Visuals) -> Color32 {
    if visuals.dark_mode {
        Color32::from_rgb(110, 185, 255)
    } else {
        Color32::from_rgb(0, 85, 200)
    }
}
