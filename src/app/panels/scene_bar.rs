use egui::{ComboBox, Rect, Slider, Ui};

use super::ruler::ruler_ui;
use crate::app::tips::action_button;
use crate::app::{Action, Look, Shown, ViewState};
use crate::view::Coloring;

const COLORINGS: [(Coloring, &str, &str); 3] = [
    (Coloring::Rgb, "Colour", "Points in the colour of the pictures"),
    (Coloring::Label, "Label", "Points in the colour of their label"),
    (Coloring::Confidence, "Confidence", "How large a share of the votes each point's label won"),
];

const MODELS: [(Shown, &str, &str); 4] = [
    (Shown::Points, "Points", "The labelled points"),
    (Shown::Mesh, "Mesh", "The surface, lit from where you look"),
    (Shown::Wireframe, "Wireframe", "The sides of the surface's triangles"),
    (Shown::Voxels, "Voxels", "The cubes that hold points"),
];

/// What is shown, what colours show, point size, frusta and where to look from.
pub(super) fn scene_bar_ui(ui: &mut Ui, look: &Look<'_>, view: &mut ViewState, wishes: &mut Vec<Action>) {
    ui.horizontal_wrapped(|ui| {
        if look.has_surface {
            let text = MODELS.iter().find(|(shown, ..)| *shown == view.shown).map_or("Points", |(_, text, _)| text);
            let choice = ComboBox::from_id_salt("model").selected_text(text).width(88.0).show_ui(ui, |ui| {
                for (shown, text, tip) in MODELS {
                    ui.selectable_value(&mut view.shown, shown, text).on_hover_text(tip);
                }
            });
            choice.response.on_hover_text("What is shown of the result").accessible_name("Shown model");
            ui.add_space(8.0);
        }
        for (coloring, text, tip) in COLORINGS {
            ui.selectable_value(&mut view.coloring, coloring, text).on_hover_text(tip);
        }
        ui.add_space(8.0);
        ui.spacing_mut().slider_width = 70.0;
        let slider = Slider::new(&mut view.prefs.point_size, 1.0..=12.0).show_value(false);
        ui.label("Size");
        ui.add(slider).on_hover_text("Size of the points").accessible_name("Point size");
        let has_cameras = look.project.frames.iter().any(|frame| frame.posed_camera().is_some());
        if has_cameras {
            ui.checkbox(&mut view.prefs.frusta, "Cameras")
                .on_hover_text("Shows the cameras; click one to go to its frame");
        }
        if look.sparse.is_some_and(|sparse| !sparse.links.is_empty()) {
            ui.checkbox(&mut view.prefs.links, "Links").on_hover_text(
                "Which frames hold each other: grey one after the other, green where they see the same, orange by their \
                 shape, red where the others contradict it",
            );
        }
        ui.add_space(8.0);
        let shortcuts = &view.prefs.shortcuts;
        if action_button(ui, shortcuts, Action::FrameCloud, "All", true).clicked() {
            wishes.push(Action::FrameCloud);
        }
        if has_cameras && action_button(ui, shortcuts, Action::LookThrough, "Camera view", true).clicked() {
            wishes.push(Action::LookThrough);
        }
        if has_cameras && look.points().is_some() {
            ui.toggle_value(&mut view.ruler.in_hand, "Ruler")
                .on_hover_text("Click two points to measure their distance, and to set the scale by it");
            ruler_ui(ui, view, wishes);
        }
    });
}

/// What the colours of confidence mean, at the lower left of the view.
pub(super) fn confidence_legend(ui: &Ui, rect: Rect) {
    let bar = Rect::from_min_size(rect.left_bottom() + egui::vec2(12.0, -34.0), egui::vec2(120.0, 8.0));
    let stops = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
    let mut mesh = egui::Mesh::default();
    for (index, [r, g, b]) in stops.into_iter().enumerate() {
        let x = bar.left() + bar.width() * index as f32 / (stops.len() - 1) as f32;
        let color = egui::Color32::from_rgb(r, g, b);
        mesh.colored_vertex(egui::pos2(x, bar.top()), color);
        mesh.colored_vertex(egui::pos2(x, bar.bottom()), color);
        if index > 0 {
            let n = index as u32 * 2;
            mesh.add_triangle(n - 2, n - 1, n);
            mesh.add_triangle(n - 1, n, n + 1);
        }
    }
    ui.painter().add(mesh);
    let font = egui::FontId::proportional(11.0);
    let color = ui.visuals().text_color();
    for (x, align, text) in
        [(bar.left(), egui::Align2::LEFT_TOP, "0 %"), (bar.right(), egui::Align2::RIGHT_TOP, "100 %")]
    {
        ui.painter().text(egui::pos2(x, bar.bottom() + 3.0), align, text, font.clone(), color);
    }
}
