use egui::{Event, EventFilter, Key, Pos2, Response, Ui};
use glam::DVec2;

use super::map::{CanvasMap, ZoomState};

/// Movement of the pointer per press of an arrow key, in screen points.
const STEP_POINTS: f64 = 8.0;

/// Distance from the pane's edge at which the image follows the pointer, in screen points.
const EDGE_POINTS: f32 = 24.0;

/// Pointer over the image that arrow keys move while the image has the keyboard.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct KeyPointer {
    at_px: Option<DVec2>,
    /// Mouse over the image when the window was last drawn, in screen points.
    mouse: Option<Pos2>,
    has_keyboard: bool,
    leads: bool,
}

impl KeyPointer {
    /// Keys that move and use the pointer, for the status bar.
    pub(crate) const HELP: &'static str =
        "Arrow keys move the pointer (Shift: by one pixel), Enter or Q includes, E excludes";

    /// Returns whether arrow keys and Enter go to the image.
    pub(crate) fn has_keyboard(&self) -> bool {
        self.has_keyboard
    }

    /// Returns the position in image pixels, unless the mouse was moved over the image since.
    pub(crate) fn at_px(&self) -> Option<DVec2> {
        self.at_px.filter(|_| self.leads)
    }

    /// Moves the pointer by the arrow keys that were pressed, and the image after it.
    ///
    /// Returns `true` if Enter was pressed.
    pub(super) fn follow(
        &mut self,
        ui: &Ui,
        response: &Response,
        map: &CanvasMap,
        zoom: &mut ZoomState,
    ) -> bool {
        let mouse = response.hover_pos();
        let mouse_px = mouse.and_then(|at| map.inside(map.to_px(at)));
        let has_mouse_moved = std::mem::replace(&mut self.mouse, mouse) != mouse;
        let had_keyboard = std::mem::replace(&mut self.has_keyboard, response.has_focus());
        if !self.has_keyboard {
            self.leads = false;
            return false;
        }
        ui.memory_mut(|memory| {
            let filter = EventFilter {
                horizontal_arrows: true,
                vertical_arrows: true,
                ..EventFilter::default()
            };
            memory.set_focus_lock_filter(response.id, filter);
        });
        let (moves, is_entered) = ui.input(|input| {
            let moves: Vec<Move> = input.events.iter().filter_map(Move::of).collect();
            (moves, input.key_pressed(Key::Enter))
        });
        if mouse_px.is_some() && has_mouse_moved {
            self.leads = false;
        }
        if moves.is_empty() && (had_keyboard || mouse_px.is_some()) {
            return is_entered && self.leads;
        }
        let middle = map.clamped(map.to_px(map.pane.center()));
        let mut at_px = match (self.leads, mouse_px) {
            (false, Some(mouse_px)) => mouse_px,
            _ => self.at_px.unwrap_or(middle),
        };
        for step in moves {
            at_px += step.towards * step.length_px(map);
        }
        let [width, height] = map.size_px.map(f64::from);
        let last = DVec2::new(width, height) - 1.0;
        let at_px = at_px.floor().clamp(DVec2::ZERO, last.max(DVec2::ZERO)) + 0.5;
        (self.at_px, self.leads) = (Some(at_px), true);
        bring_into_view(zoom, map, at_px);
        is_entered && had_keyboard
    }
}

/// One press of an arrow key.
struct Move {
    towards: DVec2,
    is_fine: bool,
}

impl Move {
    fn of(event: &Event) -> Option<Self> {
        let Event::Key {
            key,
            pressed: true,
            modifiers,
            ..
        } = event
        else {
            return None;
        };
        let towards = match key {
            Key::ArrowLeft => -DVec2::X,
            Key::ArrowRight => DVec2::X,
            Key::ArrowUp => -DVec2::Y,
            Key::ArrowDown => DVec2::Y,
            _ => return None,
        };
        Some(Self {
            towards,
            is_fine: modifiers.shift,
        })
    }

    fn length_px(&self, map: &CanvasMap) -> f64 {
        if self.is_fine {
            1.0
        } else {
            (STEP_POINTS / f64::from(map.scale)).round().max(1.0)
        }
    }
}

/// Moves the image so that a position in it lies within the pane.
fn bring_into_view(zoom: &mut ZoomState, map: &CanvasMap, at_px: DVec2) {
    let inner = map
        .pane
        .shrink(EDGE_POINTS.min(map.pane.size().min_elem() / 4.0));
    let at = map.to_screen(at_px);
    if !inner.contains(at) && zoom.scale.is_some() {
        zoom.pan(map, inner.clamp(at) - at);
    }
}

#[cfg(test)]
mod tests {
    use egui::{Rect, Vec2};

    use super::*;

    #[test]
    fn image_follows_a_position_out_of_the_pane() {
        let pane = Rect::from_min_size(Pos2::ZERO, Vec2::new(800.0, 600.0));
        let mut zoom = ZoomState {
            scale: Some(4.0),
            centre_px: DVec2::new(100.0, 100.0),
        };
        let at_px = DVec2::new(230.0, 90.0);
        let map = zoom.map(pane, [640, 480]);
        bring_into_view(&mut zoom, &map, at_px);
        let at = zoom.map(pane, [640, 480]).to_screen(at_px);
        assert!((at.x - (800.0 - EDGE_POINTS)).abs() < 1e-3, "{at}");
        let moved = zoom;
        bring_into_view(&mut zoom, &moved.map(pane, [640, 480]), at_px);
        assert_eq!(zoom, moved);
    }
}
