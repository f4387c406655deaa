use egui::{
    Color32, Pos2, Rect, Response, Role, ScrollArea, Sense, Shape, Stroke, Ui, Vec2, WidgetInfo,
};

use super::heat::check_reasons_ui;
use crate::mask_drawings::MaskSize;
use crate::textures::Textures;
use crate::{SessionView, ViewState};
use ostra_project::{FrameMask, MaskOrigin};

const TILE: Vec2 = Vec2::new(90.0, 58.0);
/// Height of the filmstrip in points, with its scroll bar.
pub(crate) const FILMSTRIP_HEIGHT: f32 = TILE.y + 12.0;
const GAP: f32 = 4.0;
const UV: Rect = Rect {
    min: Pos2::ZERO,
    max: Pos2::new(1.0, 1.0),
};

/// State of a frame's mask, shown as a badge on its thumbnail.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FrameState {
    None,
    Tracked,
    Keyframe,
    Stale,
}

/// Draws the thumbnails of all frames with the state of their masks.
///
/// Only visible thumbnails are created.
pub(crate) fn filmstrip_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    textures: &mut Textures,
) {
    let count = session.project.frames.len();
    let pitch = TILE.x + GAP;
    let mut area = ScrollArea::horizontal()
        .id_salt("filmstrip")
        .auto_shrink([false, false]);
    if std::mem::take(&mut view.reveal_frame) {
        area = area.horizontal_scroll_offset(offset_showing(ui, view.frame, pitch));
    }
    let out = area.show_viewport(ui, |ui, sight| {
        ui.set_width(count as f32 * pitch);
        ui.set_height(TILE.y);
        let first = (sight.min.x / pitch).floor().max(0.0) as usize;
        let last = ((sight.max.x / pitch).ceil() as usize).min(count);
        for frame in first..last {
            let at = ui.max_rect().min + Vec2::new(frame as f32 * pitch, 0.0);
            let rect = Rect::from_min_size(at, TILE);
            let tile = Tile { frame, rect };
            if tile_ui(ui, tile, session, view, textures).clicked() {
                view.frame = frame;
                view.draft.drop_half_made();
            }
        }
    });
    ui.data_mut(|data| {
        data.insert_temp(
            egui::Id::unique("filmstrip"),
            (out.state.clamped_offset().x, out.inner_rect.width()),
        )
    });
}

/// Returns the scroll offset that makes the frame visible with the least movement.
fn offset_showing(ui: &Ui, frame: usize, pitch: f32) -> f32 {
    let (offset, width) = ui
        .data(|data| data.get_temp::<(f32, f32)>(egui::Id::unique("filmstrip")))
        .unwrap_or((0.0, 0.0));
    let begin = frame as f32 * pitch;
    if begin < offset + pitch {
        (begin - pitch).max(0.0)
    } else if begin + 2.0 * pitch > offset + width {
        (begin + 2.0 * pitch - width).max(0.0)
    } else {
        offset
    }
}

/// Frame of the filmstrip and its place.
#[derive(Clone, Copy)]
struct Tile {
    frame: usize,
    rect: Rect,
}

fn tile_ui(
    ui: &Ui,
    tile: Tile,
    session: &SessionView<'_>,
    view: &ViewState,
    textures: &mut Textures,
) -> Response {
    let Tile { frame, rect } = tile;
    let response = ui.interact(rect, ui.scope_id().with(("tile", frame)), Sense::click());
    let mask = session.project.masks.get(&frame);
    let (state, shown) = (state_of(mask), view.frame == frame);
    let name = format!("Frame {frame}, {}", state.text());
    response.widget_info(|| WidgetInfo::selected(Role::Button, true, shown, &name));
    background(ui, &response, rect, shown);
    image(ui, tile, session, view, textures);
    caption(ui, tile, state, shown);
    label_marks(ui, tile, session, view);
    response.on_hover_ui(|ui| {
        tooltip_ui(ui, session, mask, frame, state);
        check_reasons_ui(ui, session, view, frame);
    })
}

fn background(ui: &Ui, response: &Response, rect: Rect, shown: bool) {
    let visuals = ui.visuals();
    let fill = match (shown, response.hovered()) {
        (true, _) => visuals.selection.bg_fill,
        (false, true) => visuals.widgets.hovered.weak_bg_fill,
        (false, false) => visuals.faint_bg_color,
    };
    ui.painter().rect_filled(rect, 4.0, fill);
    if response.has_focus() {
        ui.painter().rect_stroke(
            rect,
            4.0,
            visuals.selection.stroke,
            egui::StrokeKind::Inside,
        );
    }
}

/// Draws the thumbnail with the mask over it.
fn image(
    ui: &Ui,
    tile: Tile,
    session: &SessionView<'_>,
    view: &ViewState,
    textures: &mut Textures,
) {
    let Tile { frame, rect } = tile;
    let place = rect.shrink(2.0);
    let Some(image) = session.images.and_then(|images| images.thumbnail(frame)) else {
        ui.painter()
            .rect_filled(place, 2.0, ui.visuals().extreme_bg_color);
        if failure(session, frame).is_some() {
            let (centre, arm) = (place.center(), 0.2 * place.height());
            let stroke = egui::Stroke::new(2.0, ui.visuals().error_fg_color);
            for end in [Vec2::splat(arm), Vec2::new(arm, -arm)] {
                ui.painter()
                    .line_segment([centre - end, centre + end], stroke);
            }
        }
        return;
    };
    let texture = textures.thumbnail(ui.ctx(), frame, &image);
    let size = texture.size_vec2();
    let scale = (place.width() / size.x).min(place.height() / size.y);
    let fitted = Rect::from_center_size(place.center(), size * scale);
    ui.painter().image(texture.id(), fitted, UV, Color32::WHITE);
    if !view.masks_shown {
        return;
    }
    let (masks, size) = (&mut textures.masks, MaskSize::Thumbnail);
    if let Some(mask) = masks.texture(ui.ctx(), session.project, size, frame) {
        ui.painter().image(mask.id(), fitted, UV, Color32::WHITE);
    }
}

