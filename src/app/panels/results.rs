use egui::{RichText, Ui};

use crate::Look;
use ostra_project::ResultKind;

/// What the project holds, how it was made, and whether it still fits.
pub(crate) fn results_ui(ui: &mut Ui, look: &Look<'_>) {
    if look.project.results.is_empty() {
        ui.weak("Nothing made yet");
    }
    egui::Grid::new("results")
        .num_columns(3)
        .spacing([10.0, 4.0])
        .show(ui, |ui| {
            for (kind, record) in &look.project.results {
                let name = match kind {
                    ResultKind::Tracking => "Tracking",
                    ResultKind::Cameras => "Cameras",
                    ResultKind::Depths => "Depths",
                    ResultKind::Cloud => "Cloud",
                };
                let tip = format!(
                    "{} frames in {:.1} s\n{}",
                    record.frames, record.seconds, record.settings
                );
                ui.label(name).on_hover_text(&tip);
                ui.weak(&record.engine).on_hover_text(tip);
                if record.stale {
                    let text = RichText::new("stale").color(ui.visuals().warn_fg_color);
                    ui.label(text).on_hover_text(
                        "Made from something that has changed since; make it anew when you like",
                    );
                }
                ui.end_row();
            }
        });
}
