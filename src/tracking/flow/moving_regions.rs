use std::sync::Arc;

use glam::Vec2;

use super::change::FrameChange;
use super::dis::Finest;
use super::options::FlowOptions;
use super::plane::Plane;
use super::tracked_image::{TrackedImage, enlarged_mask, reduced_mask, working_size};
use ostra_frames::Image;
use ostra_masks::unexplained::{Apartness, Unexplained, explained, parts};
use ostra_masks::{LabelId, LabelMask, Region};

/// Minimum motion relative to the background, in pixels of the working size.
const LEAST_PX: f32 = 1.5;
/// Minimum motion as a multiple of the residual of the background motion.
const LEAST_NOISES: f32 = 5.0;
/// Minimum forward-backward consistency of the flow.
const LEAST_RELIABLE: f32 = 0.3;

/// Finds unlabelled regions that move differently from the background.
///
/// `other` is an image of the same size, a few frames away.
#[must_use]
pub fn moving_apart(
    image: &Image,
    other: &Image,
    mask: &LabelMask,
    options: &FlowOptions,
) -> Vec<Unexplained> {
    let sized = |image: &Image| (image.width, image.height) == (mask.width, mask.height);
    if !(sized(image) && sized(other)) {
        return Vec::new();
    }
    let size = working_size(mask.width, mask.height, options.most_side);
    let known = explained(&reduced_mask(mask, size));
    let mut change = FrameChange::new(
        Arc::new(TrackedImage::new(other, size)),
        Arc::new(TrackedImage::new(image, size)),
        Finest::Half,
    );
    change.find_background(&[&Plane::of_mask(size.width, size.height, &known.inside)]);
    let Some(background) = change.background else {
        return Vec::new();
    };
    let least = LEAST_PX.max(LEAST_NOISES * change.background_noise);
    let against = Plane::from_fn(size.width, size.height, |x, y| {
        let at = Vec2::new(x as f32, y as f32);
        let trusted = change.reliable.values[y * size.width + x] >= LEAST_RELIABLE;
        if trusted {
            change
                .backward
                .at(x, y)
                .distance(background.displacement(at))
        } else {
            0.0
        }
    });
    let moves = against
        .values
        .iter()
        .zip(&known.inside)
        .map(|(&motion, &known)| motion >= least && !known)
        .collect();
    let moving = Region {
        width: size.width as u32,
        height: size.height as u32,
        inside: moves,
    };
    let solid = moving.dilated(2.0).eroded(4.0).dilated(2.0);
    let strength = |part: &Region| {
        let inside = against
            .values
            .iter()
            .zip(&part.inside)
            .filter(|(_, inside)| **inside);
        inside.map(|(&motion, _)| motion / least).sum::<f32>() / part.inside.len() as f32
    };
    let at_full_size = |part: &Region| {
        let ids = part
            .inside
            .iter()
            .map(|&inside| LabelId(u16::from(inside)))
            .collect();
        let mask = LabelMask {
            width: part.width,
            height: part.height,
            ids,
        };
        enlarged_mask(&mask, image.width, image.height).region(LabelId(1))
    };
    let found = parts(&solid).map(|part| Unexplained {
        why: Apartness::Moves,
        strength: strength(&part),
        region: at_full_size(&part),
    });
    found.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Draws a textured background that slides, and a textured box with its own motion.
    fn image(shift: i32, box_at: (i32, i32)) -> Image {
        let grain = |x: i32, y: i32, salt: i32| {
            let cell = (x / 5)
                .wrapping_mul(7_349)
                .wrapping_add((y / 5).wrapping_mul(9_151))
                .wrapping_add(salt);
            (cell.wrapping_mul(cell) >> 7 & 127) as u8
        };
        let pixels = (0..240 * 320).map(|at| {
            let (x, y) = (at % 320, at / 320);
            let (u, v) = (x - box_at.0, y - box_at.1);
            let inside = (0..60).contains(&u) && (0..50).contains(&v);
            let value = if inside {
                90 + grain(u, v, 5)
            } else {
                grain(x + 1000 + shift, y + 500, 0)
            };
            [value, value, if inside { 255 - value } else { value }]
        });
        Image {
            width: 320,
            height: 240,
            pixels: pixels.collect(),
        }
    }

    #[test]
    fn independently_moving_region_is_found_unless_labelled() {
        let (now, later) = (image(0, (120, 90)), image(3, (128, 96)));
        let mut mask = LabelMask::empty(320, 240);
        let found = moving_apart(&now, &later, &mask, &FlowOptions::default());
        assert_eq!(
            found.len(),
            1,
            "{:?}",
            found
                .iter()
                .map(|one| one.region.area())
                .collect::<Vec<_>>()
        );
        let inside = |x: usize, y: usize| (120..180).contains(&x) && (90..140).contains(&y);
        let truth = Region {
            width: 320,
            height: 240,
            inside: (0..320 * 240)
                .map(|at| inside(at % 320, at / 320))
                .collect(),
        };
        let iou = found[0].region.iou(&truth);
        assert!(iou > 0.7, "{iou}");
        for (id, _) in mask
            .ids
            .iter_mut()
            .zip(&truth.inside)
            .filter(|(_, inside)| **inside)
        {
            *id = LabelId(1);
        }
        assert!(moving_apart(&now, &later, &mask, &FlowOptions::default()).is_empty());
        assert!(
            moving_apart(
                &now,
                &image(3, (120 - 3, 90)),
                &LabelMask::empty(320, 240),
                &FlowOptions::default()
            )
            .is_empty()
        );
    }
}
