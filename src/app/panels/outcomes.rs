use egui::{Color32, ScrollArea, Ui};

use super::matches::error_color;
use crate::app::{Look, ViewState};
use crate::scene::sfm::Outcome;
use crate::session::SparseModel;

/// One row per frame: what it sees and how exactly, or why it has no camera. A click goes to the frame.
pub(super) fn outcomes_ui(ui: &mut Ui, look: &Look<'_>, view: &mut ViewState, sparse: &SparseModel) {
    let placed = sparse.outcomes.values().filter(|outcome| matches!(outcome, Outcome::Placed { .. })).count();
    ui.label(format!("{placed} of {} frames have a camera", sparse.outcomes.len()));
    ui.separator();
    let rows: Vec<(usize, &Outcome)> = sparse.outcomes.iter().map(|(&frame, outcome)| (frame, outcome)).collect();
    let height = ui.spacing().interact_size.y;
    ScrollArea::vertical().auto_shrink([false, false]).show_rows(ui, height, rows.len(), |ui, shown| {
        for &(frame, outcome) in &rows[shown] {
            row_ui(ui, look, view, frame, outcome);
        }
    });
}

fn row_ui(ui: &mut Ui, look: &Look<'_>, view: &mut ViewState, frame: usize, outcome: &Outcome) {
    let name = look.project.frames.get(frame).map_or("", |frame| frame.name.as_str());
    ui.horizontal(|ui| {
        let row = ui.selectable_label(view.frame == frame, format!("{frame}  {name}"));
        if row.on_hover_text(format!("{name}: {outcome}")).clicked() {
            view.go_to(frame);
        }
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            let (text, color) = summary(ui, outcome);
            ui.colored_label(color, text).on_hover_text(outcome.to_string());
        });
    });
}

fn summary(ui: &Ui, outcome: &Outcome) -> (String, Color32) {
    match outcome {
        Outcome::Placed { points, error_px } => (format!("{points} points  {error_px:.2} px"), error_color(*error_px)),
        _ => ("no camera".into(), ui.visuals().error_fg_color),
    }
}
