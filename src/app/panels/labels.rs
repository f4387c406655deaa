use egui::{Color32, Key, Response, RichText, Role, Sense, TextEdit, Ui, WidgetInfo};

use super::label_edit::{
    ListedLabel, drag_ui, label_menu_ui, listed, new_label_ui, rename_ui, top_level_ui,
};
use crate::tooltips::{grouped, icon_button, section_heading};
use crate::{SessionView, ViewState};
use ostra_masks::{Label, LabelId};
use ostra_session::Command;

/// Number of labels above which the list has a field to find one.
const FILTER_FROM: usize = 8;
/// Width of the button that clears this field.
const CLEAR_WIDTH: f32 = 22.0;

/// Draws the label tree: select, show and hide, rename, recolour, move, add and remove.
pub(crate) fn labels_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
) {
    ui.horizontal(|ui| {
        section_heading(ui, "Labels");
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            show_all_ui(ui, session, view);
        });
    });
    let rows = listed(&session.project.labels);
    if rows.len() > FILTER_FROM {
        filter_ui(ui, view, &rows);
    } else {
        view.labels.filter.clear();
    }
    // The field for a new label stays in sight however many labels there are.
    egui::Panel::bottom("new label")
        .resizable(false)
        .frame(egui::Frame::new().inner_margin(egui::Margin::symmetric(0, 4)))
        .show_separator_line(false)
        .show(ui, |ui| new_label_ui(ui, session, view, out));
    egui::ScrollArea::vertical()
        .id_salt("labels")
        .auto_shrink([false, false])
        .show(ui, |ui| {
            if rows.is_empty() {
                ui.weak("No labels yet. Click on an object in the image.");
            }
            let shown = rows.iter().filter(|row| is_listed(session, view, row));
            let shown: Vec<_> = shown.collect();
            if shown.is_empty() && !rows.is_empty() {
                ui.weak("No label has this text in its name");
            }
            for row in shown {
                label_row_ui(ui, session, view, out, row);
            }
            view.labels.reveal = false;
            top_level_ui(ui, session, out);
        });
}

/// Draws the field that limits the list to labels with a text in their name.
fn filter_ui(ui: &mut Ui, view: &mut ViewState, rows: &[ListedLabel]) {
    ui.horizontal(|ui| {
        let width = ui.available_width() - CLEAR_WIDTH;
        let edit = TextEdit::singleline(&mut view.labels.filter)
            .hint_text("Find label")
            .desired_width(width);
        let tip = "List only labels with this text in their name; Enter selects the first";
        let edit = ui
            .add(edit)
            .on_hover_text(tip)
            .accessible_name("Find label");
        if edit.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter)) {
            let has_text = |row: &&ListedLabel| contains(&row.label.name, &view.labels.filter);
            let found = rows.iter().find(has_text).map(|row| row.label.id);
            view.label = found.or(view.label);
        }
        if !view.labels.filter.is_empty()
            && icon_button(ui, "×", "Show all names", "List all labels").clicked()
        {
            view.labels.filter.clear();
        }
    });
}

fn contains(name: &str, text: &str) -> bool {
    name.to_lowercase().contains(&text.trim().to_lowercase())
}

/// Returns `true` if the label or one of its descendants has the text of the filter in its name.
fn is_listed(session: &SessionView<'_>, view: &ViewState, row: &ListedLabel) -> bool {
    let (tree, filter) = (&session.project.labels, &view.labels.filter);
    let has_text = |label: &Label| contains(&label.name, filter);
    has_text(&row.label)
        || tree
            .descendants(row.label.id)
            .iter()
            .any(|&id| tree.get(id).is_some_and(has_text))
}

/// Adds a label with an unused name, selects it and starts renaming it.
pub(crate) fn add_label(session: &SessionView<'_>, view: &mut ViewState, out: &mut Vec<Command>) {
    let tree = &session.project.labels;
    let id = tree.next_id();
    let name = (id.0..)
        .map(|n| format!("object {n}"))
        .find(|name| tree.by_name(name).is_none());
    let Some(name) = name else { return };
    out.push(Command::AddLabel {
        name: name.clone(),
        parent: None,
        color: None,
    });
    view.label = Some(id);
    view.labels.rename(id, &name);
}

