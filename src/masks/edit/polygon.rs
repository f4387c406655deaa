use std::ops::Range;

use glam::DVec2;

use crate::{MaskError, Region};

/// Returns the pixels whose centres lie inside closed polygons.
///
/// The even-odd rule applies to all polygons together, so a ring inside another is a hole. Corners
/// are in pixels and may lie outside the frame. A pixel centre exactly on a side belongs to the
/// area to the right of or below that side.
///
/// # Errors
/// [`MaskError::Request`] when a corner is not finite.
pub fn fill_polygons(width: u32, height: u32, rings: &[Vec<DVec2>]) -> Result<Region, MaskError> {
    let mut region = Region::empty(width, height);
    polygon_spans(width, height, rings, |pixels| {
        region.inside[pixels].fill(true);
    })?;
    Ok(region)
}

/// Emits the pixel ranges that [`fill_polygons`] fills.
///
/// Ranges are indices into the frame's pixels, row by row. Only rows that the polygons reach are
/// visited.
///
/// # Errors
/// As [`fill_polygons`].
pub fn polygon_spans(
    width: u32,
    height: u32,
    rings: &[Vec<DVec2>],
    mut emit: impl FnMut(Range<usize>),
) -> Result<(), MaskError> {
    for (row, crossings) in crossings(width, height, rings)? {
        for pair in crossings.chunks_exact(2) {
            emit(row.between(pair[0].at, pair[1].at));
        }
    }
    Ok(())
}

/// Emits the pixel ranges that a closed polygon goes around, with the winding number.
///
/// The number is positive for counter-clockwise turns as displayed, and negative for clockwise
/// ones.
///
/// # Errors
/// As [`fill_polygons`].
pub(crate) fn winding_spans(
    width: u32,
    height: u32,
    ring: &[DVec2],
    mut emit: impl FnMut(Range<usize>, i32),
) -> Result<(), MaskError> {
    for (row, crossings) in crossings(width, height, &[ring])? {
        let mut turns = 0;
        for pair in crossings.windows(2) {
            turns += pair[0].turn;
            if turns != 0 {
                emit(row.between(pair[0].at, pair[1].at), turns);
            }
        }
    }
    Ok(())
}

/// A row of pixels.
struct PixelRow {
    start: usize,
    width: usize,
}

impl PixelRow {
    /// Returns the indices of its pixels whose centres lie between two x coordinates.
    fn between(&self, left: f64, right: f64) -> Range<usize> {
        self.start + first_from(left, self.width)..self.start + first_from(right, self.width)
    }
}

/// Crossing of a polygon side with the line through the pixel centres of a row.
struct Crossing {
    at: f64,
    /// 1 where the side goes down as displayed, -1 where it goes up.
    turn: i32,
}

/// Returns each row that the polygons reach, with its crossings from left to right.
fn crossings<R: AsRef<[DVec2]>>(
    width: u32,
    height: u32,
    rings: &[R],
) -> Result<impl Iterator<Item = (PixelRow, Vec<Crossing>)> + use<R>, MaskError> {
    let (width, height) = (width as usize, height as usize);
    rings
        .iter()
        .try_for_each(|ring| check_points(ring.as_ref()))?;
    let heights = || rings.iter().flat_map(AsRef::as_ref).map(|corner| corner.y);
    let top = first_from(heights().fold(f64::INFINITY, f64::min), height);
    let bottom = first_from(heights().fold(f64::NEG_INFINITY, f64::max), height);
    let mut crossings: Vec<Vec<Crossing>> = Vec::new();
    crossings.resize_with(bottom.saturating_sub(top), Vec::new);
    for ring in rings.iter().map(AsRef::as_ref) {
        for (at, &corner) in ring.iter().enumerate() {
            add_crossings(&mut crossings, top, corner, ring[(at + 1) % ring.len()]);
        }
    }
    Ok((top..).zip(crossings).map(move |(row, mut crossings)| {
        crossings.sort_unstable_by(|a, b| a.at.total_cmp(&b.at));
        (
            PixelRow {
                start: row * width,
                width,
            },
            crossings,
        )
    }))
}

/// Fails when a coordinate is not finite.
pub(super) fn check_points(points: &[DVec2]) -> Result<(), MaskError> {
    if points.iter().all(|point| point.is_finite()) {
        return Ok(());
    }
    Err(MaskError::Request(
        "a point of the drawing is not a number; draw it again".into(),
    ))
}

