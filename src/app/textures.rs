use std::collections::BTreeMap;
use std::sync::Arc;

use egui::{Color32, ColorImage, Context, TextureHandle, TextureOptions};

use super::Tone;
use super::mask_drawings::MaskDrawings;
use ostra_frames::Image;
use ostra_masks::{LabelId, LabelMask, LabelTree, Region, RunMask};
use ostra_view::{OverlayStyle, hatch, overlay};

/// Textures of images, thumbnails and masks. Each is rebuilt only when its content changes.
#[derive(Default)]
pub(super) struct Textures {
    image: Option<CachedImage>,
    /// Tone of the shown image.
    tone: Tone,
    pair: [Option<CachedImage>; 2],
    mask: Option<MaskTexture>,
    vote_mismatch: Option<(Arc<Region>, TextureHandle)>,
    thumbnails: BTreeMap<usize, Thumbnail>,
    small: Vec<CachedImage>,
    preview: Option<CachedImage>,
    /// Masks over thumbnails, and over images during playback.
    pub masks: MaskDrawings,
    clock: u64,
}

type CachedImage = (Arc<Image>, TextureHandle);

struct MaskTexture {
    runs: Arc<RunMask>,
    tree: LabelTree,
    style: OverlayStyle,
    step: usize,
    texture: TextureHandle,
}

struct Thumbnail {
    image: Arc<Image>,
    texture: TextureHandle,
    seen: u64,
}

/// Maximum number of thumbnails kept on the GPU.
const THUMBNAILS_KEPT: usize = 300;

/// Number of thumbnails of files and projects that are not open kept on the GPU.
const SMALL_KEPT: usize = 40;

/// Smooth when minified, sharp pixels when magnified.
const PIXELS: TextureOptions = TextureOptions {
    magnification: egui::TextureFilter::Nearest,
    minification: egui::TextureFilter::Linear,
    wrap_mode: egui::TextureWrapMode::ClampToEdge,
    mipmap_mode: Some(egui::TextureFilter::Linear),
};

impl Textures {
    /// Drops all textures of the previous project.
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// Returns the texture of the shown image with another brightness and contrast.
    pub fn image(&mut self, ctx: &Context, image: &Arc<Image>, tone: Tone) -> TextureHandle {
        self.set_tone(tone);
        image_texture(&mut self.image, ctx, image, tone)
    }

    fn set_tone(&mut self, tone: Tone) {
        if self.tone != tone {
            (self.image, self.preview) = (None, None);
            self.tone = tone;
        }
    }

    /// Returns the texture of a small image in place of the shown one, smooth when magnified.
    pub fn preview(&mut self, ctx: &Context, image: &Arc<Image>, tone: Tone) -> TextureHandle {
        self.set_tone(tone);
        if let Some((shown, texture)) = &self.preview
            && Arc::ptr_eq(shown, image)
        {
            return texture.clone();
        }
        let table = tone.table();
        let pixels = fitted(ctx, image.width, image.height, |i| {
            opaque(image.pixels[i].map(|channel| table[usize::from(channel)]))
        });
        let texture = ctx.load_texture("preview", pixels, TextureOptions::LINEAR);
        self.preview = Some((Arc::clone(image), texture.clone()));
        texture
    }

    /// Returns the texture of one of two images shown next to each other.
    pub fn of_pair(&mut self, ctx: &Context, place: usize, image: &Arc<Image>) -> TextureHandle {
        image_texture(&mut self.pair[place], ctx, image, Tone::default())
    }

    /// Returns the texture of the mask over the image, with one pixel for `step` pixels of a side.
    ///
    /// Outlines are as wide as these pixels, which the screen should be able to show.
    pub fn mask(
        &mut self,
        ctx: &Context,
        runs: &Arc<RunMask>,
        tree: &LabelTree,
        style: &OverlayStyle,
        step: usize,
    ) -> TextureHandle {
        mask_texture(&mut self.mask, ctx, runs, tree, style, step)
    }

    /// Returns the texture of the pixels that contradict the vote.
    pub fn vote_mismatch(&mut self, ctx: &Context, region: &Arc<Region>) -> TextureHandle {
        if let Some((shown, texture)) = &self.vote_mismatch
            && Arc::ptr_eq(shown, region)
        {
            return texture.clone();
        }
        let pixels = hatch(region);
        let image = fitted(ctx, region.width, region.height, |i| straight(pixels[i]));
        let texture = ctx.load_texture("contradicted", image, PIXELS);
        self.vote_mismatch = Some((Arc::clone(region), texture.clone()));
        texture
    }

    /// Returns the texture of a thumbnail.
    pub fn thumbnail(&mut self, ctx: &Context, frame: usize, image: &Arc<Image>) -> TextureHandle {
        self.clock += 1;
        let clock = self.clock;
        if let Some(kept) = self.thumbnails.get_mut(&frame)
            && Arc::ptr_eq(&kept.image, image)
        {
            kept.seen = clock;
            return kept.texture.clone();
        }
        let pixels = fitted(ctx, image.width, image.height, |i| opaque(image.pixels[i]));
        let texture = ctx.load_texture("thumbnail", pixels, TextureOptions::LINEAR);
        self.thumbnails.insert(
            frame,
            Thumbnail {
                image: Arc::clone(image),
                texture: texture.clone(),
                seen: clock,
            },
        );
        self.drop_oldest_thumbnail();
        texture
    }

