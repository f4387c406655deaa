//! The shown frame's image and mask, in full or, until that is loaded and during playback, smaller.

use egui::Painter;

use super::map::CanvasMap;
use super::paint;
use crate::mask_drawings::MaskSize;
use crate::textures::Textures;
use crate::{SessionView, ViewState};
use ostra_view::Layer;

/// Paints the image of the shown frame; returns `false` if not even a thumbnail is loaded.
///
/// Playback shows previews, because a whole photo takes longer to draw than a frame lasts.
pub(super) fn paint_image(
    painter: &Painter,
    session: &SessionView<'_>,
    view: &ViewState,
    textures: &mut Textures,
    map: &CanvasMap,
) -> bool {
    let Some(images) = session.images else {
        return false;
    };
    let (frame, ctx) = (view.frame, painter.ctx());
    let full = if !view.playback.is_playing() {
        images.image(frame)
    } else if images.has_preview(frame) {
        None
    } else {
        images.kept_image(frame)
    };
    let texture = match full {
        Some(image) => textures.image(ctx, &image, view.tone),
        None => match images.smaller(frame) {
            Some(image) => textures.preview(ctx, &image, view.tone),
            None => return false,
        },
    };
    paint::texture(painter, map, texture.id());
    true
}

/// Paints the mask drawn for playback; returns `false` if the mask is to be painted in full.
pub(super) fn paint_played_mask(
    painter: &Painter,
    session: &SessionView<'_>,
    view: &ViewState,
    textures: &mut Textures,
    map: &CanvasMap,
) -> bool {
    let is_small = view.playback.is_playing() && !view.compare && view.layer == Layer::Image;
    if !is_small {
        return false;
    }
    let (masks, size) = (&mut textures.masks, MaskSize::Preview);
    match masks.texture(painter.ctx(), session.project, size, view.frame) {
        Some(mask) => paint::texture(painter, map, mask.id()),
        None => return !session.project.masks.contains_key(&view.frame),
    }
    true
}
