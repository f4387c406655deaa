use std::sync::Arc;

use egui::{Color32, FontId, Pos2, Rect, Response, Role, Sense, Stroke, Ui, Vec2, WidgetInfo};

use super::answer_bar::answer_bar_ui;
use super::draft::Tool;
use super::input::{CanvasPointer, canvas_input};
use super::map::CanvasMap;
use super::paint;
use super::prompts::{id_at, with_click};
use super::shown_image::ShownImage;
use super::toolbar::toolbar_ui;
use crate::action::{Action, Requests};
use crate::pointer::HoverDwell;
use crate::textures::Textures;
use crate::{SessionView, Tone, ViewState};
use ostra_masks::{Click, RunMask};
use ostra_session::PromptRequest;
use ostra_view::{Layer, ramp};

/// Draws the shown frame's image with its tool row; returns `true` if the pane is dragged away.
pub(crate) fn image_pane_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    textures: &mut Textures,
    requests: &mut Requests,
) -> bool {
    let Some(frame) = session.project.frames.get(view.frame) else {
        return false;
    };
    let size_px = [frame.width.max(1), frame.height.max(1)];
    let zoom_percent = view
        .zoom
        .map(ui.available_rect_before_wrap(), size_px)
        .scale
        * ui.pixels_per_point()
        * 100.0;
    let is_dragged = toolbar_ui(ui, session, view, zoom_percent, &mut requests.actions);
    let (pane, response) = ui.allocate_exact_size(ui.available_size(), Sense::click_and_drag());
    let name = format!("Image {}", frame.name);
    response.widget_info(|| WidgetInfo::labeled(Role::Image, ui.is_enabled(), &name));
    let map = view.zoom.map(pane, size_px);
    let pointer = CanvasPointer {
        ui,
        response: &response,
        map: &map,
    };
    if !pauses_playback(&pointer, view) {
        canvas_input(&pointer, session, view, &mut requests.commands);
    }
    let map = view.zoom.map(pane, size_px);
    let mouse_px = response
        .hover_pos()
        .and_then(|at| map.inside(map.to_px(at)));
    let is_entered = (view.key_pointer).follow(ui, &response, &map, &mut view.zoom);
    let map = view.zoom.map(pane, size_px);
    view.canvas_map = Some(map);
    view.pointer_px = view.key_pointer.at_px().or(mouse_px);
    if is_entered && view.tool == Tool::Click {
        requests.actions.push(Action::IncludeHere);
    }
    if mouse_px.is_some() && !ui.input(|i| i.key_down(egui::Key::Space)) {
        ui.ctx().set_cursor_icon(egui::CursorIcon::Crosshair);
    }
    follow_pointer(ui, &response, &map, session, view);
    draw(ui, session, view, textures, &map);
    answer_bar_ui(ui, pane, session, view, &mut requests.commands);
    is_dragged
}

/// Pauses playback if the image is pressed; returns `true` while that press lasts.
fn pauses_playback(pointer: &CanvasPointer<'_>, view: &mut ViewState) -> bool {
    let CanvasPointer { ui, response, .. } = pointer;
    let (is_pressed, is_down) = ui.input(|input| {
        let pointer = &input.pointer;
        let is_pressed = pointer.primary_pressed() || pointer.secondary_pressed();
        // Space with a drag moves the image.
        let is_pressed = is_pressed && !input.key_down(egui::Key::Space);
        (is_pressed, pointer.any_down())
    });
    let is_pressed = is_pressed && response.contains_pointer();
    view.playback.takes_press(is_pressed, is_down)
}

