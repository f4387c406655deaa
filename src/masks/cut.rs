//! Minimum cuts over windows of pixels.
//!
//! A cut separates two regions where the colours change most.

use super::lab::squared_difference;
use super::maxflow::{FlowGraph, FlowLink};

/// Capacity units per natural logarithm of odds.
const UNIT: f32 = 10_000.0;
/// Minimum price of an outline, as a share of its price on even colour.
const LEAST: f32 = 0.03;

/// A rectangle of pixels: columns `left..right`, rows `top..bottom`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PixelWindow {
    /// First column.
    pub left: usize,
    /// First row.
    pub top: usize,
    /// The column after the last one.
    pub right: usize,
    /// The row after the last one.
    pub bottom: usize,
}

impl PixelWindow {
    /// Number of columns.
    pub fn width(&self) -> usize {
        self.right - self.left
    }

    /// Number of rows.
    pub fn height(&self) -> usize {
        self.bottom - self.top
    }

    /// Returns the indices of the window's pixels in an image of this width, row by row.
    pub fn places(self, width: usize) -> impl Iterator<Item = usize> {
        (self.top..self.bottom)
            .flat_map(move |y| (self.left..self.right).map(move |x| y * width + x))
    }
}

/// Prices of an outline between the pixels of a window.
///
/// An outline costs least where colours change (Boykov, Jolly, "Interactive graph cuts", ICCV
/// 2001).
pub struct Borders {
    window: PixelWindow,
    links: Vec<FlowLink>,
}

impl Borders {
    /// Computes the prices from an image in CIE Lab that is `width` pixels wide.
    ///
    /// `weight` is the price per pixel side on even colour, as a natural logarithm of odds.
    pub fn new(lab: &[[f32; 3]], width: usize, window: PixelWindow, weight: f32) -> Self {
        let places: Vec<usize> = window.places(width).collect();
        let (width, height) = (window.width(), window.height());
        let lab = |at: usize| lab[places[at]];
        let pairs = |at: usize| {
            let right = (at % width + 1 < width).then_some((at, at + 1));
            let below = (at / width + 1 < height).then_some((at, at + width));
            [right, below].into_iter().flatten()
        };
        let pairs: Vec<(usize, usize, f32)> = (0..places.len())
            .flat_map(pairs)
            .map(|(a, b)| (a, b, squared_difference(lab(a), lab(b))))
            .collect();
        let mean = pairs.iter().map(|pair| pair.2).sum::<f32>() / pairs.len().max(1) as f32;
        let link = |&(a, b, difference): &(usize, usize, f32)| {
            let price = weight * ((-difference / (2.0 * mean + 1e-6)).exp() + LEAST) * UNIT;
            FlowLink {
                from: a as u32,
                to: b as u32,
                forward: price as i32,
                backward: price as i32,
            }
        };
        Self {
            window,
            links: pairs.iter().map(link).collect(),
        }
    }

    /// Removes the prices between pixels of the window that are not both `open`.
    ///
    /// The colour contrast is still normalised over the whole window.
    pub fn among(mut self, open: &[bool]) -> Self {
        self.links
            .retain(|link| open[link.from as usize] && open[link.to as usize]);
        self
    }

    /// Returns, for each pixel of the window, whether it is inside at minimum energy.
    ///
    /// `odds` has one value per pixel of the window; values above 0 favour inside. `bias` is added
    /// to each.
    pub fn cut(&self, odds: &[f32], bias: f32) -> Vec<bool> {
        debug_assert_eq!(odds.len(), self.window.width() * self.window.height());
        let terminal = odds
            .iter()
            .map(|odds| ((odds + bias) * UNIT) as i32)
            .collect();
        FlowGraph::new(terminal, &self.links).source_side()
    }
}
