use glam::DVec2;
use image::imageops::{FilterType, resize};
use image::{ImageBuffer, Luma};

/// A picture as a network takes it: shrunk where it is large, its last column and row repeated up to a multiple that
/// the network asks for.
#[derive(Debug, Clone, PartialEq)]
pub struct Prepared {
    /// Row by row, in 0..1.
    pub grey: Vec<f32>,
    /// Columns with the repeated ones.
    pub width: usize,
    /// Rows with the repeated ones.
    pub height: usize,
    /// Columns that show the picture.
    pub shown_width: usize,
    /// Rows that show the picture.
    pub shown_height: usize,
    /// Pixels of the picture per pixel here.
    pub original_from_here: DVec2,
}

impl Prepared {
    /// Prepares a grey picture so that its longer side has at most `max_side` pixels and both sides are multiples of
    /// `multiple`.
    #[must_use]
    pub fn new(
        grey: &[f32],
        (width, height): (usize, usize),
        max_side: usize,
        multiple: usize,
    ) -> Self {
        let scale = (max_side as f64 / width.max(height) as f64).min(1.0);
        let shrunk = |side: usize| ((side as f64 * scale).round() as usize).clamp(1, side);
        let (shown_width, shown_height) = (shrunk(width), shrunk(height));
        let small = if scale < 1.0 {
            shrink(grey, (width, height), (shown_width, shown_height))
        } else {
            None
        };
        let (padded_width, padded_height) = (
            shown_width.next_multiple_of(multiple),
            shown_height.next_multiple_of(multiple),
        );
        Self {
            grey: padded(
                small.as_deref().unwrap_or(grey),
                (shown_width, shown_height),
                (padded_width, padded_height),
            ),
            width: padded_width,
            height: padded_height,
            shown_width,
            shown_height,
            original_from_here: DVec2::new(
                width as f64 / shown_width as f64,
                height as f64 / shown_height as f64,
            ),
        }
    }
}

fn shrink(grey: &[f32], from: (usize, usize), to: (usize, usize)) -> Option<Vec<f32>> {
    let picture = ImageBuffer::<Luma<f32>, &[f32]>::from_raw(from.0 as u32, from.1 as u32, grey)?;
    Some(resize(&picture, to.0 as u32, to.1 as u32, FilterType::Triangle).into_raw())
}

fn padded(grey: &[f32], from: (usize, usize), to: (usize, usize)) -> Vec<f32> {
    let mut wide = Vec::with_capacity(to.0 * to.1);
    for row in grey.chunks_exact(from.0) {
        wide.extend_from_slice(row);
        wide.resize(wide.len() + to.0 - from.0, row[from.0 - 1]);
    }
    let last = wide.len() - to.0;
    for _ in from.1..to.1 {
        wide.extend_from_within(last..last + to.0);
    }
    wide
}
