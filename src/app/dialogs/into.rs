use egui::{Key, Ui};

use super::forms::IntoRequest;
use crate::panels::{ListedLabel, listed};
use crate::tooltips::modal;
use crate::{SessionView, ViewState};
use ostra_masks::LabelId;
use ostra_session::{Command, RangeChange, RangeRequest};

/// Asks for the label that receives the pixels of a merge or split.
///
/// Keys 1–9 choose a label as in the label list.
pub(crate) fn into_ui(
    ui: &Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    request: IntoRequest,
    out: &mut Vec<Command>,
) {
    let Some(label) = session.project.labels.get(request.label) else {
        view.dialog = None;
        return;
    };
    let (from, to) = request.range;
    let (verb, get) = match request.piece {
        None => ("Merge", "all of it"),
        Some(_) => ("Split", "the part under the pointer"),
    };
    let frames = if from == to {
        format!("frame {from}")
    } else {
        format!("frames {from} to {to}")
    };
    let mut chosen = None;
    let response = modal(ui, "into", 320.0, |ui| {
        ui.heading(format!("{verb} {}", label.name));
        ui.label(format!("Which label gets {get} on {frames}?"));
        ui.add_space(6.0);
        chosen = choice_ui(ui, session, label.id);
        ui.add_space(6.0);
        ui.button("Cancel")
            .on_hover_text("Change nothing (Esc)")
            .clicked()
    });
    if let Some(into) = chosen {
        let change = match request.piece {
            None => RangeChange::Merge { into },
            Some((frame, at_px)) => RangeChange::Split { frame, at_px, into },
        };
        out.push(Command::Range(RangeRequest {
            labels: vec![label.id],
            from,
            to,
            change,
            replace: false,
        }));
    }
    if chosen.is_some() || response.should_close() || response.inner {
        view.dialog = None;
    }
}

fn choice_ui(ui: &mut Ui, session: &SessionView<'_>, but: LabelId) -> Option<LabelId> {
    let mut chosen = None;
    for row in listed(&session.project.labels) {
        let ListedLabel { label, depth, .. } = row;
        let number = row.number + 1;
        if label.id == but {
            continue;
        }
        ui.horizontal(|ui| {
            ui.add_space(depth as f32 * 14.0);
            let [r, g, b] = label.color;
            let (rect, _) = ui.allocate_exact_size(egui::vec2(12.0, 12.0), egui::Sense::hover());
            ui.painter()
                .rect_filled(rect, 2.0, egui::Color32::from_rgb(r, g, b));
            let key = Key::from_name(&number.to_string()).filter(|_| number < 10);
            let tip = key.map_or("Select the label".into(), |key| {
                format!("Chooses the label ({})", key.name())
            });
            let pressed = key.is_some_and(|key| ui.input(|input| input.key_pressed(key)));
            let button = ui
                .button(&label.name)
                .on_hover_text(tip)
                .accessible_name(format!("Give to {}", label.name));
            if button.clicked() || pressed {
                chosen = Some(label.id);
            }
        });
    }
    chosen
}
