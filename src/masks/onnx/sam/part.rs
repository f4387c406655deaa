use glam::DVec2;

use crate::{Prompt, PxBox, Region};
use ostra_core::image::ImageSize;

/// The square on which the networks see a part of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Canvas {
    /// Side length, pixels.
    pub side: usize,
    /// Whether a part fills the whole square, whatever its shape.
    ///
    /// Otherwise its longer side does, with padding at the right or below.
    pub is_filled: bool,
}

/// The part of an image that the network sees, in whole pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImagePart {
    /// First column.
    pub x: u32,
    /// First row.
    pub y: u32,
    /// Number of columns, at least one.
    pub width: u32,
    /// Number of rows, at least one.
    pub height: u32,
}

/// Margin around the prompt of a close-up, relative to the prompt's extent.
const ROOM: f64 = 1.0;
/// Minimum side of a close-up, relative to the network's side.
///
/// A smaller part would only be enlarged further, without showing more.
const LEAST_SHARE: f64 = 0.25;

impl ImagePart {
    /// Returns the whole image as a part.
    #[must_use]
    pub fn whole(width: u32, height: u32) -> Self {
        Self {
            x: 0,
            y: 0,
            width,
            height,
        }
    }

    /// Returns a square around a prompt, for objects too thin for the whole image.
    ///
    /// The square has a margin around the prompt and lies inside the image. `side` is that of the
    /// network, in pixels. Returns `None` for an empty prompt, or if the whole image is hardly
    /// larger.
    #[must_use]
    pub fn around(prompt: &Prompt, width: u32, height: u32, side: usize) -> Option<Self> {
        let corners = prompt
            .boxes
            .iter()
            .flat_map(|part| [part.min_px, part.max_px]);
        let clicks = prompt
            .clicks
            .iter()
            .filter(|click| click.include)
            .map(|click| click.at_px);
        let all = || corners.clone().chain(clicks.clone());
        let (least, most) = (all().reduce(DVec2::min)?, all().reduce(DVec2::max)?);
        let extent = (most - least).max_element() * (1.0 + ROOM);
        let wanted = extent.max(side as f64 * LEAST_SHARE).ceil() as u32;
        if f64::from(wanted) > 0.75 * f64::from(width.max(height)) {
            return None;
        }
        let (columns, rows) = (wanted.min(width), wanted.min(height));
        let first = |middle: f64, part: u32, all: u32| {
            (middle - f64::from(part) / 2.0)
                .round()
                .clamp(0.0, f64::from(all - part)) as u32
        };
        let middle = (least + most) / 2.0;
        Some(Self {
            x: first(middle.x, columns, width),
            y: first(middle.y, rows, height),
            width: columns,
            height: rows,
        })
    }

    /// Returns whether the part lies within an image and contains a pixel.
    pub(super) fn is_within(&self, width: u32, height: u32) -> bool {
        let fits = |first: u32, count: u32, all: u32| {
            count > 0 && first.checked_add(count).is_some_and(|end| end <= all)
        };
        fits(self.x, self.width, width) && fits(self.y, self.height, height)
    }

    /// Returns whether a position in image pixels lies on a pixel of the part.
    pub(super) fn holds(&self, at_px: DVec2) -> bool {
        let at = at_px - self.origin();
        at.x >= 0.0 && at.y >= 0.0 && at.x < f64::from(self.width) && at.y < f64::from(self.height)
    }

    /// Returns the part's pixels as a region of the image.
    pub(super) fn region(&self, width: u32, height: u32) -> Region {
        let mut region = Region::empty(width, height);
        let rows = region
            .inside
            .chunks_exact_mut(width as usize)
            .skip(self.y as usize)
            .take(self.height as usize);
        rows.for_each(|row| row[self.x as usize..][..self.width as usize].fill(true));
        region
    }

    /// Returns the size of the part on the network's square.
    pub(super) fn shown(&self, canvas: Canvas) -> ImageSize {
        let side = canvas.side;
        if canvas.is_filled {
            return ImageSize::new(side, side);
        }
        let scale = side as f64 / f64::from(self.width.max(self.height));
        let shown = |count: u32| ((f64::from(count) * scale + 0.5) as usize).max(1);
        ImageSize::new(shown(self.width), shown(self.height))
    }

    /// Converts a click to pixels of the network's square.
    ///
    /// Positions are relative to the centre of the first pixel.
    pub(super) fn canvas_point(&self, at_px: DVec2, canvas: Canvas) -> [f32; 2] {
        self.on_canvas(at_px - 0.5, canvas)
    }

    /// Converts a box to points on the network's square.
    ///
    /// The box is clipped to the part. The points are the centres of its first and last pixel.
    pub(super) fn canvas_corners(&self, within: &PxBox, canvas: Canvas) -> [[f32; 2]; 2] {
        let end = self.origin() + DVec2::new(self.width.into(), self.height.into());
        let cut = |corner: DVec2| corner.clamp(self.origin(), end);
        [
            self.on_canvas(cut(within.min_px), canvas),
            self.on_canvas(cut(within.max_px) - 1.0, canvas),
        ]
    }

    fn on_canvas(&self, index_px: DVec2, canvas: Canvas) -> [f32; 2] {
        let shown = self.shown(canvas);
        let scale = DVec2::new(
            shown.width as f64 / f64::from(self.width),
            shown.height as f64 / f64::from(self.height),
        );
        ((index_px - self.origin()) * scale).as_vec2().to_array()
    }

    fn origin(&self) -> DVec2 {
        DVec2::new(f64::from(self.x), f64::from(self.y))
    }
}
