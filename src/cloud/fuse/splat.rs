use glam::{DVec2, Vec3};

use super::view::View;
use ostra_frames::DepthMap;

/// The depth map that a cloud would give in a view: every point as a disc of `radius` world units that faces the camera,
/// the nearest wins. It hides the far side of a surface where a frame has no depth of its own.
pub(super) fn splat_depth(points: &[Vec3], view: &View, radius: f64) -> DepthMap {
    let (width, height) = (view.camera.width, view.camera.height);
    let mut map = DepthMap {
        width,
        height,
        depths: vec![f32::INFINITY; width as usize * height as usize],
    };
    let focal = view.camera.focal_px.max_element();
    for &point in points {
        let Some(at) = view.project(point) else {
            continue;
        };
        draw_disc(
            &mut map,
            at.at_px,
            radius * focal / at.depth,
            at.depth as f32,
        );
    }
    for depth in &mut map.depths {
        *depth = if depth.is_finite() { *depth } else { 0.0 };
    }
    map
}

/// Draws the pixels whose centres lie within `radius` of `at_px`, and always the one that holds it.
fn draw_disc(map: &mut DepthMap, at_px: DVec2, radius: f64, depth: f32) {
    // A point right before the camera would cover the whole picture.
    let radius = radius.min(32.0);
    let range = |at: f64, size: u32| {
        let first = (at - radius).floor().max(0.0) as u32;
        let last = ((at + radius).floor() as u32).min(size - 1);
        first..=last
    };
    let own = (at_px.x as u32, at_px.y as u32);
    for y in range(at_px.y, map.height) {
        for x in range(at_px.x, map.width) {
            let centre = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            if (x, y) == own || centre.distance_squared(at_px) <= radius * radius {
                let there = &mut map.depths[y as usize * map.width as usize + x as usize];
                *there = there.min(depth);
            }
        }
    }
}
