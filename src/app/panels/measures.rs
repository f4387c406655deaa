use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::Arc;

use egui::{Button, ComboBox, DragValue, Grid, RichText, ScrollArea, Ui};

use super::angles::{AngleChoice, add_angle_ui, angles_ui};
use super::labels::listed;
use super::measure_columns::{COLUMNS, Column};
use super::ruler::Ruler;
use super::scene_bar::labels_of;
use crate::view_state::PathWish;
use crate::{Dialog, Look, ViewState};
use ostra_cloud::measure::{GroundChoice, LengthUnit, TraitRow};
use ostra_masks::{Label, LabelId, LabelTree};
use ostra_session::MeasureWish;
use ostra_view::Axes;

/// What the window of measures shows.
#[derive(Debug, Clone, Default)]
pub struct MeasureView {
    /// Whether it is open.
    pub open: bool,
    /// What is measured.
    pub wish: MeasureWish,
    /// The unit chosen; none = that of the scene.
    pub unit: Option<LengthUnit>,
    /// Pairs of labels whose angle is told, as far as they are chosen.
    pub(super) angles: Vec<AngleChoice>,
    /// Column that rows are sorted by, largest first when the second is set; none = order of the tree.
    sorted: Option<(usize, bool)>,
    table: Table,
}

impl MeasureView {
    /// Drops a metric unit where lengths have none.
    pub fn keep_valid(&mut self, look: &Look<'_>) {
        self.unit = self.unit.filter(|_| look.may_be_metric());
    }

    /// Follows a scene whose lengths were multiplied.
    pub fn scale_by(&mut self, factor: f64) {
        if let GroundChoice::Plane { offset, .. } = &mut self.wish.ground {
            *offset *= factor;
        }
    }

    /// The two labels of each angle that is told.
    pub fn pairs(&self) -> impl Iterator<Item = [LabelId; 2]> {
        self.angles.iter().filter_map(AngleChoice::pair)
    }
}

/// Which row of the traits tells what of which label, found once for each measurement.
#[derive(Debug, Clone, Default)]
struct Table {
    rows: Option<Arc<Vec<TraitRow>>>,
    places: BTreeMap<(LabelId, Cow<'static, str>), usize>,
}

impl Table {
    /// The trait of the label as a whole, else of its largest piece.
    fn follow(&mut self, rows: &Arc<Vec<TraitRow>>) {
        if self
            .rows
            .as_ref()
            .is_some_and(|known| Arc::ptr_eq(known, rows))
        {
            return;
        }
        self.places.clear();
        for (place, row) in rows.iter().enumerate().filter(|(_, row)| row.instance <= 1) {
            self.places
                .entry((row.id, row.name.clone()))
                .or_insert(place);
        }
        self.rows = Some(Arc::clone(rows));
    }

    fn find(&self, id: LabelId, name: &'static str) -> Option<&TraitRow> {
        self.rows
            .as_ref()?
            .get(*self.places.get(&(id, Cow::Borrowed(name)))?)
    }

    /// What a column tells of a label.
    fn cell(&self, id: LabelId, column: &Column) -> Vec<&TraitRow> {
        let found = column.traits.iter().filter_map(|name| self.find(id, name));
        found
            .take(if column.joined {
                column.traits.len()
            } else {
                1
            })
            .collect()
    }

