//! Masks as translucent overlays on a frame's image.

use std::collections::BTreeSet;

use rayon::prelude::*;

use super::Appearance;
use super::paint::LabelColors;
use ostra_masks::{LabelId, LabelMask, LabelTree, Region};

/// How a mask is drawn over its image.
#[derive(Debug, Clone, PartialEq)]
pub struct OverlayStyle {
    /// Opacity of the label areas, 0–1.
    pub opacity: f32,
    /// Whether each label has an opaque border, one pixel wide.
    pub outlines: bool,
    /// Labels that are not drawn, including their descendants.
    pub hidden: BTreeSet<LabelId>,
}

impl Default for OverlayStyle {
    fn default() -> Self {
        Self {
            opacity: 0.45,
            outlines: true,
            hidden: BTreeSet::new(),
        }
    }
}

/// Renders a mask as `width · height` straight-alpha sRGB pixels.
#[must_use]
pub fn overlay(mask: &LabelMask, tree: &LabelTree, style: &OverlayStyle) -> Vec<[u8; 4]> {
    let colors = LabelColors::new(
        tree,
        &Appearance {
            hidden: style.hidden.clone(),
            ..Appearance::default()
        },
    );
    let alpha = (style.opacity.clamp(0.0, 1.0) * 255.0).round() as u8;
    let width = mask.width as usize;
    let mut pixels = vec![[0; 4]; mask.ids.len()];
    pixels
        .par_chunks_mut(width.max(1))
        .enumerate()
        .for_each(|(y, row)| {
            for (x, pixel) in row.iter_mut().enumerate() {
                let id = mask.ids[y * width + x];
                if id == LabelId::NONE {
                    continue;
                }
                let [r, g, b, shown] = colors.get(id);
                if shown > 0 {
                    let outlined = style.outlines && on_border(mask, x, y);
                    *pixel = [r, g, b, if outlined { 255 } else { alpha }];
                }
            }
        });
    pixels
}

fn on_border(mask: &LabelMask, x: usize, y: usize) -> bool {
    let (width, height) = (mask.width as usize, mask.height as usize);
    let id = mask.ids[y * width + x];
    let differs = |nx: usize, ny: usize| mask.ids[ny * width + nx] != id;
    (x > 0 && differs(x - 1, y))
        || (x + 1 < width && differs(x + 1, y))
        || (y > 0 && differs(x, y - 1))
        || (y + 1 < height && differs(x, y + 1))
}

/// Colour of conflicting regions, sRGB.
const COLOR: [u8; 3] = [235, 60, 50];
/// Number of stripes across the longer side of an image.
const STRIPES: u32 = 120;
/// Minimum width of a stripe with its gap, in pixels.
const LEAST_PX: u32 = 8;

/// Renders a region as stripes with a border, for drawing over an image and its masks.
///
/// Returns `width · height` straight-alpha sRGB pixels.
#[must_use]
pub fn hatch(region: &Region) -> Vec<[u8; 4]> {
    let period = (region.width.max(region.height) / STRIPES).max(LEAST_PX) as usize;
    let (width, height) = (region.width as usize, region.height as usize);
    let is_inside = |x: usize, y: usize| x < width && y < height && region.inside[y * width + x];
    let color = |(at, &inside): (usize, &bool)| {
        if !inside {
            return [0; 4];
        }
        let (x, y) = (at % width, at / width);
        let around = [
            (x.wrapping_sub(1), y),
            (x + 1, y),
            (x, y.wrapping_sub(1)),
            (x, y + 1),
        ];
        let is_border = around.into_iter().any(|(x, y)| !is_inside(x, y));
        let [r, g, b] = COLOR;
        if is_border || (x + y) % period < period / 2 {
            [r, g, b, 255]
        } else {
            [0; 4]
        }
    };
    region.inside.iter().enumerate().map(color).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ostra_masks::Label;

    #[test]
    fn areas_are_translucent_borders_opaque_and_hidden_labels_transparent() {
        let mut tree = LabelTree::default();
        for id in 1..=2 {
            tree.set(Label {
                id: LabelId(id),
                name: format!("l{id}"),
                color: [id as u8 * 50, 0, 0],
                parent: None,
            })
            .unwrap();
        }
        let mut mask = LabelMask::empty(7, 5);
        for y in 1..4 {
            for x in 1..4 {
                mask.ids[y * 7 + x] = LabelId(1);
            }
            mask.ids[y * 7 + 5] = LabelId(2);
        }
        let style = OverlayStyle {
            opacity: 0.5,
            outlines: true,
            hidden: [LabelId(2)].into(),
        };
        let pixels = overlay(&mask, &tree, &style);
        assert_eq!(pixels[2 * 7 + 2], [50, 0, 0, 128]);
        assert_eq!(pixels[7 + 1], [50, 0, 0, 255]);
        assert_eq!(pixels[2 * 7 + 5][3], 0);
        assert_eq!(pixels[0][3], 0);
    }

    #[test]
    fn only_the_region_is_striped_and_its_border_is_closed() {
        let mut region = Region::empty(40, 30);
        for y in 0..20 {
            (5..25).for_each(|x| region.inside[y * 40 + x] = true);
        }
        let pixels = hatch(&region);
        let opaque = |x: usize, y: usize| pixels[y * 40 + x][3] == 255;
        assert!(
            (0..20).all(|y| opaque(5, y) && opaque(24, y))
                && (5..25).all(|x| opaque(x, 0) && opaque(x, 19))
        );
        let stripes = (6..24).filter(|&x| opaque(x, 10)).count();
        assert!(
            (6..=12).contains(&stripes),
            "half of it shows the image: {stripes}"
        );
        assert!((0..1200).all(|at| region.inside[at] || pixels[at] == [0; 4]));
    }
}