/// Returns why the image of a frame cannot be shown.
fn failure(session: &SessionView<'_>, frame: usize) -> Option<String> {
    session.images?.failure(frame)
}

fn caption(ui: &Ui, tile: Tile, state: FrameState, shown: bool) {
    // The caption lies over the image, on a ground that makes it legible.
    let ground = Rect::from_min_max(
        egui::pos2(tile.rect.left() + 2.0, tile.rect.bottom() - 17.0),
        tile.rect.max - Vec2::splat(2.0),
    );
    let fill = if shown {
        ui.visuals().selection.bg_fill
    } else {
        ui.visuals().panel_fill.gamma_multiply(0.8)
    };
    ui.painter().rect_filled(ground, 2.0, fill);
    let at = tile.rect.left_bottom() + Vec2::new(11.0, -9.5);
    badge(ui, at, state);
    let color = if shown {
        ui.visuals().strong_text_color()
    } else {
        ui.visuals().text_color()
    };
    let font = egui::FontId::proportional(11.0);
    ui.painter().text(
        at + Vec2::new(10.0, 0.0),
        egui::Align2::LEFT_CENTER,
        tile.frame.to_string(),
        font,
        color,
    );
}

/// Draws a badge whose states differ in shape as well as colour.
///
/// Ring: no mask; dot: tracked; diamond: keyframe; triangle: stale.
pub(super) fn badge(ui: &Ui, at: Pos2, state: FrameState) {
    let color = state.color(ui);
    let corners = |points: &[(f32, f32)]| {
        Shape::convex_polygon(
            points.iter().map(|&(x, y)| at + Vec2::new(x, y)).collect(),
            color,
            Stroke::NONE,
        )
    };
    match state {
        FrameState::None => ui.painter().circle_stroke(at, 3.2, Stroke::new(1.2, color)),
        FrameState::Tracked => ui.painter().circle_filled(at, 3.8, color),
        FrameState::Keyframe => {
            ui.painter()
                .add(corners(&[(0.0, -5.2), (5.2, 0.0), (0.0, 5.2), (-5.2, 0.0)]))
        }
        FrameState::Stale => ui
            .painter()
            .add(corners(&[(0.0, -4.8), (5.0, 4.0), (-5.0, 4.0)])),
    };
}

/// Draws a small bar in the colour of each label at the end of the caption.
fn label_marks(ui: &Ui, tile: Tile, session: &SessionView<'_>, view: &ViewState) {
    let Tile { frame, rect } = tile;
    let mut right = rect.right() - 5.0;
    for &label in view.frames.presence.on_frame(frame).iter().rev().take(7) {
        let [r, g, b] = session
            .project
            .labels
            .get(label)
            .map_or([120; 3], |label| label.color);
        let bar = Rect::from_min_max(
            egui::pos2(right - 5.0, rect.bottom() - 14.0),
            egui::pos2(right, rect.bottom() - 6.0),
        );
        ui.painter()
            .rect_filled(bar, 1.0, Color32::from_rgb(r, g, b));
        right -= 7.0;
    }
}

fn tooltip_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    mask: Option<&FrameMask>,
    frame: usize,
    state: FrameState,
) {
    let Some(shown) = session.project.frames.get(frame) else {
        return;
    };
    ui.strong(format!("{frame}  {}", shown.name));
    if let Some(why) = failure(session, frame) {
        ui.colored_label(ui.visuals().error_fg_color, why);
    }
    ui.label(format!("{} × {}", shown.width, shown.height));
    let has = |yes: bool| if yes { "yes" } else { "no" };
    ui.label(format!(
        "Depth: {}, camera: {}",
        has(shown.depth.is_some()),
        has(shown.posed_camera().is_some())
    ));
    ui.label(format!("Mask: {}", state.text()));
    for (label, confidence) in mask.iter().flat_map(|mask| &mask.confidence) {
        let name = session
            .project
            .labels
            .get(*label)
            .map_or("?", |label| label.name.as_str());
        ui.label(format!(
            "{name}: tracker confidence {:.0} %",
            confidence * 100.0
        ));
    }
}

fn state_of(mask: Option<&FrameMask>) -> FrameState {
    match mask {
        None => FrameState::None,
        Some(mask) if mask.stale => FrameState::Stale,
        Some(mask) if mask.origin == MaskOrigin::Keyframe => FrameState::Keyframe,
        Some(_) => FrameState::Tracked,
    }
}

impl FrameState {
    fn text(self) -> &'static str {
        match self {
            Self::None => "no mask",
            Self::Tracked => "tracked",
            Self::Keyframe => "keyframe",
            Self::Stale => "stale",
        }
    }

    fn color(self, ui: &Ui) -> Color32 {
        match self {
            Self::None => ui.visuals().weak_text_color(),
            Self::Tracked => Color32::from_rgb(90, 160, 240),
            Self::Keyframe => Color32::from_rgb(80, 190, 110),
            Self::Stale => ui.visuals().warn_fg_color,
        }
    }
}
