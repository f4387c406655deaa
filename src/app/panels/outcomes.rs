use egui::{Button, Color32, ScrollArea, Ui};

use crate::{Look, ViewState};
use ostra_reconstruct::sfm::Outcome;
use ostra_session::SparseModel;

/// Median error in pixels above which a frame wants to be looked at.
const DOUBTFUL_PX: f64 = 1.0;

/// One row per frame: what it sees and how exactly, or why it has no camera. A click goes to the frame.
pub(super) fn outcomes_ui(
    ui: &mut Ui,
    look: &Look<'_>,
    view: &mut ViewState,
    sparse: &SparseModel,
) {
    let placed = sparse
        .outcomes
        .values()
        .filter(|outcome| outcome.is_placed())
        .count();
    ui.label(format!(
        "{placed} of {} frames have a camera",
        sparse.outcomes.len()
    ));
    ui.separator();
    let rows: Vec<(usize, &Outcome)> = sparse
        .outcomes
        .iter()
        .map(|(&frame, outcome)| (frame, outcome))
        .collect();
    let height = ui.spacing().interact_size.y;
    ScrollArea::vertical()
        .auto_shrink([false, false])
        .show_rows(ui, height, rows.len(), |ui, shown| {
            for &(frame, outcome) in &rows[shown] {
                row_ui(ui, look, view, frame, outcome);
            }
        });
}

fn row_ui(ui: &mut Ui, look: &Look<'_>, view: &mut ViewState, frame: usize, outcome: &Outcome) {
    let name = |frame: usize| {
        look.project
            .frames
            .get(frame)
            .map_or("", |frame| frame.name.as_str())
    };
    let (text, color) = summary(ui, outcome);
    let told = egui::RichText::new(text).color(color);
    let row = Button::selectable(view.frame == frame, format!("{frame}  {}", name(frame)))
        .right_text(told);
    let row = ui.add_sized([ui.available_width(), ui.spacing().interact_size.y], row);
    if row
        .on_hover_text(format!("{}: {}", name(frame), outcome.text(name)))
        .clicked()
    {
        view.go_to(frame);
    }
}

/// What a row tells at its end; coloured only where it wants to be looked at.
fn summary(ui: &Ui, outcome: &Outcome) -> (String, Color32) {
    let visuals = ui.visuals();
    match outcome {
        Outcome::Placed { points, error_px } => {
            let color = if *error_px > DOUBTFUL_PX {
                visuals.warn_fg_color
            } else {
                visuals.weak_text_color()
            };
            (format!("{points} points  {error_px:.2} px"), color)
        }
        Outcome::Registered {
            neighbours,
            consistent,
        } => (
            format!("{neighbours} frames  {:.0} %", 100.0 * consistent),
            visuals.weak_text_color(),
        ),
        _ => ("no camera".into(), visuals.error_fg_color),
    }
}
