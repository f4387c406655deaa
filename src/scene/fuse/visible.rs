use super::view::Projection;
use crate::frames::DepthMap;

/// How far a point's depth may be from the depth map's at the same pixel for the point to be seen there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tolerance {
    /// In world units.
    pub(super) absolute: f64,
    /// As a share of the depth.
    pub(super) relative: f64,
}

impl Tolerance {
    fn at(self, depth: f64) -> f64 {
        self.absolute + self.relative * depth
    }
}

/// The pixel in which a depth map sees a point, if any.
///
/// That is the pixel the point falls into, or else the nearest of the eight around it: at the edge of a thin part a
/// depth that is off by a pixel would otherwise hide the part from every view.
pub(super) fn seen_at(depth: &DepthMap, point: &Projection, tolerance: Tolerance) -> Option<(u32, u32)> {
    let allowed = tolerance.at(point.depth);
    // Unknown depth is 0 and never agrees.
    let (near, far) = ((point.depth - allowed).max(f64::MIN_POSITIVE) as f32, (point.depth + allowed) as f32);
    let agrees = |x: u32, y: u32| (near..=far).contains(&depth.at(x, y));
    if agrees(point.x, point.y) {
        return Some((point.x, point.y));
    }
    let columns = point.x.saturating_sub(1)..=(point.x + 1).min(depth.width - 1);
    let rows = point.y.saturating_sub(1)..=(point.y + 1).min(depth.height - 1);
    let mut nearest: Option<(f64, (u32, u32))> = None;
    for (x, y) in rows.flat_map(|y| columns.clone().map(move |x| (x, y))) {
        if agrees(x, y) {
            let centre = glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let distance = centre.distance_squared(point.at_px);
            if nearest.is_none_or(|(best, _)| distance < best) {
                nearest = Some((distance, (x, y)));
            }
        }
    }
    nearest.map(|(_, pixel)| pixel)
}
