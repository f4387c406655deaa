use egui::{Color32, Painter, Pos2, Rect, Shape, Stroke as Line, TextureId, Vec2};

use super::draft::{Draft, HeldBorder, Stroke, Tool};
use super::map::CanvasMap;
use crate::panels::{is_explained, offered};
use crate::{SessionView, ViewState};
use ostra_masks::{LabelId, Prompt};
use ostra_session::{FoundThing, Suggestion};

const UV: Rect = Rect {
    min: Pos2::ZERO,
    max: Pos2::new(1.0, 1.0),
};

/// Draws an image or mask texture over the image's rectangle.
pub(super) fn texture(painter: &Painter, map: &CanvasMap, id: TextureId) {
    painter.image(id, map.image_rect(), UV, Color32::WHITE);
}

/// Draws the prompts of all labels and the drawing in progress.
///
/// Marks of the selected label are larger.
pub(super) fn prompts_and_draft(
    painter: &Painter,
    map: &CanvasMap,
    session: &SessionView<'_>,
    view: &ViewState,
    pointer: Option<Pos2>,
) {
    for label in session
        .project
        .labels
        .iter()
        .filter(|label| !view.hidden.contains(&label.id))
        .filter(|label| {
            let path = session.project.labels.path(label.id);
            view.shown_label().is_none_or(|only| path.contains(&only))
        })
    {
        let prompt = view.draft.prompt(session.project, view.frame, label.id);
        prompt_marks(
            painter,
            map,
            &prompt,
            color_of(session, label.id),
            view.label == Some(label.id),
        );
    }
    for (number, thing) in offered(session, view) {
        found_box(painter, map, number, thing);
    }
    for (number, found) in (1..)
        .zip(session.suggestions)
        .filter(|(_, found)| found.frame == view.frame)
    {
        if !is_explained(session, found) {
            suggestion(painter, map, number, found);
        }
    }
    let color = view
        .label
        .map_or(Color32::WHITE, |label| color_of(session, label));
    for stroke in view.draft.strokes(view.frame) {
        brush_stroke(
            painter,
            map,
            stroke,
            color_of(session, stroke.label),
            view.prefs.opacity,
        );
    }
    if let (Some(from), Some(to)) = (view.draft.box_from, pointer) {
        outlined_rect(painter, Rect::from_two_pos(map.to_screen(from), to), color);
    }
    if let (Some(held), Some(to)) = (&view.draft.held, pointer) {
        held_border(painter, map, held, to, color);
    }
    corners(painter, map, &view.draft, pointer, color);
}

/// Draws the box of an object found by text, with its number.
fn found_box(painter: &Painter, map: &CanvasMap, number: usize, thing: &FoundThing) {
    let rect = Rect::from_two_pos(
        map.to_screen(thing.extent.min_px),
        map.to_screen(thing.extent.max_px),
    );
    let color = Color32::from_rgb(255, 235, 90);
    outlined_rect(painter, rect, color);
    let text = format!("{number}  {} {:.0} %", thing.phrase, 100.0 * thing.score);
    let at = rect.left_top() + Vec2::splat(4.0);
    painter.text(
        at,
        egui::Align2::LEFT_TOP,
        text,
        egui::FontId::proportional(13.0),
        color,
    );
}

/// Draws the outline of a suggested object, with its number in the list.
fn suggestion(painter: &Painter, map: &CanvasMap, number: usize, found: &Suggestion) {
    for ring in found.rings_px.iter() {
        let points: Vec<Pos2> = ring.iter().map(|&corner| map.to_screen(corner)).collect();
        for (width, color) in [(3.0, Color32::from_black_alpha(140)), (1.5, Color32::WHITE)] {
            painter.add(Shape::closed_line(points.clone(), Line::new(width, color)));
        }
    }
    let font = egui::FontId::proportional(13.0);
    let at = map.to_screen(found.at_px);
    painter.text(
        at + Vec2::splat(1.0),
        egui::Align2::CENTER_CENTER,
        number.to_string(),
        font.clone(),
        Color32::BLACK,
    );
    painter.text(
        at,
        egui::Align2::CENTER_CENTER,
        number.to_string(),
        font,
        Color32::WHITE,
    );
}

/// Draws a line of text at the upper edge of the pane.
pub(super) fn banner(painter: &Painter, map: &CanvasMap, text: &str) {
    let font = egui::FontId::proportional(13.0);
    let galley = painter.layout_no_wrap(text.into(), font, Color32::WHITE);
    let at = map.pane.center_top() + Vec2::new(-galley.size().x / 2.0, 10.0);
    let back = Rect::from_min_size(at, galley.size()).expand2(Vec2::new(8.0, 4.0));
    painter.rect_filled(back, 4.0, Color32::from_black_alpha(190));
    painter.galley(at, galley, Color32::WHITE);
}

/// Marks the image position of the inspected point.
pub(super) fn sight(painter: &Painter, map: &CanvasMap, at_px: glam::DVec2) {
    let at = map.to_screen(at_px);
    for (width, color) in [
        (3.5, Color32::from_black_alpha(160)),
        (1.5, Color32::from_rgb(255, 235, 90)),
    ] {
        painter.circle_stroke(at, 9.0, Line::new(width, color));
        for side in [Vec2::X, -Vec2::X, Vec2::Y, -Vec2::Y] {
            painter.line_segment([at + 5.0 * side, at + 14.0 * side], Line::new(width, color));
        }
    }
}

