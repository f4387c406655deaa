use glam::DVec2;

use super::polygon::{check_points, columns_between};
use crate::{MaskError, Region};

/// Smallest brush radius that leaves no gaps between pixels.
const MIN_RADIUS_PX: f64 = 0.5;

/// Returns the pixels under a brush drawn along a polyline with round ends and joints.
///
/// These are the pixels whose centre is at most `radius_px` from the line, and the pixels that
/// contain one of its points. A radius below 0.5 is raised to 0.5. Points are in pixels and may lie
/// outside the frame.
///
/// # Errors
/// [`MaskError::Request`] when there is no point, a point or the radius is not finite, or the
/// radius is not positive.
pub fn stroke(
    width: u32,
    height: u32,
    points_px: &[DVec2],
    radius_px: f64,
) -> Result<Region, MaskError> {
    check_points(points_px)?;
    if points_px.is_empty() || !radius_px.is_finite() || radius_px <= 0.0 {
        return Err(MaskError::Request(
            "a stroke needs at least one point and a radius above 0".into(),
        ));
    }
    let radius = radius_px.max(MIN_RADIUS_PX);
    let mut region = Region::empty(width, height);
    for &point in points_px {
        touch(&mut region, point);
    }
    draw_capsule(&mut region, points_px[0], points_px[0], radius);
    for ends in points_px.windows(2) {
        draw_capsule(&mut region, ends[0], ends[1], radius);
    }
    Ok(region)
}

fn touch(region: &mut Region, point: DVec2) {
    let (x, y) = (point.x.floor(), point.y.floor());
    if x >= 0.0 && y >= 0.0 && x < f64::from(region.width) && y < f64::from(region.height) {
        region.inside[y as usize * region.width as usize + x as usize] = true;
    }
}

/// Marks all pixels whose centre is at most `radius` from the segment.
///
/// A capsule is convex, so each row contains one run of it.
fn draw_capsule(region: &mut Region, a: DVec2, b: DVec2, radius: f64) {
    let top = (a.y.min(b.y) - radius - 0.5)
        .ceil()
        .clamp(0.0, f64::from(region.height)) as usize;
    let bottom = (a.y.max(b.y) + radius + 0.5)
        .floor()
        .clamp(0.0, f64::from(region.height)) as usize;
    let width = region.width as usize;
    for row in top..bottom {
        let y = row as f64 + 0.5;
        let parts = [
            disk_at(a, radius, y),
            disk_at(b, radius, y),
            band_at(a, b, radius, y),
        ];
        let Some((left, right)) = parts
            .into_iter()
            .flatten()
            .reduce(|m, n| (m.0.min(n.0), m.1.max(n.1)))
        else {
            continue;
        };
        let columns = columns_between(left, right, width);
        region.inside[row * width..][..width][columns].fill(true);
    }
}

/// Returns the interval of the line at height `y` that lies inside a disk.
fn disk_at(center: DVec2, radius: f64, y: f64) -> Option<(f64, f64)> {
    let off = y - center.y;
    let half = radius * radius - off * off;
    (half >= 0.0).then(|| (center.x - half.sqrt(), center.x + half.sqrt()))
}

/// Returns the interval of the line at height `y` that is within `radius` of the segment.
///
/// The round ends beyond the segment are not part of it.
fn band_at(a: DVec2, b: DVec2, radius: f64, y: f64) -> Option<(f64, f64)> {
    let length = a.distance(b);
    if length == 0.0 {
        return None;
    }
    let along = (b - a) / length;
    let off = y - a.y;
    // With u = x − a.x, the position along the segment is along.x·u + along.y·off, in 0..length.
    // The distance from its line is along.y·u − along.x·off.
    let adjacent_to_ends = between(along.x, along.y * off, 0.0, length)?;
    let adjacent_to_line = between(along.y, -along.x * off, -radius, radius)?;
    let (left, right) = (
        adjacent_to_ends.0.max(adjacent_to_line.0),
        adjacent_to_ends.1.min(adjacent_to_line.1),
    );
    (left <= right).then_some((a.x + left, a.x + right))
}

/// Returns all u with `slope · u + offset` in `low..=high`; `None` when there are none.
fn between(slope: f64, offset: f64, low: f64, high: f64) -> Option<(f64, f64)> {
    if slope == 0.0 {
        return (low..=high)
            .contains(&offset)
            .then_some((f64::NEG_INFINITY, f64::INFINITY));
    }
    let (first, second) = ((low - offset) / slope, (high - offset) / slope);
    Some((first.min(second), first.max(second)))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::components::{Connectivity, components};
    use crate::outline::distance_to_segment;

    fn points() -> impl Strategy<Value = Vec<DVec2>> {
        prop::collection::vec(
            (-5.0f64..35.0, -5.0f64..25.0).prop_map(|(x, y)| DVec2::new(x, y)),
            1..5,
        )
    }

    proptest! {
        #[test]
        fn stroke_holds_exactly_the_pixels_within_the_radius(points in points(), radius in 0.6f64..8.0) {
            let region = stroke(30, 20, &points, radius).unwrap();
            for y in 0..20 {
                for x in 0..30 {
                    let center = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                    let to = |ends: &[DVec2]| distance_to_segment(center, ends[0], ends[ends.len() - 1]);
                    let lines = points.windows(2).map(to).chain(points.chunks(1).map(to));
                    let off = lines.fold(f64::INFINITY, f64::min);
                    let holds_point = points.iter().any(|p| p.floor() == center.floor());
                    if (off - radius).abs() > 1e-6 && !holds_point {
                        prop_assert_eq!(region.at(x, y), off <= radius, "{},{}: {}", x, y, off);
                    }
                }
            }
        }

        #[test]
        fn thinnest_stroke_has_no_gaps(x0 in 1.0f64..29.0, y0 in 1.0f64..19.0, x1 in 1.0f64..29.0, y1 in 1.0f64..19.0) {
            let region = stroke(30, 20, &[DVec2::new(x0, y0), DVec2::new(x1, y1)], 0.01).unwrap();
            prop_assert_eq!(components(&region, Connectivity::Eight).areas.len(), 1);
            prop_assert!(region.at(x0 as u32, y0 as u32) && region.at(x1 as u32, y1 as u32));
        }
    }

    #[test]
    fn invalid_strokes_are_rejected() {
        assert!(stroke(9, 9, &[], 2.0).is_err());
        assert!(stroke(9, 9, &[DVec2::splat(f64::NAN)], 2.0).is_err());
        assert!(stroke(9, 9, &[DVec2::ZERO], 0.0).is_err());
        assert!(stroke(9, 9, &[DVec2::ZERO], f64::INFINITY).is_err());
        assert!(stroke(9, 9, &[DVec2::splat(1e300), DVec2::splat(-1e300)], 1.0).is_ok());
        assert_eq!(
            stroke(9, 9, &[DVec2::splat(4.5)], 100.0).unwrap().area(),
            81
        );
    }
}
