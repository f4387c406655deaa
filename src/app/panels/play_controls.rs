//! Controls left of the filmstrip: playback and the legend of the marks.

use egui::{ComboBox, Pos2, Rect, Sense, Ui, Vec2};

use super::filmstrip::{FrameState, badge};
use super::heat::{CONFIRMED, heat};
use crate::icons::{Icon, IconButton};
use crate::playback::PlaySpeed;
use crate::{Action, SessionView, ViewState};

/// Width of the controls, that of the names in the timeline, so that frames are below each other.
pub(crate) const CONTROLS_WIDTH: f32 = 120.0;

/// Draws the controls of playback and the button of the legend, left of strip and filmstrip.
pub(crate) fn play_controls_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    actions: &mut Vec<Action>,
) {
    ui.spacing_mut().item_spacing = Vec2::splat(3.0);
    playback_ui(ui, session, view, actions);
    ui.horizontal(|ui| {
        speed_ui(ui, view);
        ui.menu_button("?", |ui| legend_ui(ui, view))
            .response
            .on_hover_text("Explain the marks of filmstrip, strip and timeline")
            .accessible_name("Legend");
    });
}

fn speed_ui(ui: &mut Ui, view: &mut ViewState) {
    let speed = &mut view.prefs.playback.speed;
    let list = ComboBox::from_id_salt("playback speed")
        .width(48.0)
        .selected_text(speed.text())
        .show_ui(ui, |ui| {
            for other in PlaySpeed::ALL {
                ui.selectable_value(speed, other, other.text());
            }
        });
    list.response
        .on_hover_text("Speed: the frame rate of a video, or four photos per second")
        .accessible_name("Playback speed");
}

fn playback_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    actions: &mut Vec<Action>,
) {
    let action = Action::TogglePlay;
    let (icon, name) = if view.playback.is_playing() {
        (Icon::Pause, "Pause")
    } else {
        (Icon::Play, "Play")
    };
    let unavailable = action.unavailable(session, view);
    let tip = view.prefs.shortcuts.tip(ui.ctx(), action);
    let play = IconButton {
        icon,
        name,
        tip: &tip,
        selected: None,
        unavailable,
    };
    let prefs = &mut view.prefs.playback;
    let repeat = IconButton {
        icon: Icon::Loop,
        name: "Loop",
        tip: "Start again after the last frame of the range, or of all frames",
        selected: Some(prefs.loops),
        unavailable: None,
    };
    let stop = IconButton {
        icon: Icon::Flag,
        name: "Stop at frames to check",
        tip: "Pause at the next frame to check; play on to get to the one after it",
        selected: Some(prefs.stops),
        unavailable: None,
    };
    ui.horizontal(|ui| {
        if play.show(ui, false).clicked() {
            actions.push(action);
        }
        prefs.loops ^= repeat.show(ui, false).clicked();
        prefs.stops ^= stop.show(ui, false).clicked();
    });
}

/// Draws every mark with its meaning.
fn legend_ui(ui: &mut Ui, view: &ViewState) {
    ui.set_min_width(300.0);
    let warn = ui.visuals().warn_fg_color;
    ui.strong("Filmstrip");
    for (state, text) in [
        (
            FrameState::Keyframe,
            "keyframe: you gave or confirmed the mask",
        ),
        (
            FrameState::Tracked,
            "tracked: the mask comes from a tracker",
        ),
        (
            FrameState::Stale,
            "stale: made from inputs that changed since",
        ),
        (FrameState::None, "no mask"),
    ] {
        row_ui(ui, text, |ui, at| badge(ui, at, state));
    }
    ui.weak("Bars: labels on the frame");
    ui.strong("Strip above the filmstrip");
    let flag = 100.0 * view.prefs.flag_below;
    for (color, text) in [
        (CONFIRMED, "keyframe".to_owned()),
        (heat(1.0), "the tracker is confident".to_owned()),
        (heat(0.5), format!("uncertain; flagged below {flag:.0} %")),
        (heat(0.0), "very uncertain, or an object is lost".to_owned()),
        (warn, "stale".to_owned()),
    ] {
        row_ui(ui, &text, |ui, at| square(ui, at, color));
    }
    ui.strong("Timeline");
    let (absent, text) = (ui.visuals().error_fg_color, ui.visuals().text_color());
    row_ui(ui, "bright: keyframe with the label", |ui, at| {
        square(ui, at, egui::Color32::from_rgb(90, 160, 240));
    });
    row_ui(ui, "dim: tracked, with the confidence below", |ui, at| {
        square(
            ui,
            at,
            egui::Color32::from_rgb(90, 160, 240).gamma_multiply(0.65),
        );
    });
    for (color, y, meaning) in [
        (absent, 0.0, "line in the middle: marked as absent"),
        (text, -5.0, "line at the top: locked"),
    ] {
        row_ui(ui, meaning, |ui, at| {
            let line = Rect::from_center_size(at + Vec2::new(0.0, y), Vec2::new(12.0, 2.0));
            ui.painter().rect_filled(line, 0.0, color);
        });
    }
}

fn square(ui: &Ui, at: Pos2, color: egui::Color32) {
    let square = Rect::from_center_size(at, Vec2::splat(10.0));
    ui.painter().rect_filled(square, 2.0, color);
}

fn row_ui(ui: &mut Ui, text: &str, paint: impl FnOnce(&Ui, Pos2)) {
    ui.horizontal(|ui| {
        let (rect, _) = ui.allocate_exact_size(Vec2::splat(14.0), Sense::hover());
        paint(ui, rect.center());
        ui.label(text);
    });
}