/// Returns the columns of the pixels whose centres lie in `left..=right`.
pub(super) fn columns_between(left: f64, right: f64, width: usize) -> Range<usize> {
    let start = first_from(left, width);
    let end = (right + 0.5).floor().clamp(0.0, width as f64) as usize;
    start..end.max(start)
}

/// Returns the first of `count` columns (or rows) whose pixel centre is at `edge` or beyond.
fn first_from(edge: f64, count: usize) -> usize {
    (edge - 0.5).ceil().clamp(0.0, count as f64) as usize
}

/// Adds the crossings of a side with the rows from `top` on.
///
/// The lower end of a side is excluded, so that a corner on the line counts once.
fn add_crossings(crossings: &mut [Vec<Crossing>], top: usize, from: DVec2, to: DVec2) {
    // Both directions of a side use the same order, so that a seam followed there and back cancels
    // exactly.
    let (a, b, turn) = if (from.y, from.x) <= (to.y, to.x) {
        (from, to, 1)
    } else {
        (to, from, -1)
    };
    let bottom = top + crossings.len();
    for row in first_from(a.y, bottom)..first_from(b.y, bottom) {
        let share = (row as f64 + 0.5 - a.y) / (b.y - a.y);
        crossings[row - top].push(Crossing {
            at: a.x + share * (b.x - a.x),
            turn,
        });
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn rectangle(x0: f64, y0: f64, x1: f64, y1: f64) -> Vec<DVec2> {
        [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
            .map(|(x, y)| DVec2::new(x, y))
            .to_vec()
    }

    #[test]
    fn ring_inside_another_is_a_hole() {
        let region = fill_polygons(
            8,
            6,
            &[rectangle(1.0, 1.0, 7.0, 5.0), rectangle(3.0, 2.0, 5.0, 4.0)],
        )
        .unwrap();
        assert_eq!(region.area(), 24 - 4);
        assert!(region.at(1, 1) && region.at(6, 4) && !region.at(3, 2) && !region.at(7, 5));
    }

    #[test]
    fn pixels_are_filled_by_their_centres() {
        assert_eq!(
            fill_polygons(4, 1, &[rectangle(0.6, 0.0, 2.4, 1.0)])
                .unwrap()
                .inside,
            [false, true, false, false]
        );
        assert_eq!(
            fill_polygons(4, 1, &[rectangle(0.5, 0.0, 2.5, 1.0)])
                .unwrap()
                .inside,
            [true, true, false, false]
        );
        assert_eq!(
            fill_polygons(4, 4, &[rectangle(-1e9, -1e9, 1e9, 1e9)])
                .unwrap()
                .area(),
            16
        );
        assert!(
            fill_polygons(4, 4, &[vec![DVec2::ZERO, DVec2::X]])
                .unwrap()
                .is_empty()
        );
        assert!(fill_polygons(4, 4, &[vec![DVec2::splat(f64::NAN)]]).is_err());
    }

    proptest! {
        #[test]
        fn filling_matches_the_even_odd_rule(
            corners in prop::collection::vec((-3.0f64..15.0, -3.0f64..13.0).prop_map(|(x, y)| DVec2::new(x, y)), 3..9),
        ) {
            let region = fill_polygons(12, 10, std::slice::from_ref(&corners)).unwrap();
            for y in 0..10 {
                for x in 0..12 {
                    let p = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                    let sides = corners.iter().zip(corners.iter().cycle().skip(1));
                    let crossed = sides.filter(|(a, b)| {
                        (a.y > p.y) != (b.y > p.y) && p.x < (b.x - a.x) * (p.y - a.y) / (b.y - a.y) + a.x
                    });
                    prop_assert_eq!(region.at(x, y), crossed.count() % 2 == 1);
                }
            }
        }

        #[test]
        fn winding_spans_match_the_winding_number(
            corners in prop::collection::vec((-3.0f64..15.0, -3.0f64..13.0).prop_map(|(x, y)| DVec2::new(x, y)), 3..9),
        ) {
            let mut turns = [0; 120];
            winding_spans(12, 10, &corners, |pixels, around| turns[pixels].fill(around)).unwrap();
            for (at, &turns) in turns.iter().enumerate() {
                let centre = DVec2::new((at % 12) as f64 + 0.5, (at / 12) as f64 + 0.5);
                // Angle that the ring covers as seen from the centre; y points down.
                let sides = corners.iter().zip(corners.iter().cycle().skip(1));
                let angle: f64 = sides.map(|(&a, &b)| (a - centre).angle_to(b - centre)).sum();
                prop_assert_eq!(turns, -(angle / std::f64::consts::TAU).round() as i32);
            }
        }
    }
}
