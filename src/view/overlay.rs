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
    /// Whether each label has a border: a light line in its colour, and a dark line around it.
    pub outlines: bool,
    /// Labels that are not drawn, including their descendants.
    pub hidden: BTreeSet<LabelId>,
    /// The only label that is drawn, including its descendants; `None` draws all.
    pub only: Option<LabelId>,
}

impl Default for OverlayStyle {
    fn default() -> Self {
        Self {
            opacity: 0.45,
            outlines: true,
            hidden: BTreeSet::new(),
            only: None,
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
            isolated: style.only,
            ..Appearance::default()
        },
    );
    let alpha = (style.opacity.clamp(0.0, 1.0) * 255.0).round() as u8;
    let width = mask.width as usize;
    let is_shown = |id: LabelId| id != LabelId::NONE && colors.get(id)[3] > 0;
    let mut pixels = vec![[0; 4]; mask.ids.len()];
    pixels
        .par_chunks_mut(width.max(1))
        .enumerate()
        .for_each(|(y, row)| {
            for (x, pixel) in row.iter_mut().enumerate() {
                let id = mask.ids[y * width + x];
                let [r, g, b, _] = colors.get(id);
                let is_border = || style.outlines && neighbours(mask, x, y).any(|near| near != id);
                *pixel = if is_shown(id) {
                    match is_border() {
                        true => opaque(outline_color([r, g, b])),
                        false => [r, g, b, alpha],
                    }
                } else if style.outlines && neighbours(mask, x, y).any(is_shown) {
                    [0, 0, 0, DARK_LINE]
                } else {
                    [0; 4]
                };
            }
        });
    pixels
}

/// Opacity of the dark line around a label.
const DARK_LINE: u8 = 230;
/// Relative luminance (WCAG 2.2) from which the light line has a contrast of 3 to a dark image.
///
/// Where the image is too bright for that, the dark line has it.
const LIGHT_LINE: f32 = 0.47;

/// Returns the colour of a label's outline: its own, mixed with white until it is light enough.
fn outline_color(color: [u8; 3]) -> [u8; 3] {
    let whiter = |share: f32| {
        color.map(|channel| {
            let channel = f32::from(channel);
            (channel + (255.0 - channel) * share).round() as u8
        })
    };
    (0..=20)
        .map(|step| whiter(step as f32 / 20.0))
        .find(|&mixed| relative_luminance(mixed) >= LIGHT_LINE)
        .unwrap_or([255; 3])
}

/// Returns the relative luminance of an sRGB colour (WCAG 2.2), 0 to 1.
#[must_use]
pub fn relative_luminance(color: [u8; 3]) -> f32 {
    let linear = |channel: u8| {
        let value = f32::from(channel) / 255.0;
        if value <= 0.04045 {
            value / 12.92
        } else {
            ((value + 0.055) / 1.055).powf(2.4)
        }
    };
    let [r, g, b] = color.map(linear);
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// Returns the contrast of two sRGB colours (WCAG 2.2), 1 to 21.
#[must_use]
pub fn contrast(a: [u8; 3], b: [u8; 3]) -> f32 {
    let (a, b) = (relative_luminance(a), relative_luminance(b));
    (a.max(b) + 0.05) / (a.min(b) + 0.05)
}

fn opaque([r, g, b]: [u8; 3]) -> [u8; 4] {
    [r, g, b, 255]
}

/// Returns the labels of the pixels left, right, above and below.
fn neighbours(mask: &LabelMask, x: usize, y: usize) -> impl Iterator<Item = LabelId> {
    let (width, height) = (mask.width as usize, mask.height as usize);
    let at = move |inside: bool, x: usize, y: usize| inside.then(|| mask.ids[y * width + x]);
    [
        at(x > 0, x.wrapping_sub(1), y),
        at(x + 1 < width, x + 1, y),
        at(y > 0, x, y.wrapping_sub(1)),
        at(y + 1 < height, x, y + 1),
    ]
    .into_iter()
    .flatten()
}

/// Colours of the stripes over conflicting regions, sRGB.
///
/// One of them stands out from any label and image.
const STRIPE_COLORS: [[u8; 3]; 2] = [[0; 3], [255; 3]];
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
        let phase = (x + y) % period;
        if is_border || phase < period / 2 {
            opaque(STRIPE_COLORS[usize::from(phase % (period / 2) >= period / 4)])
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
            only: None,
        };
        let pixels = overlay(&mask, &tree, &style);
        assert_eq!(pixels[2 * 7 + 2], [50, 0, 0, 128]);
        let [r, g, b, a] = pixels[7 + 1];
        assert!(
            a == 255 && r > g && g == b,
            "a light line in the label's hue"
        );
        assert_eq!(pixels[1], [0, 0, 0, DARK_LINE], "a dark line around it");
        assert_eq!(pixels[2 * 7 + 5][3], 0);
        assert_eq!(pixels[0][3], 0);
    }

    #[test]
    fn only_one_label_is_drawn_on_request() {
        let mut tree = LabelTree::default();
        for (id, parent) in [(1, None), (2, Some(1)), (3, None)] {
            tree.set(Label {
                id: LabelId(id),
                name: format!("l{id}"),
                color: [200, 100, 50],
                parent: parent.map(LabelId),
            })
            .unwrap();
        }
        let mut mask = LabelMask::empty(3, 1);
        mask.ids = [1, 2, 3].map(LabelId).to_vec();
        let shown = |only| {
            let style = OverlayStyle {
                outlines: false,
                only,
                ..OverlayStyle::default()
            };
            let pixels = overlay(&mask, &tree, &style);
            [0, 1, 2].map(|x: usize| pixels[x][3] > 0)
        };
        assert_eq!(shown(None), [true; 3]);
        assert_eq!(shown(Some(LabelId(1))), [true, true, false]);
        assert_eq!(shown(Some(LabelId(2))), [false, true, false]);
    }

    #[test]
    fn outlines_stand_out_from_every_image() {
        let over = |image: [u8; 3], [r, g, b, a]: [u8; 4]| {
            let share = f32::from(a) / 255.0;
            let mixed = |from: u8, to: u8| {
                (f32::from(from) * (1.0 - share) + f32::from(to) * share).round() as u8
            };
            [mixed(image[0], r), mixed(image[1], g), mixed(image[2], b)]
        };
        for label in (1..=24).map(|id| LabelTree::color_for(LabelId(id))) {
            let light = outline_color(label);
            for level in 0..=255u8 {
                for image in [[level; 3], [level, 0, 0], [0, level, 0], [level, level, 0]] {
                    let dark = over(image, [0, 0, 0, DARK_LINE]);
                    let best = contrast(image, light).max(contrast(image, dark));
                    assert!(best >= 3.0, "{label:?} on {image:?}: {best}");
                }
            }
        }
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
        for color in STRIPE_COLORS {
            assert!(pixels.contains(&super::opaque(color)), "{color:?}");
        }
        assert!((0..1200).all(|at| region.inside[at] || pixels[at] == [0; 4]));
    }
}