fn draw(
    ui: &Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    textures: &mut Textures,
    map: &CanvasMap,
) {
    let painter = ui.painter_at(map.pane);
    painter.rect_filled(map.pane, 0.0, ui.visuals().extreme_bg_color);
    let shown = ShownImage {
        painter: &painter,
        session,
        view: &*view,
        map,
    };
    if view.layer == Layer::Image {
        if !shown.paint_image(textures) {
            placeholder(ui, session, view, map);
        }
    } else {
        layer(ui, session, view, textures, map);
    }
    let before = session.before.filter(|_| view.compare).cloned();
    if view.compare {
        paint::banner(
            &painter,
            map,
            if before.is_some() {
                "Before the last change"
            } else {
                "No change here"
            },
        );
    }
    if view.masks_shown && shown.paint_played_mask(textures) {
        only_banner(&painter, session, view, map);
    } else {
        mask(ui, session, view, textures, map, before);
    }
    if let Some(region) = session
        .vote_mismatch
        .filter(|_| view.masks_shown && !view.compare)
    {
        paint::texture(&painter, map, textures.vote_mismatch(ui.ctx(), region).id());
    }
    let pointer = view.pointer_px.map(|at| map.to_screen(at));
    if let (Some(mask), Some(request)) = (session.hovered, &view.hover_request) {
        let color = paint::color_of(session, request.label);
        view.preview.draw(&painter, map, mask, color, pointer);
    }
    paint::prompts_and_draft(&painter, map, session, view, pointer);
    if let Some(at_px) = view
        .inspected_point
        .as_ref()
        .and_then(|inspected_point| inspected_point.seen_in(view.frame))
    {
        paint::sight(&painter, map, at_px);
    }
    if let Some(at_px) = view.key_pointer.at_px() {
        paint::key_pointer(&painter, map, at_px);
    }
    if let Some(at) = pointer {
        paint::brush_circle(&painter, map, view, at);
    }
}

/// Draws the mask, or the one before its last change while both are compared.
fn mask(
    ui: &Ui,
    session: &SessionView<'_>,
    view: &ViewState,
    textures: &mut Textures,
    map: &CanvasMap,
    before: Option<Arc<RunMask>>,
) {
    if !view.masks_shown {
        return;
    }
    let painter = &ui.painter_at(map.pane);
    if let Some(runs) = before.or_else(|| session.project.mask_in_play(view.frame)) {
        let style = view.overlay_style();
        // About one pixel of the mask per pixel of the screen keeps outlines visible.
        let step = (1.0 / (map.scale * ui.pixels_per_point())).round().max(1.0) as usize;
        let texture = textures.mask(ui.ctx(), &runs, &session.project.labels, &style, step);
        paint::texture(painter, map, texture.id());
    }
    only_banner(painter, session, view, map);
}

/// Says that only one label is shown.
fn only_banner(
    painter: &egui::Painter,
    session: &SessionView<'_>,
    view: &ViewState,
    map: &CanvasMap,
) {
    if let Some(label) = view
        .shown_label()
        .and_then(|label| session.project.labels.get(label))
        .filter(|_| !view.compare)
    {
        paint::banner(painter, map, &format!("Only {}", label.name));
    }
}

/// Draws depth, normals or confidence in place of the image, with a legend.
fn layer(
    ui: &Ui,
    session: &SessionView<'_>,
    view: &ViewState,
    textures: &mut Textures,
    map: &CanvasMap,
) {
    let warn = ui.visuals().error_fg_color;
    match session
        .layers
        .and_then(|layers| layers.get(&(view.frame, view.layer)))
    {
        Some(Ok(Some(drawn))) => {
            paint::texture(
                &ui.painter_at(map.pane),
                map,
                textures.image(ui.ctx(), &drawn.image, Tone::default()).id(),
            );
            if let Some(range) = drawn.range {
                let title = match view.layer {
                    Layer::Depth => {
                        format!("Depth, {}", session.project.depth_unit(view.frame).sign())
                    }
                    other => other.text().into(),
                };
                legend(ui, map, &title, range);
            }
        }
        Some(Ok(None)) => {
            let text = match view.layer {
                Layer::Depth => "This frame has no depth; use Reconstruct to compute it",
                _ => "Only depth maps from stereo have normals and confidence",
            };
            label_ui(ui, map, text.into(), ui.visuals().weak_text_color());
        }
        Some(Err(why)) => label_ui(ui, map, why, warn),
        None => label_ui(ui, map, "Loading…".into(), ui.visuals().weak_text_color()),
    }
}

/// Draws a message in place of an image that is loading or failed to load.
fn placeholder(ui: &Ui, session: &SessionView<'_>, view: &ViewState, map: &CanvasMap) {
    let failure = session.images.and_then(|images| images.failure(view.frame));
    let (text, color) = match failure {
        Some(failure) => (failure, ui.visuals().error_fg_color),
        None => ("Loading…".into(), ui.visuals().weak_text_color()),
    };
    label_ui(ui, map, text, color);
}

fn label_ui(ui: &Ui, map: &CanvasMap, text: String, color: egui::Color32) {
    let painter = ui.painter_at(map.pane);
    painter.rect_filled(map.image_rect(), 0.0, ui.visuals().faint_bg_color);
    let galley = painter.layout(
        text,
        egui::FontId::proportional(14.0),
        color,
        (map.pane.width() - 40.0).max(50.0),
    );
    painter.galley(map.pane.center() - galley.size() / 2.0, galley, color);
}