    /// Returns the texture of a thumbnail of a file or project that is not open.
    pub fn small(&mut self, ctx: &Context, image: &Arc<Image>) -> TextureHandle {
        let known = self.small.iter().find(|(of, _)| Arc::ptr_eq(of, image));
        if let Some((_, texture)) = known {
            return texture.clone();
        }
        let pixels = fitted(ctx, image.width, image.height, |i| opaque(image.pixels[i]));
        let texture = ctx.load_texture("small", pixels, TextureOptions::LINEAR);
        if self.small.len() >= SMALL_KEPT {
            drop(self.small.remove(0));
        }
        self.small.push((Arc::clone(image), texture.clone()));
        texture
    }

    fn drop_oldest_thumbnail(&mut self) {
        if self.thumbnails.len() > THUMBNAILS_KEPT
            && let Some(oldest) = self
                .thumbnails
                .iter()
                .min_by_key(|(_, kept)| kept.seen)
                .map(|(&frame, _)| frame)
        {
            self.thumbnails.remove(&oldest);
        }
    }
}

/// Returns the cached texture, or a new one if the image changed.
fn image_texture(
    kept: &mut Option<CachedImage>,
    ctx: &Context,
    image: &Arc<Image>,
    tone: Tone,
) -> TextureHandle {
    if let Some((shown, texture)) = kept
        && Arc::ptr_eq(shown, image)
    {
        return texture.clone();
    }
    let table = tone.table();
    let pixels = fitted(ctx, image.width, image.height, |i| {
        opaque(image.pixels[i].map(|channel| table[usize::from(channel)]))
    });
    let texture = ctx.load_texture("picture", pixels, PIXELS);
    *kept = Some((Arc::clone(image), texture.clone()));
    texture
}

/// Returns the cached texture, or a new one if its mask, labels or style changed.
fn mask_texture(
    kept: &mut Option<MaskTexture>,
    ctx: &Context,
    runs: &Arc<RunMask>,
    tree: &LabelTree,
    style: &OverlayStyle,
    step: usize,
) -> TextureHandle {
    if let Some(shown) = kept
        && (Arc::ptr_eq(&shown.runs, runs) || shown.runs == *runs)
        && shown.style == *style
        && shown.step == step
        && shown.tree == *tree
    {
        return shown.texture.clone();
    }
    let mask = reduced(runs.decode(), step);
    let pixels = overlay(&mask, tree, style);
    let image = fitted(ctx, mask.width, mask.height, |i| straight(pixels[i]));
    let texture = ctx.load_texture("mask", image, PIXELS);
    let (tree, style) = (tree.clone(), style.clone());
    *kept = Some(MaskTexture {
        runs: Arc::clone(runs),
        tree,
        style,
        step,
        texture: texture.clone(),
    });
    texture
}

/// Returns a mask with one pixel for `step` pixels of a side.
///
/// It has any label of these pixels, so that thin structures do not vanish.
fn reduced(mask: LabelMask, step: usize) -> LabelMask {
    if step < 2 {
        return mask;
    }
    let [width, height] = [mask.width as usize, mask.height as usize];
    let [columns, rows] = [width.div_ceil(step), height.div_ceil(step)];
    let mut small = LabelMask::empty(columns as u32, rows as u32);
    for (at, id) in small.ids.iter_mut().enumerate() {
        let (x, y) = (at % columns, at / columns);
        let across = x * width / columns..(x + 1) * width / columns;
        let mut pixels = (y * height / rows..(y + 1) * height / rows)
            .flat_map(|row| &mask.ids[row * width + across.start..row * width + across.end]);
        let found = pixels.find(|id| **id != LabelId::NONE);
        *id = found.copied().unwrap_or(LabelId::NONE);
    }
    small
}

fn opaque([r, g, b]: [u8; 3]) -> Color32 {
    Color32::from_rgb(r, g, b)
}

fn straight([r, g, b, a]: [u8; 4]) -> Color32 {
    Color32::from_rgba_unmultiplied(r, g, b, a)
}

/// Converts pixels for egui. Images above the GPU's texture limit are subsampled.
fn fitted(ctx: &Context, width: u32, height: u32, color: impl Fn(usize) -> Color32) -> ColorImage {
    let most = ctx.input(|input| input.max_texture_side).max(1);
    let (width, height) = (width as usize, height as usize);
    let step = width.max(height).div_ceil(most).max(1);
    let size = [width.div_ceil(step), height.div_ceil(step)];
    let mut pixels = Vec::with_capacity(size[0] * size[1]);
    for y in (0..height).step_by(step) {
        pixels.extend((0..width).step_by(step).map(|x| color(y * width + x)));
    }
    ColorImage::new(size, pixels)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thin_structures_stay_in_a_reduced_mask() {
        let mut mask = LabelMask::empty(10, 7);
        (0..7).for_each(|y| mask.ids[y * 10 + 4] = LabelId(3));
        let small = reduced(mask.clone(), 3);
        assert_eq!((small.width, small.height), (4, 3));
        for row in small.ids.chunks(4) {
            assert_eq!(row, [0, 3, 0, 0].map(LabelId));
        }
        assert_eq!(reduced(mask.clone(), 1), mask);
    }
}
