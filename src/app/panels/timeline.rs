use std::ops::Range;

use egui::{Color32, Pos2, Rect, Response, Role, ScrollArea, Sense, Stroke, Ui, Vec2, WidgetInfo};

use super::heat::{Columns, heat, mark};
use super::label_edit::{ListedLabel, listed};
use super::range_bar::range_menu_ui;
use crate::{Action, SessionView, ViewState};
use ostra_masks::{Label, LabelId};
use ostra_project::MaskOrigin;

/// Height of a row in points, with the gap below it.
const ROW: f32 = 24.0;
const GAP: f32 = 1.0;
/// Rows that have a place before labels come, so that the image does not move at the first click.
const RESERVED_ROWS: usize = 2;
/// Share of the window that the rows of a project with many labels get at first.
///
/// These are two rows in a window of 800 points, where the image needs the rest, and three in one of
/// 900 points.
const MAX_SHARE: f32 = 0.085;
const NAMES: f32 = 120.0;
/// Minimum width of a frame. If not all frames fit, those around the shown one are drawn.
const LEAST_WIDTH: f32 = 4.0;

/// Returns the number of rows that a project shows at first without scrolling.
pub(crate) fn timeline_rows(labels: usize, window_height: f32) -> usize {
    let most = (MAX_SHARE * window_height / ROW) as usize;
    labels.clamp(RESERVED_ROWS, most.max(RESERVED_ROWS))
}

/// Returns the height of a number of rows.
pub(crate) fn timeline_height(rows: usize) -> f32 {
    ROW * rows as f32
}

/// Draws the grid of labels and frames with presence, confidence and marks.
///
/// A click goes to label and frame, a drag selects a range. The context menu changes the label over
/// the range.
pub(crate) fn timeline_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    actions: &mut Vec<Action>,
) {
    let rows = listed(&session.project.labels);
    let frames = frames_in_sight(ui, session, view);
    ScrollArea::vertical()
        .id_salt("timeline")
        .min_scrolled_height(0.0)
        .auto_shrink([false, false])
        .show(ui, |ui| {
            ui.spacing_mut().item_spacing.y = GAP;
            for label in rows {
                let row = TimelineRow {
                    label,
                    frames: frames.clone(),
                };
                row_ui(ui, session, view, actions, row);
            }
        });
}

/// Returns the frames that fit next to the names.
///
/// They scroll only if the shown frame would not be visible.
fn frames_in_sight(ui: &Ui, session: &SessionView<'_>, view: &ViewState) -> Range<usize> {
    let count = session.project.frames.len();
    let fit = (((ui.available_width() - NAMES) / LEAST_WIDTH) as usize).clamp(1, count.max(1));
    let id = egui::Id::unique("timeline first");
    let first = ui
        .data(|data| data.get_temp::<usize>(id))
        .unwrap_or(0)
        .min(count.saturating_sub(fit));
    let in_sight = (first..first + fit).contains(&view.frame);
    let first = if in_sight {
        first
    } else {
        view.frame
            .saturating_sub(fit / 2)
            .min(count.saturating_sub(fit))
    };
    ui.data_mut(|data| data.insert_temp(id, first));
    first..(first + fit).min(count)
}

/// Label of a row and the frames that it shows.
struct TimelineRow {
    label: ListedLabel,
    frames: Range<usize>,
}

fn row_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    actions: &mut Vec<Action>,
    row: TimelineRow,
) {
    let TimelineRow { label, frames } = row;
    let ListedLabel { label, depth, .. } = &label;
    let (rect, response) = ui.allocate_exact_size(
        Vec2::new(ui.available_width(), ROW - GAP),
        Sense::click_and_drag(),
    );
    if !ui.is_rect_visible(rect) {
        return;
    }
    let chosen = view.label == Some(label.id);
    response.widget_info(|| {
        WidgetInfo::selected(
            Role::Row,
            true,
            chosen,
            format!("Timeline of {}", label.name),
        )
    });
    let (names, cells) = rect.split_left_right_at_x(rect.left() + NAMES);
    let columns = Columns {
        rect: cells,
        frames,
    };
    name(ui, names, label, *depth, chosen);
    ui.painter()
        .rect_filled(cells, 2.0, ui.visuals().extreme_bg_color);
    cells_of(ui, session, view, label, &columns);
    if let Some((from, to)) = view.range.filter(|_| chosen) {
        let stroke = Stroke::new(1.5, ui.visuals().selection.stroke.color);
        ui.painter().rect_stroke(
            columns.place(from, to),
            2.0,
            stroke,
            egui::StrokeKind::Inside,
        );
    }
    mark(
        ui,
        &columns,
        view.frame,
        ui.visuals().strong_text_color().gamma_multiply(0.6),
    );
    input(ui, &response, view, label.id, &columns);
    response.context_menu(|ui| range_menu_ui(ui, session, view, actions));
    if let Some(frame) = response
        .hover_pos()
        .filter(|at| cells.contains(*at))
        .and_then(|at| columns.frame_at(at))
    {
        response.on_hover_ui_at_pointer(|ui| tip_ui(ui, session, view, label, frame));
    }
}

