//! The shown frame's image and mask, in full or, until that is loaded and during playback, smaller.

use egui::Painter;

use super::map::CanvasMap;
use super::paint;
use crate::mask_drawings::MaskSize;
use crate::textures::Textures;
use crate::{SessionView, ViewState};
use ostra_view::Layer;

/// Where and of what the image and the mask of the shown frame are painted.
#[derive(Clone, Copy)]
pub(super) struct ShownImage<'a> {
    pub painter: &'a Painter,
    pub session: &'a SessionView<'a>,
    pub view: &'a ViewState,
    pub map: &'a CanvasMap,
}

impl ShownImage<'_> {
    /// Paints the image; returns `false` if not even a thumbnail is loaded.
    ///
    /// Playback shows previews, because a whole photo takes longer to draw than a frame lasts.
    pub fn paint_image(&self, textures: &mut Textures) -> bool {
        let Self { view, .. } = *self;
        let Some(images) = self.session.images else {
            return false;
        };
        let (frame, ctx) = (view.frame, self.painter.ctx());
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
        paint::texture(self.painter, self.map, texture.id());
        true
    }

    /// Paints the mask drawn for playback; returns `false` if the mask is to be painted in full.
    pub fn paint_played_mask(&self, textures: &mut Textures) -> bool {
        let Self { session, view, .. } = *self;
        let is_small = view.playback.is_playing() && !view.compare && view.layer == Layer::Image;
        if !is_small {
            return false;
        }
        let (masks, size) = (&mut textures.masks, MaskSize::Preview);
        match masks.texture(self.painter.ctx(), session.project, size, view.frame) {
            Some(mask) => paint::texture(self.painter, self.map, mask.id()),
            None => return !session.project.masks.contains_key(&view.frame),
        }
        true
    }
}
