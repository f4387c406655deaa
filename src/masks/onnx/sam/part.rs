use glam::DVec2;

use crate::{Prompt, PxBox, Region};

/// The square that the networks see a part of a picture on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Canvas {
    /// Pixels along each side.
    pub side: usize,
    /// Whether a part fills all of it, whatever its shape; else its longer side does, with nothing right and below.
    pub is_filled: bool,
}

/// The part of a picture that the network looks at, in whole pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Part {
    /// First column.
    pub x: u32,
    /// First row.
    pub y: u32,
    /// Columns, at least one.
    pub width: u32,
    /// Rows, at least one.
    pub height: u32,
}

/// Room around the prompt of a close-up, as a share of the prompt's extent.
const ROOM: f64 = 1.0;
/// A close-up is at least this share of the network's side, in pixels: more enlargement shows nothing more.
const LEAST_SHARE: f64 = 0.25;

impl Part {
    /// All of a picture.
    #[must_use]
    pub fn whole(width: u32, height: u32) -> Self {
        Self {
            x: 0,
            y: 0,
            width,
            height,
        }
    }

    /// The square around a prompt, for things too thin for the whole picture at the network's `side` of pixels: with
    /// room around it, inside the picture; `None` for an empty prompt, or where the whole picture is hardly larger.
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

    /// Whether it lies within a picture and holds a pixel.
    pub(super) fn is_within(&self, width: u32, height: u32) -> bool {
        let fits = |first: u32, count: u32, all: u32| {
            count > 0 && first.checked_add(count).is_some_and(|end| end <= all)
        };
        fits(self.x, self.width, width) && fits(self.y, self.height, height)
    }

    /// Whether a position in pixels of the picture falls on one of its pixels.
    pub(super) fn holds(&self, at_px: DVec2) -> bool {
        let at = at_px - self.origin();
        at.x >= 0.0 && at.y >= 0.0 && at.x < f64::from(self.width) && at.y < f64::from(self.height)
    }

    /// Its pixels in a picture.
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

    /// Columns and rows that it takes of the network's square.
    pub(super) fn shown(&self, canvas: Canvas) -> (usize, usize) {
        let side = canvas.side;
        if canvas.is_filled {
            return (side, side);
        }
        let scale = side as f64 / f64::from(self.width.max(self.height));
        let shown = |count: u32| ((f64::from(count) * scale + 0.5) as usize).max(1);
        (shown(self.width), shown(self.height))
    }

    /// A click as the network takes it: in pixels of its square, counted from the middle of the first.
    pub(super) fn canvas_point(&self, at_px: DVec2, canvas: Canvas) -> [f32; 2] {
        self.on_canvas(at_px - 0.5, canvas)
    }

    /// The corners of a box, cut to the part, as the network takes them: the middles of its first and of its last pixel.
    pub(super) fn canvas_corners(&self, within: &PxBox, canvas: Canvas) -> [[f32; 2]; 2] {
        let end = self.origin() + DVec2::new(self.width.into(), self.height.into());
        let cut = |corner: DVec2| corner.clamp(self.origin(), end);
        [
            self.on_canvas(cut(within.min_px), canvas),
            self.on_canvas(cut(within.max_px) - 1.0, canvas),
        ]
    }

    fn on_canvas(&self, index_px: DVec2, canvas: Canvas) -> [f32; 2] {
        let (columns, rows) = self.shown(canvas);
        let scale = DVec2::new(
            columns as f64 / f64::from(self.width),
            rows as f64 / f64::from(self.height),
        );
        ((index_px - self.origin()) * scale).as_vec2().to_array()
    }

    fn origin(&self) -> DVec2 {
        DVec2::new(f64::from(self.x), f64::from(self.y))
    }
}