fn name(ui: &Ui, rect: Rect, label: &Label, depth: usize, chosen: bool) {
    let [r, g, b] = label.color;
    let left = rect.left() + 4.0 + depth as f32 * 10.0;
    let dot = Rect::from_center_size(Pos2::new(left + 4.0, rect.center().y), Vec2::splat(8.0));
    if chosen {
        ui.painter()
            .rect_filled(rect, 2.0, ui.visuals().selection.bg_fill);
    }
    ui.painter()
        .rect_filled(dot, 2.0, Color32::from_rgb(r, g, b));
    let color = if chosen {
        ui.visuals().strong_text_color()
    } else {
        ui.visuals().text_color()
    };
    let font = egui::FontId::proportional(12.0);
    let at = Pos2::new(left + 13.0, rect.center().y);
    ui.painter()
        .with_clip_rect(rect)
        .text(at, egui::Align2::LEFT_CENTER, &label.name, font, color);
}

/// Draws the presence of a label with its confidence, and its absent, locked and hidden ranges.
fn cells_of(
    ui: &Ui,
    session: &SessionView<'_>,
    view: &ViewState,
    label: &Label,
    columns: &Columns,
) {
    let [r, g, b] = label.color;
    let color = Color32::from_rgb(r, g, b);
    let marks = session.project.marks_of(label.id);
    let is_on = |frame: usize| view.frames.presence.on_frame(frame).contains(&label.id);
    let keyframe = |frame: usize| {
        session
            .project
            .masks
            .get(&frame)
            .is_some_and(|mask| mask.origin == MaskOrigin::Keyframe)
    };
    columns.paint(ui, |mut frames| {
        let shown = frames.clone().find(|&frame| is_on(frame))?;
        let dim = if marks.hidden.contains(shown) {
            0.2
        } else {
            0.65
        };
        Some(if frames.any(|frame| is_on(frame) && keyframe(frame)) {
            color
        } else {
            color.gamma_multiply(dim)
        })
    });
    let conflict = |frame: usize| {
        session
            .project
            .masks
            .get(&frame)?
            .confidence
            .get(&label.id)
            .copied()
    };
    strip(columns, 0.72, 1.0).paint(ui, |frames| {
        frames.filter_map(conflict).reduce(f32::min).map(heat)
    });
    let message = |set: &ostra_frames::FrameSet, frames: Range<usize>, color| {
        frames
            .clone()
            .any(|frame| set.contains(frame))
            .then_some(color)
    };
    let text = ui.visuals().text_color();
    strip(columns, 0.46, 0.54).paint(ui, |frames| {
        message(&marks.absent, frames, ui.visuals().error_fg_color)
    });
    strip(columns, 0.0, 0.16).paint(ui, |frames| message(&marks.locked, frames, text));
}

/// Returns the part of columns between two shares of their height.
fn strip(columns: &Columns, from: f32, to: f32) -> Columns {
    let y = |share: f32| columns.rect.top() + share * columns.rect.height();
    Columns {
        rect: Rect::from_x_y_ranges(columns.rect.x_range(), y(from)..=y(to)),
        frames: columns.frames.clone(),
    }
}

/// Handles clicks, which select label and frame, and drags, which select a range.
///
/// With Shift, a click selects the range from the shown frame to the clicked one.
fn input(ui: &Ui, response: &Response, view: &mut ViewState, label: LabelId, columns: &Columns) {
    let pointed = response
        .interact_pointer_pos()
        .filter(|at| at.x >= columns.rect.left());
    let frame = pointed.and_then(|at| columns.frame_at(at));
    if response.clicked() || response.secondary_clicked() || response.drag_started() {
        view.label = Some(label);
    }
    if response.drag_stopped() {
        view.range_from = None;
    }
    let Some(frame) = frame else { return };
    if response.clicked() {
        if ui.input(|input| input.modifiers.shift) {
            view.range = Some((view.frame.min(frame), view.frame.max(frame)));
        } else {
            view.range = None;
            view.go_to(frame);
        }
    }
    if response.drag_started_by(egui::PointerButton::Primary) {
        let moved = response.total_drag_delta().unwrap_or_default();
        view.range_from = pointed.and_then(|at| columns.frame_at(at - moved));
    }
    if response.dragged_by(egui::PointerButton::Primary)
        && let Some(from) = view.range_from
    {
        view.range = Some((from.min(frame), from.max(frame)));
    }
}

fn tip_ui(ui: &mut Ui, session: &SessionView<'_>, view: &ViewState, label: &Label, frame: usize) {
    ui.strong(format!("{}, frame {frame}", label.name));
    let mask = session.project.masks.get(&frame);
    let on = view.frames.presence.on_frame(frame).contains(&label.id);
    let confidence = mask.and_then(|mask| mask.confidence.get(&label.id));
    match (on, mask.map(|mask| mask.origin), confidence) {
        (true, Some(MaskOrigin::Keyframe), _) => ui.label("keyframe"),
        (true, _, Some(confidence)) => ui.label(format!(
            "tracked, tracker confidence {:.0} %",
            confidence * 100.0
        )),
        (true, _, None) => ui.label("tracked"),
        (false, ..) => ui.weak("not on this frame"),
    };
    let marks = session.project.marks_of(label.id);
    for (set, text) in [
        (&marks.absent, "not there"),
        (&marks.locked, "locked"),
        (&marks.hidden, "hidden"),
    ] {
        if set.contains(frame) {
            ui.label(text);
        }
    }
}
