use std::ops::Range;

use glam::{DVec2, IVec2};

use super::Region;
use super::components::{Connectivity, components};

/// Outline of one 4-connected part of a region: closed polygons along the corners of its pixels.
///
/// Filled by the even-odd rule, the polygons give exactly the part's pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct Outline {
    /// Outer border, clockwise on screen.
    ///
    /// Corners are in pixels (0, 0 = top-left corner of the frame); the last is joined to the
    /// first.
    pub outer: Vec<DVec2>,
    /// Border of each hole, counter-clockwise on screen.
    pub holes: Vec<Vec<DVec2>>,
}

/// Traces the borders between inside and outside pixels.
///
/// Parts and holes are in the order of their first pixels.
#[must_use]
pub fn outlines(region: &Region) -> Vec<Outline> {
    let parts = components(region, Connectivity::Four);
    let mut outlines = vec![
        Outline {
            outer: Vec::new(),
            holes: Vec::new()
        };
        parts.areas.len()
    ];
    let mut walker = Walker {
        region,
        walked: vec![false; region.inside.len()],
    };
    for start in 0..region.inside.len() {
        if !walker.begins_at(start) {
            continue;
        }
        let ring = walker.walk(start);
        let outline = &mut outlines[parts.labels[start] as usize - 1];
        // A part's first pixel in row order lies on its outer border.
        if outline.outer.is_empty() {
            outline.outer = ring;
        } else {
            outline.holes.push(ring);
        }
    }
    outlines
}

impl Outline {
    /// Simplifies the outline.
    ///
    /// No removed corner lies farther than `tolerance_px` from the new border. Holes that would
    /// lose their area are dropped; returns `None` if the outer border would.
    #[must_use]
    pub fn simplified(&self, tolerance_px: f64) -> Option<Self> {
        let outer = simplified_ring(&self.outer, tolerance_px)?;
        let holes = self
            .holes
            .iter()
            .filter_map(|hole| simplified_ring(hole, tolerance_px))
            .collect();
        Some(Self { outer, holes })
    }

    /// Returns one polygon with the same even-odd filling.
    ///
    /// Each hole is joined to the ring by a seam of zero width, from its first corner to the
    /// nearest corner of the ring.
    #[must_use]
    pub fn keyhole(&self) -> Vec<DVec2> {
        let mut ring = self.outer.clone();
        for hole in &self.holes {
            let Some(&seam) = hole.first() else { continue };
            let off = |&at: &usize| ring[at].distance_squared(seam);
            let at = (0..ring.len())
                .min_by(|a, b| off(a).total_cmp(&off(b)))
                .unwrap_or(0);
            let there = ring[..=at].iter().chain(hole);
            let joined = there.chain([&seam]).chain(&ring[at..]).copied().collect();
            ring = joined;
        }
        ring
    }
}

/// Simplifies a closed polygon.
///
/// Douglas, Peucker, "Algorithms for the reduction of the number of points required to represent a
/// digitized line", Cartographica, 1973. The polygon is split at its first corner and the corner
/// farthest from it. Returns `None` if fewer than three corners remain.
#[must_use]
pub fn simplified_ring(ring: &[DVec2], tolerance_px: f64) -> Option<Vec<DVec2>> {
    let first = *ring.first()?;
    let far = (0..ring.len())
        .max_by(|&a, &b| first.distance(ring[a]).total_cmp(&first.distance(ring[b])))?;
    let mut closed = ring.to_vec();
    closed.push(first);
    let mut kept = vec![false; closed.len()];
    (kept[0], kept[far]) = (true, true);
    keep_corners(&closed, 0..far, tolerance_px, &mut kept);
    keep_corners(&closed, far..ring.len(), tolerance_px, &mut kept);
    let corners: Vec<DVec2> = ring
        .iter()
        .zip(&kept)
        .filter(|(_, kept)| **kept)
        .map(|(&corner, _)| corner)
        .collect();
    (corners.len() >= 3).then_some(corners)
}

/// Marks the corners that a simplified line keeps between its corners at the ends of `part`.
fn keep_corners(line: &[DVec2], part: Range<usize>, tolerance_px: f64, kept: &mut [bool]) {
    let mut open = vec![(part.start, part.end)];
    while let Some((from, to)) = open.pop() {
        let off = |&at: &usize| distance_to_segment(line[at], line[from], line[to]);
        let Some(farthest) = (from + 1..to).max_by(|a, b| off(a).total_cmp(&off(b))) else {
            continue;
        };
        if off(&farthest) > tolerance_px {
            kept[farthest] = true;
            open.extend([(from, farthest), (farthest, to)]);
        }
    }
}

/// Returns the distance of a point to the segment from `a` to `b`.
pub(super) fn distance_to_segment(point: DVec2, a: DVec2, b: DVec2) -> f64 {
    point.distance(nearest_on_segment(point, a, b))
}

/// Returns the point of the segment from `a` to `b` that is nearest to a point.
pub(super) fn nearest_on_segment(point: DVec2, a: DVec2, b: DVec2) -> DVec2 {
    let along = b - a;
    let length2 = along.length_squared();
    let share = if length2 > 0.0 {
        ((point - a).dot(along) / length2).clamp(0.0, 1.0)
    } else {
        0.0
    };
    a + share * along
}

/// Walks along pixel corners with the inside on the right.
struct Walker<'a> {
    region: &'a Region,
    /// Whether the upper side of each pixel has been walked.
    walked: Vec<bool>,
}

