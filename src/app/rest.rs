use egui::{Pos2, Ui};

/// How long the pointer rests before something is told of what lies under it, in seconds.
const REST_S: f64 = 0.12;
/// Movements below this are a hand at rest, in screen points.
const STILL: f32 = 2.0;

/// Where on the screen the pointer rests, and since when.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rest {
    at: Pos2,
    since_s: f64,
}

impl Rest {
    /// Follows the pointer; where it rests, once it does so for long enough. Until then the window is drawn again in time.
    pub(super) fn follow(rest: &mut Option<Self>, ui: &Ui, at: Pos2) -> Option<Pos2> {
        let now = ui.input(|input| input.time);
        let same = rest
            .filter(|rest| rest.at.distance(at) < STILL)
            .unwrap_or(Self { at, since_s: now });
        *rest = Some(same);
        let left_s = same.since_s + REST_S - now;
        if left_s > 0.0 {
            ui.ctx().request_repaint_after_secs(left_s as f32);
        }
        (left_s <= 0.0).then_some(same.at)
    }
}
