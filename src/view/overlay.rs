use std::collections::BTreeSet;

use rayon::prelude::*;

use super::Appearance;
use super::label_colors::LabelColors;
use ostra_masks::{LabelId, LabelMask, LabelTree};

/// How a mask lies over its picture.
#[derive(Debug, Clone, PartialEq)]
pub struct OverlayStyle {
    /// Opacity of the areas, 0–1.
    pub opacity: f32,
    /// Draw each label's border one pixel wide, opaque.
    pub outlines: bool,
    /// Labels (with all below them) that are not drawn.
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

/// The mask as `width · height` straight-alpha sRGB pixels, to be laid over the picture.
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

#[cfg(test)]
mod tests {
    use super::*;
    use ostra_masks::Label;

    #[test]
    fn areas_are_translucent_borders_opaque_hidden_labels_gone() {
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
}