/// Draws the pointer that arrow keys move: a cross with a gap around the pixel.
pub(super) fn key_pointer(painter: &Painter, map: &CanvasMap, at_px: glam::DVec2) {
    let at = map.to_screen(at_px);
    for (width, color) in [(4.0, Color32::BLACK), (2.0, Color32::WHITE)] {
        for side in [Vec2::X, -Vec2::X, Vec2::Y, -Vec2::Y] {
            painter.line_segment([at + 4.0 * side, at + 16.0 * side], Line::new(width, color));
        }
    }
}

/// Draws the brush as a circle around the pointer.
pub(super) fn brush_circle(painter: &Painter, map: &CanvasMap, view: &ViewState, pointer: Pos2) {
    if matches!(view.tool, Tool::Brush | Tool::Eraser) {
        let radius = view.prefs.brush_px as f32 * map.scale;
        painter.circle_stroke(
            pointer,
            radius + 0.5,
            Line::new(1.5, Color32::from_black_alpha(160)),
        );
        painter.circle_stroke(pointer, radius, Line::new(1.0, Color32::WHITE));
    }
}

pub(super) fn color_of(session: &SessionView<'_>, label: LabelId) -> Color32 {
    let [r, g, b] = session
        .project
        .labels
        .get(label)
        .map_or([230; 3], |label| label.color);
    Color32::from_rgb(r, g, b)
}

fn prompt_marks(painter: &Painter, map: &CanvasMap, prompt: &Prompt, color: Color32, chosen: bool) {
    let radius = if chosen { 6.0 } else { 4.0 };
    for px_box in &prompt.boxes {
        let rect = Rect::from_two_pos(map.to_screen(px_box.min_px), map.to_screen(px_box.max_px));
        outlined_rect(painter, rect, color);
    }
    for click in &prompt.clicks {
        let at = map.to_screen(click.at_px);
        painter.circle(at, radius, color, Line::new(1.5, Color32::WHITE));
        painter.circle_stroke(
            at,
            radius + 1.2,
            Line::new(1.0, Color32::from_black_alpha(170)),
        );
        let arm = radius * 0.55;
        let sign = Line::new(1.6, Color32::WHITE);
        painter.line_segment([at - Vec2::X * arm, at + Vec2::X * arm], sign);
        if click.include {
            painter.line_segment([at - Vec2::Y * arm, at + Vec2::Y * arm], sign);
        }
    }
}

fn outlined_rect(painter: &Painter, rect: Rect, color: Color32) {
    painter.rect_stroke(
        rect,
        0.0,
        Line::new(3.0, Color32::from_black_alpha(140)),
        egui::StrokeKind::Middle,
    );
    painter.rect_stroke(rect, 0.0, Line::new(1.5, color), egui::StrokeKind::Middle);
}

fn brush_stroke(painter: &Painter, map: &CanvasMap, stroke: &Stroke, color: Color32, opacity: f32) {
    let radius = stroke.radius_px as f32 * map.scale;
    let fill = if stroke.erase {
        Color32::from_gray(30)
    } else {
        color
    }
    .gamma_multiply(opacity.max(0.35));
    let points: Vec<Pos2> = stroke
        .points_px
        .iter()
        .map(|&at| map.to_screen(at))
        .collect();
    if let [only] = points[..] {
        painter.circle_filled(only, radius, fill);
    } else {
        painter.add(Shape::line(points, Line::new(radius * 2.0, fill)));
    }
}

/// Previews the dragged border and the part of the old border that it replaces.
fn held_border(painter: &Painter, map: &CanvasMap, held: &HeldBorder, to: Pos2, color: Color32) {
    let Some(to_px) = held.to_px(map.to_px(to)) else {
        return;
    };
    let Some(pull) = held.borders.pull(held.from_px, to_px) else {
        return;
    };
    let to = map.to_screen(to_px);
    let old: Vec<Pos2> = pull.gives_way.iter().map(|&at| map.to_screen(at)).collect();
    let (Some(&begin), Some(&end)) = (old.first(), old.last()) else {
        return;
    };
    painter.add(Shape::line(old, Line::new(1.0, Color32::WHITE)));
    outlined_line(painter, vec![begin, to, end], color);
    painter.circle(to, 4.0, color, Line::new(1.0, Color32::WHITE));
}

/// Draws the polygon, freehand outline or thin structure so far.
fn corners(
    painter: &Painter,
    map: &CanvasMap,
    draft: &Draft,
    pointer: Option<Pos2>,
    color: Color32,
) {
    let mut points: Vec<Pos2> = draft.corners.iter().map(|&at| map.to_screen(at)).collect();
    for (index, &at) in points.iter().enumerate() {
        painter.circle(
            at,
            if index == 0 { 5.0 } else { 3.0 },
            color,
            Line::new(1.0, Color32::WHITE),
        );
    }
    points.extend(draft.lasso.iter().flatten().map(|&at| map.to_screen(at)));
    let begun = !points.is_empty();
    points.extend(pointer.filter(|_| begun));
    if points.len() > 1 {
        outlined_line(painter, points, color);
    }
}

fn outlined_line(painter: &Painter, points: Vec<Pos2>, color: Color32) {
    painter.add(Shape::line(
        points.clone(),
        Line::new(3.0, Color32::from_black_alpha(140)),
    ));
    painter.add(Shape::line(points, Line::new(1.5, color)));
}
