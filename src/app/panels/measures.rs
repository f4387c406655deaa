use egui::{Button, DragValue, Grid, RichText, ScrollArea, Ui};
use ostra_session::JobTask;

use super::label_edit::{ListedLabel, listed};
use super::measure_settings::{add_angle_ui, angles_ui, ground_ui, unit_ui};
use super::measure_table::{COLUMNS, Column, Table};
use super::ruler::scale_note_ui;
use crate::dialogs::PathRequest;
use crate::tooltips::add_explained;
use crate::{Dialog, SessionView, ViewState};
use ostra_cloud::measure::LengthUnit;
use ostra_masks::{Label, LabelTree};

/// Draws the traits per label.
pub(crate) fn measures_ui(ui: &mut Ui, session: &SessionView<'_>, view: &mut ViewState) {
    let Some(cloud) = session.cloud else {
        ui.label("The measures of each label are shown here once there is a cloud: fuse first.");
        return;
    };
    let tree = if session.root.is_some() {
        &session.project.labels
    } else {
        &cloud.tree
    };
    settings_ui(ui, session, view);
    scale_note_ui(ui, session, view);
    angles_ui(ui, session, tree, &mut view.measures.angles);
    ui.separator();
    match session.traits {
        Some(rows) => {
            view.measures.table.follow(rows);
            table_ui(ui, session, view, tree);
        }
        None if session.running(&JobTask::MeasureTraits).is_some() => {
            ui.horizontal(|ui| {
                ui.spinner();
                ui.label("Measuring…");
            });
        }
        None => {
            // The job starts with the next frame of the window.
            ui.ctx().request_repaint_after_secs(0.2);
            ui.label("No label has enough points to measure.");
        }
    }
}

fn settings_ui(ui: &mut Ui, session: &SessionView<'_>, view: &mut ViewState) {
    ui.horizontal_wrapped(|ui| {
        ui.label("Label level");
        let mut level = view.measures.settings.level.unwrap_or(0);
        let drag = DragValue::new(&mut level).range(0..=16).speed(0.05);
        let drag = drag.custom_formatter(|n, _| {
            if n < 1.0 {
                "all".into()
            } else {
                format!("{n:.0}")
            }
        });
        let tip = "Measure labels at this level together with their children; 1 is the top";
        ui.add(drag)
            .on_hover_text(tip)
            .accessible_name("Measured level");
        view.measures.settings.level = (level > 0).then_some(level);
        ui.add_space(8.0);
        ground_ui(ui, session, &view.ruler, &mut view.measures.settings.ground);
        ui.add_space(8.0);
        unit_ui(ui, "Unit", &mut view.measures.unit, session);
        ui.add_space(8.0);
        add_angle_ui(ui, view.label, &mut view.measures.angles);
        let tip = "Save these traits, including those of every part";
        let reason = session
            .traits
            .is_none()
            .then_some("The traits are being measured");
        if add_explained(ui, Button::new("Export CSV…"), tip, reason).clicked() {
            view.clear_path();
            view.dialog = Some(Dialog::Path(PathRequest::SaveTraits));
        }
        let close = ui.button("Close").on_hover_text("Close the traits");
        if close.accessible_name("Close traits").clicked() {
            view.measures.open = false;
        }
    });
}

fn table_ui(ui: &mut Ui, session: &SessionView<'_>, view: &mut ViewState, tree: &LabelTree) {
    let table = std::mem::take(&mut view.measures.table);
    let mut rows = listed(tree);
    rows.retain(|row| table.find(row.label.id, "points").is_some());
    sort(&mut rows, &table, view.measures.sorted);
    ScrollArea::both()
        .auto_shrink([false, false])
        .show(ui, |ui| {
            Grid::new("measures")
                .striped(true)
                .spacing([14.0, 4.0])
                .show(ui, |ui| {
                    header_ui(ui, &mut view.measures.sorted);
                    for ListedLabel { label, depth, .. } in &rows {
                        name_ui(ui, view, label, *depth);
                        let unit = view.measures.unit.unwrap_or(session.unit);
                        for column in COLUMNS {
                            cell_ui(ui, &table, label, column, unit);
                        }
                        ui.end_row();
                    }
                });
        });
    view.measures.table = table;
}

/// Sorts rows by the first value of a column; labels without a value come last.
fn sort(rows: &mut [ListedLabel], table: &Table, sorted: Option<(usize, bool)>) {
    let Some((column, largest_first)) = sorted else {
        return;
    };
    let value = |label: &Label| {
        table
            .cell(label.id, &COLUMNS[column])
            .first()
            .map(|row| row.value)
    };
    rows.sort_by(|a, b| match (value(&a.label), value(&b.label)) {
        (Some(a), Some(b)) if largest_first => b.total_cmp(&a),
        (Some(a), Some(b)) => a.total_cmp(&b),
        (a, b) => b.is_some().cmp(&a.is_some()),
    });
}

fn header_ui(ui: &mut Ui, sorted: &mut Option<(usize, bool)>) {
    let button = ui
        .button(RichText::new("Label").strong())
        .on_hover_text("Sort rows by the label tree");
    if button.accessible_name("Sort by label tree").clicked() {
        *sorted = None;
    }
    for (number, column) in COLUMNS.iter().enumerate() {
        let order = match *sorted {
            Some((at, true)) if at == number => "largest first",
            Some((at, false)) if at == number => "smallest first",
            _ => "click to sort",
        };
        let is_sorted = sorted.is_some_and(|(at, _)| at == number);
        let button = ui.add(Button::selectable(
            is_sorted,
            RichText::new(column.title).strong(),
        ));
        let button = button.on_hover_text(format!("{}; {order}", column.tip));
        if button
            .accessible_name(format!("Sort by {}", column.title))
            .clicked()
        {
            *sorted = Some((number, *sorted != Some((number, true))));
        }
    }
    ui.end_row();
}

fn name_ui(ui: &mut Ui, view: &mut ViewState, label: &Label, depth: usize) {
    ui.horizontal(|ui| {
        ui.add_space(depth as f32 * 12.0);
        let row = ui.selectable_label(view.label == Some(label.id), &label.name);
        if row
            .on_hover_text("Select the label")
            .accessible_name(format!("Measured {}", label.name))
            .clicked()
        {
            view.label = Some(label.id);
        }
    });
}

fn cell_ui(ui: &mut Ui, table: &Table, label: &Label, column: &Column, unit: LengthUnit) {
    let cell = table.cell(label.id, column);
    let Some(first) = cell.first() else {
        ui.weak("–").on_hover_text(column.missing);
        return;
    };
    let text = match cell.len() {
        1 => unit.text(first.value, first.dimension),
        _ => cell
            .iter()
            .map(|row| unit.text(row.value, row.dimension))
            .collect::<Vec<_>>()
            .join(" × "),
    };
    let of = match table.pieces(label.id) {
        pieces if first.instance > 0 && pieces > 1 => {
            format!("\nLargest of {pieces} parts")
        }
        _ => String::new(),
    };
    let tip = format!(
        "{} = {}\nFrom {} points{of}",
        first.name, first.definition, first.points
    );
    ui.label(text).on_hover_text(tip);
}