impl Walker<'_> {
    fn begins_at(&self, pixel: usize) -> bool {
        let above = pixel.checked_sub(self.region.width as usize);
        self.region.inside[pixel]
            && !self.walked[pixel]
            && above.is_none_or(|above| !self.region.inside[above])
    }

    fn inside(&self, pixel: IVec2) -> bool {
        let (width, height) = (self.region.width as i32, self.region.height as i32);
        (0..width).contains(&pixel.x)
            && (0..height).contains(&pixel.y)
            && self.region.at(pixel.x as u32, pixel.y as u32)
    }

    /// Returns the ring that starts with the upper side of a pixel; corners only where it turns.
    fn walk(&mut self, pixel: usize) -> Vec<DVec2> {
        let width = self.region.width as usize;
        let start = IVec2::new((pixel % width) as i32, (pixel / width) as i32);
        let (mut corner, mut heading) = (start, IVec2::X);
        let mut ring = Vec::new();
        loop {
            if heading == IVec2::X {
                self.walked[corner.y as usize * width + corner.x as usize] = true;
            }
            corner += heading;
            let next = self.turned(corner, heading);
            if next != heading {
                ring.push(corner.as_dvec2());
                heading = next;
            }
            if corner == start && heading == IVec2::X {
                return ring;
            }
        }
    }

    /// Returns the next direction at a corner.
    ///
    /// Turns right if the pixel ahead on the right is outside, so that diagonal neighbours stay
    /// separate; otherwise goes straight on or left.
    fn turned(&self, corner: IVec2, heading: IVec2) -> IVec2 {
        let right = IVec2::new(-heading.y, heading.x);
        // The pixel that touches `corner` on the side of `heading + side`.
        let ahead = |side: IVec2| corner + (heading + side - IVec2::ONE) / 2;
        if !self.inside(ahead(right)) {
            right
        } else if self.inside(ahead(-right)) {
            -right
        } else {
            heading
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::fill_polygons;

    fn region(rows: &[&str]) -> Region {
        let inside = rows
            .iter()
            .flat_map(|row| row.bytes().map(|byte| byte == b'#'))
            .collect();
        Region {
            width: rows[0].len() as u32,
            height: rows.len() as u32,
            inside,
        }
    }

    fn signed_area(ring: &[DVec2]) -> f64 {
        let next = ring.iter().cycle().skip(1);
        ring.iter()
            .zip(next)
            .map(|(a, b)| a.perp_dot(*b))
            .sum::<f64>()
            / 2.0
    }

    #[test]
    fn outlines_of_a_ring_and_a_single_pixel() {
        let found = outlines(&region(&["####.", "#..#.", "####.", "....#"]));
        assert_eq!(found.len(), 2);
        let corners = |ring: &[DVec2]| {
            ring.iter()
                .map(|p| (p.x as i32, p.y as i32))
                .collect::<Vec<_>>()
        };
        assert_eq!(corners(&found[0].outer), [(4, 0), (4, 3), (0, 3), (0, 0)]);
        assert_eq!(found[0].holes.len(), 1);
        assert!((signed_area(&found[0].outer) - 12.0).abs() < 1e-9);
        assert!((signed_area(&found[0].holes[0]) + 2.0).abs() < 1e-9);
        assert_eq!(corners(&found[1].outer), [(5, 3), (5, 4), (4, 4), (4, 3)]);
    }

    #[test]
    fn steps_within_the_tolerance_are_removed() {
        let stairs = outlines(&region(&["#.....", "###...", "#####.", "######"]));
        let simple = stairs[0].simplified(1.1).unwrap();
        assert!(
            simple.outer.len() <= 4 && stairs[0].outer.len() > 6,
            "{simple:?}"
        );
        assert!(
            outlines(&region(&["#"]))[0].simplified(5.0).is_none(),
            "nothing of it remains"
        );
    }

    fn regions() -> impl Strategy<Value = Region> {
        (1u32..14, 1u32..14).prop_flat_map(|(width, height)| {
            prop::collection::vec(prop::bool::weighted(0.6), (width * height) as usize).prop_map(
                move |inside| Region {
                    width,
                    height,
                    inside,
                },
            )
        })
    }

    proptest! {
        #[test]
        fn filled_outlines_equal_the_region(region in regions()) {
            let found = outlines(&region);
            let rings: Vec<Vec<DVec2>> =
                found.iter().flat_map(|outline| outline.holes.iter().chain([&outline.outer])).cloned().collect();
            prop_assert_eq!(&fill_polygons(region.width, region.height, &rings).unwrap(), &region);
            let area: f64 = rings.iter().map(|ring| signed_area(ring)).sum();
            prop_assert!((area - region.area() as f64).abs() < 1e-9);
            for outline in &found {
                prop_assert!(signed_area(&outline.outer) > 0.0);
                prop_assert!(outline.holes.iter().all(|hole| signed_area(hole) < 0.0));
            }
        }

        #[test]
        fn filled_keyholes_equal_the_region(region in regions()) {
            let mut all = Region::empty(region.width, region.height);
            for outline in outlines(&region) {
                all.unite(&fill_polygons(region.width, region.height, &[outline.keyhole()]).unwrap());
            }
            prop_assert_eq!(all, region);
        }

        #[test]
        fn simplified_rings_stay_within_the_tolerance(region in regions(), tolerance in 0.0f64..3.0) {
            for outline in outlines(&region) {
                let Some(simple) = simplified_ring(&outline.outer, tolerance) else { continue };
                for corner in &outline.outer {
                    let sides = simple.iter().zip(simple.iter().cycle().skip(1));
                    let off = sides.map(|(a, b)| distance_to_segment(*corner, *a, *b)).fold(f64::INFINITY, f64::min);
                    prop_assert!(off <= tolerance + 1e-9);
                }
            }
        }
    }
}
