//! Icon of the window: a cube whose sides have colours of labels.

use egui::IconData;
use glam::Vec2;

/// Width and height in pixels.
const SIZE: u32 = 128;
/// Samples per pixel along each axis.
const SAMPLES: u32 = 4;
/// Radius of the corners and of the cube, as shares of the width.
const CORNER: f32 = 0.2;
const CUBE: f32 = 0.36;

const GROUND: [u8; 3] = [30, 36, 48];
/// Colours of the top, left and right side.
const SIDES: [[u8; 3]; 3] = [[255, 140, 30], [230, 60, 200], [40, 190, 220]];

/// Draws the icon.
pub(super) fn window_icon() -> IconData {
    let mut rgba = Vec::with_capacity((SIZE * SIZE * 4) as usize);
    for y in 0..SIZE {
        for x in 0..SIZE {
            rgba.extend(pixel(x, y));
        }
    }
    IconData {
        rgba,
        width: SIZE,
        height: SIZE,
    }
}

/// Returns the colour of a pixel with straight alpha, the mean of its samples.
fn pixel(x: u32, y: u32) -> [u8; 4] {
    let (mut sum, mut count) = ([0; 3], 0);
    for step in 0..SAMPLES * SAMPLES {
        let within = Vec2::new((step % SAMPLES) as f32, (step / SAMPLES) as f32) + 0.5;
        let at = (Vec2::new(x as f32, y as f32) + within / SAMPLES as f32) / SIZE as f32;
        if let Some(color) = color_at(at - 0.5) {
            count += 1;
            for (total, channel) in sum.iter_mut().zip(color) {
                *total += u32::from(channel);
            }
        }
    }
    let [r, g, b] = sum.map(|total| (total / count.max(1)) as u8);
    [r, g, b, (255 * count / (SAMPLES * SAMPLES)) as u8]
}

/// Returns the colour at a place, which goes from -0.5 to 0.5; `None` outside the rounded square.
fn color_at(at: Vec2) -> Option<[u8; 3]> {
    let beyond = (at.abs() - Vec2::splat(0.5 - CORNER)).max(Vec2::ZERO);
    if beyond.length() > CORNER {
        return None;
    }
    Some(side_at(at / CUBE).map_or(GROUND, |side| SIDES[side]))
}

/// Returns the side of a cube of radius 1 that is seen at a place, y down.
fn side_at(at: Vec2) -> Option<usize> {
    // Edges from the front corner, in an isometric view: up left, up right and down.
    let edges = [
        Vec2::new(-0.866, -0.5),
        Vec2::new(0.866, -0.5),
        Vec2::new(0.0, 1.0),
    ];
    let sides = [(0, 1), (0, 2), (1, 2)];
    sides.iter().position(|&(a, b)| {
        let (a, b) = (edges[a], edges[b]);
        let area = a.perp_dot(b);
        let share = Vec2::new(at.perp_dot(b), a.perp_dot(at)) / area;
        let range = 0.03..0.97;
        range.contains(&share.x) && range.contains(&share.y)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn icon_shows_three_sides_on_a_rounded_square() {
        let icon = window_icon();
        assert_eq!(icon.rgba.len(), (icon.width * icon.height * 4) as usize);
        let at = |x: f32, y: f32| {
            let place = |share: f32| (share * SIZE as f32) as u32;
            let index = ((place(y) * SIZE + place(x)) * 4) as usize;
            <[u8; 4]>::try_from(&icon.rgba[index..index + 4]).unwrap()
        };
        assert_eq!(at(0.0, 0.0)[3], 0, "the corner is transparent");
        let opaque = |[r, g, b]: [u8; 3]| [r, g, b, 255];
        assert_eq!(at(0.5, 0.05), opaque(GROUND));
        assert_eq!(at(0.5, 0.32), opaque(SIDES[0]));
        assert_eq!(at(0.34, 0.58), opaque(SIDES[1]));
        assert_eq!(at(0.66, 0.58), opaque(SIDES[2]));
    }
}