fn show_all_ui(ui: &mut Ui, session: &SessionView<'_>, view: &mut ViewState) {
    if session.project.labels.iter().next().is_none() {
        return;
    }
    let all_hidden = !view.hidden.is_empty();
    let (text, tip) = if all_hidden {
        ("Show all", "Show all labels")
    } else {
        ("Hide all", "Hide all labels")
    };
    if ui
        .add(egui::Button::new(RichText::new(text).weak().size(11.0)).frame(false))
        .on_hover_text(tip)
        .clicked()
    {
        view.hidden = if all_hidden {
            Default::default()
        } else {
            session
                .project
                .labels
                .iter()
                .map(|label| label.id)
                .collect()
        };
    }
}

fn label_row_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
    row: &ListedLabel,
) {
    let label = &row.label;
    ui.push_id(label.id, |ui| {
        ui.horizontal(|ui| {
            ui.add_space(row.depth as f32 * 14.0);
            color_ui(ui, label, out);
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                row_end_ui(ui, session, view, out, label);
                ui.with_layout(egui::Layout::left_to_right(egui::Align::Center), |ui| {
                    if !rename_ui(ui, view, out, label) {
                        name_ui(ui, session, view, out, row);
                    }
                });
            });
        });
    });
}

fn color_ui(ui: &mut Ui, label: &Label, out: &mut Vec<Command>) {
    let mut color = label.color;
    ui.spacing_mut().interact_size = egui::vec2(16.0, 16.0);
    let response = ui
        .color_edit_button_srgb(&mut color)
        .on_hover_text("Change the colour");
    if response
        .accessible_name(format!("Colour of {}", label.name))
        .changed()
    {
        out.push(Command::EditLabel(Label {
            color,
            ..label.clone()
        }));
    }
}

fn name_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
    row: &ListedLabel,
) {
    let &ListedLabel {
        ref label, number, ..
    } = row;
    let key = if number < 9 {
        format!("{}  ", number + 1)
    } else {
        String::new()
    };
    let is_selected = view.label == Some(label.id);
    let (response, is_cut) = selectable_row(ui, is_selected, &key, &label.name);
    if is_selected && view.labels.reveal {
        response.scroll_to_me(None);
    }
    let tip = if number < 9 {
        format!(
            "Select the label ({}); double-click renames, drag moves, Alt+click isolates, right click for more",
            number + 1
        )
    } else {
        "Select the label; double-click renames, drag moves, Alt+click isolates, right click for more".into()
    };
    let tip = if is_cut {
        format!("{}\n{tip}", label.name)
    } else {
        tip
    };
    let response = response.on_hover_text(tip);
    if response.clicked() && ui.input(|i| i.modifiers.alt) {
        view.scene.isolate(label.id);
    } else if response.clicked() {
        view.label = Some(label.id);
    }
    if response.double_clicked() {
        view.labels.rename(label.id, &label.name);
    }
    drag_ui(ui, session, out, &response, label);
    response.context_menu(|ui| label_menu_ui(ui, session, view, out, label));
}

/// Draws a row of the available width, with its shortcut in a weak colour before the name.
///
/// Also returns whether the name is cut off.
fn selectable_row(ui: &mut Ui, selected: bool, key: &str, name: &str) -> (Response, bool) {
    let (rect, response) = ui.allocate_exact_size(
        egui::vec2(ui.available_width(), 20.0),
        Sense::click_and_drag(),
    );
    response.widget_info(|| WidgetInfo::selected(Role::Button, true, selected, name));
    let visuals = ui.style().interact_selectable(&response, selected);
    if selected || response.hovered() || response.has_focus() {
        ui.painter().rect_filled(rect, 3.0, visuals.weak_bg_fill);
    }
    let font = egui::TextStyle::Body.resolve(ui.style());
    let painter = ui
        .painter()
        .with_clip_rect(rect.shrink2(egui::vec2(4.0, 0.0)));
    let weak = ui.visuals().weak_text_color();
    let at = rect.left_center() + egui::vec2(5.0, 0.0);
    let end = painter.text(at, egui::Align2::LEFT_CENTER, key, font.clone(), weak);
    let left = end.right().max(at.x);
    let color = visuals.text_color();
    let mut job = egui::text::LayoutJob::simple_singleline(name.to_owned(), font, color);
    job.wrap = egui::text::TextWrapping::truncate_at_width(rect.right() - 2.0 - left);
    let galley = painter.layout_job(job);
    let is_cut = galley.elided;
    painter.galley(
        egui::pos2(left, rect.center().y - galley.size().y / 2.0),
        galley,
        color,
    );
    (response, is_cut)
}