/// Requests a preview of an include click at the resting pointer.
fn follow_pointer(
    ui: &Ui,
    response: &Response,
    map: &CanvasMap,
    session: &SessionView<'_>,
    view: &mut ViewState,
) {
    view.hover_request = None;
    let Some(at) = response
        .hover_pos()
        .filter(|_| may_preview(ui, session, view))
    else {
        view.rest = None;
        return;
    };
    if let Some(at) = HoverDwell::follow(&mut view.rest, ui, at) {
        view.hover_request = hover_request_at(at, map, session, view);
    }
}

/// Returns `true` if a preview is useful.
///
/// This requires the click tool, and nothing being drawn, sent or running.
fn may_preview(ui: &Ui, session: &SessionView<'_>, view: &ViewState) -> bool {
    let busy = !session.jobs.is_empty()
        || view.draft.is_sending()
        || ui.input(|input| input.pointer.any_down() || input.modifiers.command);
    view.prefs.hover_preview
        && view.masks_shown
        && view.tool == Tool::Click
        && view.dialog.is_none()
        && !view.playback.is_playing()
        && !busy
}

fn hover_request_at(
    at: Pos2,
    map: &CanvasMap,
    session: &SessionView<'_>,
    view: &ViewState,
) -> Option<PromptRequest> {
    let at_px = map.inside(map.to_px(at))?;
    // Without labels, a click adds the first one.
    let label = view
        .label
        .filter(|&label| session.project.labels.get(label).is_some())
        .unwrap_or_else(|| session.project.labels.next_id());
    // A click there would change nothing.
    let mask = session.project.masks.get(&view.frame);
    if mask.is_some_and(|mask| id_at(&mask.runs, at_px) == label) {
        return None;
    }
    let click = Click {
        at_px,
        include: true,
    };
    Some(with_click(session, view, label, click))
}

/// Draws the legend of the colour ramp in the lower left corner of the pane.
fn legend(ui: &Ui, map: &CanvasMap, title: &str, range: [f32; 2]) {
    const SIZE: Vec2 = Vec2::new(14.0, 120.0);
    const TITLE: f32 = 20.0;
    let painter = ui.painter_at(map.pane);
    let corner = map.pane.left_bottom() + Vec2::new(14.0, -14.0);
    let bar = Rect::from_min_size(corner - Vec2::new(0.0, SIZE.y), SIZE);
    let title = painter.layout_no_wrap(title.into(), FontId::proportional(12.0), Color32::WHITE);
    let back = bar
        .expand2(Vec2::new(8.0, 10.0))
        .with_min_y(bar.min.y - TITLE - 10.0);
    let back = back.with_max_x(bar.max.x + 62.0).union(Rect::from_min_size(
        back.min,
        title.size() + Vec2::splat(16.0),
    ));
    painter.rect_filled(back, 4.0, Color32::from_black_alpha(170));
    painter.galley(
        bar.left_top() - Vec2::new(0.0, TITLE),
        title,
        Color32::WHITE,
    );
    for step in 0..SIZE.y as usize {
        let [r, g, b] = ramp(step as f32 / SIZE.y);
        let y = bar.max.y - step as f32 - 0.5;
        painter.hline(
            bar.x_range(),
            y,
            Stroke::new(1.0, Color32::from_rgb(r, g, b)),
        );
    }
    for share in [0.0, 0.5, 1.0] {
        let value = range[0] + share * (range[1] - range[0]);
        let galley =
            painter.layout_no_wrap(short(value), FontId::proportional(12.0), Color32::WHITE);
        let at = Pos2::new(
            bar.max.x + 6.0,
            bar.max.y - share * SIZE.y - galley.size().y / 2.0,
        );
        painter.galley(at, galley, Color32::WHITE);
    }
}

/// Formats a number with three significant digits.
fn short(value: f32) -> String {
    let digits = if value == 0.0 {
        0
    } else {
        2 - value.abs().log10().floor() as i32
    };
    format!("{value:.*}", digits.clamp(0, 9) as usize)
}

#[cfg(test)]
mod tests {
    use super::short;

    #[test]
    fn numbers_have_three_digits() {
        let texts = [0.0, 0.51234, 5.1234, 51.234, 512.34, 5123.4].map(short);
        assert_eq!(texts, ["0", "0.512", "5.12", "51.2", "512", "5123"]);
    }
}
