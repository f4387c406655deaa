use super::view::Projection;
use ostra_frames::DepthMap;

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
/// That is the pixel the point falls into. Where that pixel has no depth or one behind the point, the nearest of the
/// eight around it that agrees: at the edge of a thin part, a depth or pose that is off by a pixel would otherwise hide
/// the part from every view. Where the pixel's depth is before the point, something hides it.
pub(super) fn seen_at(
    depth: &DepthMap,
    point: &Projection,
    tolerance: Tolerance,
) -> Option<(u32, u32)> {
    let allowed = tolerance.at(point.depth);
    // Unknown depth is 0 and never agrees.
    let (near, far) = (
        (point.depth - allowed).max(f64::MIN_POSITIVE) as f32,
        (point.depth + allowed) as f32,
    );
    let agrees = |x: u32, y: u32| (near..=far).contains(&depth.at(x, y));
    if agrees(point.x, point.y) {
        return Some((point.x, point.y));
    }
    let own = depth.at(point.x, point.y);
    if own > 0.0 && own < near {
        return None;
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

#[cfg(test)]
mod tests {
    use super::*;

    const TOLERANCE: Tolerance = Tolerance {
        absolute: 0.0,
        relative: 0.01,
    };

    /// Three by three pixels, all at depth 2 but the given ones.
    fn map(others: &[(usize, f32)]) -> DepthMap {
        let mut depths = vec![2.0; 9];
        others
            .iter()
            .for_each(|&(index, depth)| depths[index] = depth);
        DepthMap {
            width: 3,
            height: 3,
            depths,
        }
    }

    fn at(x: f64, y: f64, depth: f64) -> Projection {
        Projection {
            at_px: glam::DVec2::new(x, y),
            x: x as u32,
            y: y as u32,
            depth,
        }
    }

    #[test]
    fn own_pixel_first_then_the_nearest_that_agrees() {
        assert_eq!(
            seen_at(&map(&[]), &at(1.5, 1.5, 2.01), TOLERANCE),
            Some((1, 1))
        );
        assert_eq!(
            seen_at(&map(&[(3, 1.0), (5, 1.0)]), &at(1.6, 1.5, 1.0), TOLERANCE),
            Some((2, 1))
        );
        assert_eq!(
            seen_at(&map(&[(4, 0.0)]), &at(1.1, 1.4, 2.0), TOLERANCE),
            Some((0, 1))
        );
        assert_eq!(seen_at(&map(&[]), &at(1.5, 1.5, 1.0), TOLERANCE), None);
        assert_eq!(
            seen_at(&map(&[]), &at(2.9, 0.1, 2.0), TOLERANCE),
            Some((2, 0))
        );
    }

    #[test]
    fn what_is_hidden_is_not_seen_past_the_edge_of_what_hides_it() {
        assert_eq!(
            seen_at(&map(&[(4, 1.0)]), &at(1.5, 1.5, 2.0), TOLERANCE),
            None
        );
        assert_eq!(
            seen_at(&map(&[(4, 3.0)]), &at(1.5, 1.5, 2.0), TOLERANCE),
            Some((1, 0))
        );
    }
}