fn row_end_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
    label: &Label,
) {
    let more = ui
        .menu_button("…", |ui| label_menu_ui(ui, session, view, out, label))
        .response;
    more.on_hover_text("Rename, move, remove")
        .accessible_name(format!("More for {}", label.name));
    eye_ui(ui, view, label);
    let frames = view.frames.presence.frames_with(label.id);
    let (mut text, mut tip) = (
        frames.to_string(),
        format!("'{}' is on {frames} frames", label.name),
    );
    if let Some(cloud) = session.cloud {
        let points = view
            .point_counts
            .below(cloud, &session.project.labels, label.id);
        text = format!("{} · {text}", rounded(points));
        tip += &format!("; {} points, including child labels", grouped(points));
    }
    ui.add_space(4.0);
    ui.label(RichText::new(text).weak().size(11.0))
        .on_hover_text(tip);
}

/// Formats a number of points in about three digits.
fn rounded(points: usize) -> String {
    match points {
        0..1_000 => points.to_string(),
        1_000..1_000_000 => format!("{}k", points / 1_000),
        _ => format!("{:.1}M", points as f64 / 1e6),
    }
}

fn eye_ui(ui: &mut Ui, view: &mut ViewState, label: &Label) {
    let shown = !view.hidden.contains(&label.id);
    let name = format!("{} {}", if shown { "Hide" } else { "Show" }, label.name);
    let response = icon_button(
        ui,
        " ",
        &name,
        "Show or hide the label in the image and in 3-D",
    );
    eye_icon(ui, &response, shown);
    if response.clicked() {
        if shown {
            view.hidden.insert(label.id);
        } else {
            view.hidden.remove(&label.id);
        }
    }
}

/// Draws an eye: open, or closed as a line.
fn eye_icon(ui: &Ui, response: &Response, open: bool) {
    let at = response.rect.center();
    let visuals = ui.style().interact(response);
    let color = if open {
        visuals.text_color()
    } else {
        ui.visuals().weak_text_color()
    };
    let stroke = egui::Stroke::new(1.2, color);
    let lid = |sign: f32| {
        let points = (-6..=6).map(|k| {
            let x = k as f32;
            at + egui::vec2(x, sign * 3.6 * (1.0 - (x / 6.0).powi(2)))
        });
        egui::Shape::line(points.collect(), stroke)
    };
    ui.painter().add(lid(1.0));
    if open {
        ui.painter().add(lid(-1.0));
        ui.painter()
            .circle(at, 1.8, color, egui::Stroke::new(0.0, Color32::TRANSPARENT));
    }
}

/// Draws the labels of a PLY viewed on its own, with visibility and number of points.
pub(crate) fn cloud_labels_ui(ui: &mut Ui, session: &SessionView<'_>, view: &mut ViewState) {
    section_heading(ui, "Labels");
    let Some(cloud) = session.cloud else { return };
    let counts = view.point_counts.of(cloud).clone();
    let rows = listed(&cloud.tree);
    if rows.is_empty() {
        ui.weak("This file has no label names");
    }
    egui::ScrollArea::vertical()
        .auto_shrink([false, false])
        .show(ui, |ui| {
            for ListedLabel { label, depth, .. } in &rows {
                ui.horizontal(|ui| {
                    ui.add_space(*depth as f32 * 14.0);
                    let (rect, _) =
                        ui.allocate_exact_size(egui::vec2(12.0, 12.0), egui::Sense::hover());
                    let [r, g, b] = label.color;
                    ui.painter()
                        .rect_filled(rect, 3.0, egui::Color32::from_rgb(r, g, b));
                    ui.add(egui::Label::new(&label.name).truncate());
                    ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                        eye_ui(ui, view, label);
                        let points = counts.get(&label.id).copied().unwrap_or(0);
                        ui.label(RichText::new(grouped(points)).weak().size(11.0))
                            .on_hover_text("Points with this label");
                    });
                });
            }
            let unlabelled = counts.get(&LabelId::NONE).copied().unwrap_or(0);
            ui.weak(format!("{} points without a label", grouped(unlabelled)));
        });
}