    fn pieces(&self, id: LabelId) -> usize {
        self.find(id, "instances")
            .map_or(0, |row| row.value as usize)
    }
}

/// A window with what was measured of each label.
pub(crate) fn measures_ui(ui: &Ui, look: &Look<'_>, view: &mut ViewState) {
    let mut open = view.measures.open;
    let window = egui::Window::new("Measures")
        .open(&mut open)
        .default_size([900.0, 360.0])
        .resizable(true);
    window
        .default_pos(ui.ctx().content_rect().left_top() + egui::vec2(250.0, 60.0))
        .show(ui.ctx(), |ui| {
            let Some(cloud) = look.cloud else {
                ui.label(
                    "The measures of each label are shown here once there is a cloud: fuse first.",
                );
                return;
            };
            let tree = if look.root.is_some() {
                &look.project.labels
            } else {
                &cloud.tree
            };
            settings_ui(ui, look, view);
            angles_ui(ui, look, tree, &mut view.measures.angles);
            ui.separator();
            match look.traits {
                Some(rows) => {
                    view.measures.table.follow(rows);
                    table_ui(ui, look, view, tree);
                }
                None if look.running("Measure").is_some() => {
                    ui.horizontal(|ui| {
                        ui.spinner();
                        ui.label("Measuring…");
                    });
                }
                None => {
                    // The job begins with the next picture of the window.
                    ui.ctx().request_repaint_after_secs(0.2);
                    ui.label("Nothing could be measured.");
                }
            }
        });
    view.measures.open = open;
}

fn settings_ui(ui: &mut Ui, look: &Look<'_>, view: &mut ViewState) {
    ui.horizontal_wrapped(|ui| {
        ui.label("Label level");
        let mut level = view.measures.wish.level.unwrap_or(0);
        let drag = DragValue::new(&mut level).range(0..=16).speed(0.05);
        let drag = drag.custom_formatter(|n, _| {
            if n < 1.0 {
                "all".into()
            } else {
                format!("{n:.0}")
            }
        });
        let tip = "Measures only labels at this depth, with all below them; 1 = top";
        ui.add(drag)
            .on_hover_text(tip)
            .accessible_name("Measured level");
        view.measures.wish.level = (level > 0).then_some(level);
        ui.add_space(8.0);
        ground_ui(ui, look, &view.ruler, &mut view.measures.wish.ground);
        ui.add_space(8.0);
        unit_ui(ui, "Unit", &mut view.measures.unit, look);
        ui.add_space(8.0);
        add_angle_ui(ui, view.label, &mut view.measures.angles);
        let button = ui.add_enabled(look.traits.is_some(), Button::new("Export CSV…"));
        if button
            .on_hover_text("Writes these measures, those of every piece too")
            .clicked()
        {
            view.path_text.clear();
            view.dialog = Some(Dialog::Path(PathWish::SaveTraits));
        }
    });
}

/// The plane above which heights are measured.
pub(crate) fn ground_ui(ui: &mut Ui, look: &Look<'_>, ruler: &Ruler, ground: &mut GroundChoice) {
    let tree = labels_of(look);
    let name = |id| tree.get(id).map_or("fitted", |label| label.name.as_str());
    let text = match *ground {
        GroundChoice::Fitted => "fitted",
        GroundChoice::Label(id) => name(id),
        GroundChoice::Plane { .. } => "given",
    };
    ui.label("Heights above");
    let choice = ComboBox::from_id_salt("ground")
        .selected_text(text)
        .width(110.0)
        .show_ui(ui, |ui| {
            ui.selectable_value(ground, GroundChoice::Fitted, "fitted");
            for label in tree.iter() {
                ui.selectable_value(ground, GroundChoice::Label(label.id), &label.name);
            }
            ui.separator();
            let through = ruler.plane(Axes::of_cameras(&look.project.frames).up);
            let is_through = through.is_some_and(|plane| plane == *ground);
            let button = ui.add_enabled(
                through.is_some(),
                Button::selectable(is_through, "through the ruler's points"),
            );
            if button
                .on_disabled_hover_text("Set three points with the ruler first")
                .clicked()
            {
                *ground = through.unwrap_or(*ground);
            }
            let is_given = matches!(ground, GroundChoice::Plane { .. });
            if ui.selectable_label(is_given, "given by numbers").clicked() && !is_given {
                *ground = GroundChoice::Plane {
                    normal: [0.0, 0.0, 1.0],
                    offset: 0.0,
                };
            }
        });
    let tip = "The plane that labelled points stand on, fitted to points without a label, or to a label: a table, the soil";
    choice.response.on_hover_text(tip).accessible_name("Ground");
    if let GroundChoice::Plane { normal, offset } = ground {
        plane_ui(ui, normal, offset);
    }
}

/// All x with normal · x = offset.
fn plane_ui(ui: &mut Ui, normal: &mut [f64; 3], offset: &mut f64) {
    let names = ["Normal x", "Normal y", "Normal z"];
    let before = *normal;
    for (number, name) in normal.iter_mut().zip(names) {
        let tip = "Which way is up, in world axes; of any length";
        ui.add(DragValue::new(number).speed(0.01).max_decimals(4))
            .on_hover_text(tip)
            .accessible_name(name);
    }
    if *normal == [0.0; 3] {
        *normal = before;
    }
    let tip = "Of the points x on the plane: normal · x, in world units";
    ui.add(
        DragValue::new(offset)
            .speed(0.001)
            .max_decimals(5)
            .prefix("= "),
    )
    .on_hover_text(tip)
    .accessible_name("Offset");
}

/// The unit that lengths are shown in; `None` = the scene's own. Metric units are offered where the scale is known.
pub(crate) fn unit_ui(ui: &mut Ui, name: &str, chosen: &mut Option<LengthUnit>, look: &Look<'_>) {
    let of_scene = look.unit;
    let mut unit = chosen.unwrap_or(of_scene);
    let metric = if look.may_be_metric() {
        &LengthUnit::METRIC[..]
    } else {
        &[]
    };
    let choice = ComboBox::from_id_salt("unit")
        .selected_text(unit.sign())
        .width(60.0)
        .show_ui(ui, |ui| {
            for other in metric.iter().copied().chain([LengthUnit::World]) {
                ui.selectable_value(&mut unit, other, other.sign());
            }
        });
    let tip = match look.may_be_metric() {
        true => "The unit of lengths; 'units' are the scene's own",
        false => {
            "The scale of this scene is not known: measure a known length with the ruler and set the scale"
        }
    };
    choice.response.on_hover_text(tip).accessible_name(name);
    *chosen = (unit != of_scene).then_some(unit);
}

fn table_ui(ui: &mut Ui, look: &Look<'_>, view: &mut ViewState, tree: &LabelTree) {
    let table = std::mem::take(&mut view.measures.table);
    let mut rows: Vec<(Label, usize)> = listed(tree);
    rows.retain(|(label, _)| table.find(label.id, "points").is_some());
    sort(&mut rows, &table, view.measures.sorted);
    ScrollArea::both()
        .auto_shrink([false, false])
        .show(ui, |ui| {
            Grid::new("measures")
                .striped(true)
                .spacing([14.0, 4.0])
                .show(ui, |ui| {
                    header_ui(ui, &mut view.measures.sorted);
                    for (label, depth) in &rows {
                        name_ui(ui, view, label, *depth);
                        let unit = view.measures.unit.unwrap_or(look.unit);
                        for column in &COLUMNS {
                            cell_ui(ui, &table, label, column, unit);
                        }
                        ui.end_row();
                    }
                });
        });
    view.measures.table = table;
}

/// By the first value of a column; labels without one come last.
fn sort(rows: &mut [(Label, usize)], table: &Table, sorted: Option<(usize, bool)>) {
    let Some((column, largest_first)) = sorted else {
        return;
    };
    let value = |label: &Label| {
        table
            .cell(label.id, &COLUMNS[column])
            .first()
            .map(|row| row.value)
    };
    rows.sort_by(|(a, _), (b, _)| match (value(a), value(b)) {
        (Some(a), Some(b)) if largest_first => b.total_cmp(&a),
        (Some(a), Some(b)) => a.total_cmp(&b),
        (a, b) => b.is_some().cmp(&a.is_some()),
    });
}

fn header_ui(ui: &mut Ui, sorted: &mut Option<(usize, bool)>) {
    let button = ui
        .button(RichText::new("Label").strong())
        .on_hover_text("Rows in the order of the tree");
    if button.accessible_name("Order of the tree").clicked() {
        *sorted = None;
    }
    for (number, column) in COLUMNS.iter().enumerate() {
        let order = match *sorted {
            Some((at, true)) if at == number => "the largest first",
            Some((at, false)) if at == number => "the smallest first",
            _ => "click to sort by it",
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
            .on_hover_text("Chooses the label")
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
        ui.weak("–").on_hover_text("Cannot be told of this label");
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
            format!("\nOf the largest of {pieces} pieces")
        }
        _ => String::new(),
    };
    let tip = format!(
        "{} = {}\nFrom {} points{of}",
        first.name, first.definition, first.points
    );
    ui.label(text).on_hover_text(tip);
}
