use egui::{DragValue, RichText, Ui};

use super::fuse::grouped;
use crate::tips::{field, section_heading};
use crate::{Look, ViewState};
use ostra_session::Command;

/// Instances of a label as they would be made: shown in 3-D, changed by two numbers, then made or given up.
pub(crate) fn instances_ui(
    ui: &mut Ui,
    look: &Look<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
) {
    let Some(request) = &mut view.instances else {
        return;
    };
    let Some(label) = look.project.labels.get(request.label) else {
        view.instances = None;
        return;
    };
    ui.separator();
    section_heading(ui, &format!("Instances of {}", label.name));
    egui::Grid::new("instances")
        .num_columns(2)
        .spacing([8.0, 6.0])
        .show(ui, |ui| {
            let options = &mut request.options;
            let tip = "Points at most this many spacings of the cloud apart hang together";
            field(ui, "Reach", tip, |ui| {
                ui.add(
                    DragValue::new(&mut options.radius)
                        .range(1.5..=20.0)
                        .speed(0.05),
                )
                .on_hover_text(tip);
            });
            let tip = "Groups of fewer points are no instance";
            field(ui, "Least points", tip, |ui| {
                ui.add(DragValue::new(&mut options.min_points).range(1..=1_000_000))
                    .on_hover_text(tip);
            });
        });
    let found = look.proposed.map_or(0, |proposed| proposed.labels.len());
    match look.proposed {
        None => ui.spinner(),
        Some(_) if found == 0 => ui.weak("No points of this label hang together."),
        Some(_) => ui.weak(format!("{found} found, shown in 3-D")),
    };
    for (label, points) in look.proposed.iter().flat_map(|proposed| &proposed.labels) {
        ui.horizontal(|ui| {
            let (rect, _) = ui.allocate_exact_size(egui::vec2(12.0, 12.0), egui::Sense::hover());
            let [r, g, b] = label.color;
            ui.painter()
                .rect_filled(rect, 3.0, egui::Color32::from_rgb(r, g, b));
            ui.label(&label.name);
            ui.label(RichText::new(grouped(*points)).weak().size(11.0))
                .on_hover_text("Points of this instance");
        });
    }
    let request = *request;
    ui.horizontal(|ui| {
        let accept = ui.add_enabled(found > 0, egui::Button::new("Make instances"));
        let tip = "Makes a label of each, in the cloud and in every mask (can be undone)";
        if accept.on_hover_text(tip).clicked() {
            out.push(Command::Instances(request));
            view.instances = None;
        }
        if ui
            .button("Give up")
            .on_hover_text("Leaves the label as it is")
            .clicked()
        {
            view.instances = None;
        }
    });
}
