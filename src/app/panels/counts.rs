//! Confirmed frames and frames to check, in the status line.

use egui::{Button, Ui};
use ostra_project::review::CheckReason;

use crate::{Action, SessionView, ViewState};

/// Width of the status line below which only the frames to check are counted.
const NARROW: f32 = 1000.0;

/// Draws "2 of 16 frames confirmed · 7 to check" from right to left; a click goes to the next one.
pub(super) fn counts_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &ViewState,
    actions: &mut Vec<Action>,
) {
    if !session.has_frames() {
        return;
    }
    let (review, action) = (&view.frames.review, Action::NextUncertain);
    let is_narrow = ui.available_width() < NARROW;
    let can_go = action.unavailable(session, view).is_none();
    let button = ui
        .add_enabled(can_go, Button::new(review.to_check_text()).small())
        .on_hover_ui(|ui| tip_ui(ui, session, view))
        .on_disabled_hover_ui(|ui| tip_ui(ui, session, view));
    if button.clicked() {
        actions.push(action);
    }
    if !is_narrow {
        ui.label(format!("{} ·", review.confirmed_text()))
            .on_hover_text(
                "Keyframes: you gave or confirmed their masks. All other masks come from a tracker",
            );
    }
    ui.separator();
}

/// Says why the shown frame is to be checked, and which frame is next and why.
fn tip_ui(ui: &mut Ui, session: &SessionView<'_>, view: &ViewState) {
    let review = &view.frames.review;
    let texts = |reasons: &[CheckReason]| {
        let texts = reasons
            .iter()
            .map(|reason| reason.text(&session.project.labels));
        texts.collect::<Vec<_>>().join("; ")
    };
    if let Some(reasons) = review.to_check.get(&view.frame) {
        ui.label(format!("This frame: {}", texts(reasons)));
    }
    match review.next_after(view.frame) {
        Some(next) => {
            ui.label(format!("Frame {next}: {}", texts(&review.to_check[&next])));
            ui.label(view.prefs.shortcuts.tip(ui.ctx(), Action::NextUncertain));
        }
        None if review.to_check.is_empty() => {
            ui.label(
                "No tracked mask is stale, uncertain, in conflict with the 3-D vote or without an object of the frame before",
            );
        }
        None => {
            ui.label("No other frame is to be checked");
        }
    }
}
