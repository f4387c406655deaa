//! Clicks of a simulated user, derived from the ground truth.

use glam::DVec2;

use ostra_masks::{Click, Connectivity, LabelId, LabelMask, Region, components, deepest_point};

/// Returns the next click of a simulated user, or `None` if both regions are equal.
///
/// The click is at the deepest point of the largest 4-connected component where `current` differs
/// from `truth`. The deepest point is the one farthest from the border of the component and of the
/// image. The click includes where the object is missed and excludes where too much was taken. With
/// an empty `current`, it is the deepest point of the object's largest part.
///
/// # Panics
/// Panics if the regions differ in size.
#[must_use]
pub fn next_click(truth: &Region, current: &Region) -> Option<Click> {
    assert!(
        truth.width == current.width && truth.height == current.height,
        "truth and answer are of one frame"
    );
    let wrong = |include: bool| {
        let pairs = truth.inside.iter().zip(&current.inside);
        let inside = pairs
            .map(|(&truth, &current)| truth == include && current != include)
            .collect();
        Region { inside, ..*truth }
    };
    let (missed, excess) = (largest_part(&wrong(true)), largest_part(&wrong(false)));
    let include = missed.area >= excess.area;
    click_in(if include { &missed } else { &excess }, include)
}

/// A click for one of several labels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LabelClick {
    /// The label that the click is for.
    pub label: LabelId,
    /// The click.
    pub click: Click,
    /// Number of pixels in the wrong component that contains the click.
    pub wrong_px: usize,
}

/// Returns the next click for several labels, or `None` if none of them is wrong.
///
/// The click is in the largest component where a label of `open` is missed, or where it covers
/// pixels that belong to no label of `open`. Otherwise it is like [`next_click`].
///
/// # Panics
/// Panics if the masks differ in size.
#[must_use]
pub fn next_label_click(
    truth: &LabelMask,
    current: &LabelMask,
    open: &[LabelId],
) -> Option<LabelClick> {
    assert!(
        truth.width == current.width && truth.height == current.height,
        "truth and answer are of one frame"
    );
    let wrong = |is_wrong: &dyn Fn(LabelId, LabelId) -> bool| {
        let pairs = truth.ids.iter().zip(&current.ids);
        let inside = pairs
            .map(|(&truth, &current)| is_wrong(truth, current))
            .collect();
        largest_part(&Region {
            width: truth.width,
            height: truth.height,
            inside,
        })
    };
    let mut largest: Option<(LabelId, bool, ErrorComponent)> = None;
    for &label in open {
        let missed = wrong(&|truth, current| truth == label && current != label);
        let excess =
            wrong(&|truth, current| truth != label && current == label && !open.contains(&truth));
        for (include, part) in [(true, missed), (false, excess)] {
            if part.area > largest.as_ref().map_or(0, |(_, _, part)| part.area) {
                largest = Some((label, include, part));
            }
        }
    }
    let (label, include, part) = largest?;
    Some(LabelClick {
        label,
        click: click_in(&part, include)?,
        wrong_px: part.area,
    })
}

/// A connected part of a region.
struct ErrorComponent {
    pixels: Region,
    area: usize,
}

/// Returns the largest 4-connected component; ties go to the first in row order.
fn largest_part(region: &Region) -> ErrorComponent {
    let found = components(region, Connectivity::Four);
    let largest = (0..found.areas.len())
        .rev()
        .max_by_key(|&at| found.areas[at]);
    let label = largest.map_or(u32::MAX, |at| at as u32 + 1);
    let inside = found.labels.iter().map(|&of| of == label).collect();
    ErrorComponent {
        pixels: Region { inside, ..*region },
        area: largest.map_or(0, |at| found.areas[at]),
    }
}

fn click_in(part: &ErrorComponent, include: bool) -> Option<Click> {
    let (x, y) = deepest_point(&part.pixels)?;
    Some(Click {
        at_px: DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5),
        include,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn region(rows: &[&str]) -> Region {
        Region {
            width: rows[0].len() as u32,
            height: rows.len() as u32,
            inside: rows
                .iter()
                .flat_map(|row| row.bytes().map(|byte| byte == b'#'))
                .collect(),
        }
    }

    fn mask(rows: &[&str]) -> LabelMask {
        LabelMask {
            width: rows[0].len() as u32,
            height: rows.len() as u32,
            ids: rows
                .iter()
                .flat_map(|row| row.bytes().map(|byte| LabelId(u16::from(byte - b'0'))))
                .collect(),
        }
    }

    #[test]
    fn first_click_is_the_deepest_point_of_the_object() {
        let truth = region(&[
            "........", ".#####..", ".#####..", ".#####..", ".#####..", ".#####..", "........",
        ]);
        let click = next_click(&truth, &Region::empty(8, 7)).unwrap();
        assert_eq!((click.at_px, click.include), (DVec2::new(3.5, 3.5), true));
    }

    #[test]
    fn larger_excess_gives_an_exclude_click() {
        let truth = region(&["##......", "##......", "........", "........"]);
        let answer = region(&[".#..####", "##..####", "....####", "........"]);
        let click = next_click(&truth, &answer).unwrap();
        assert!(
            !click.include
                && truth.inside[8 + click.at_px.x as usize]
                    != answer.inside[8 + click.at_px.x as usize]
        );
        assert!(
            (5.0..7.0).contains(&click.at_px.x) && click.at_px.y == 1.5,
            "{click:?}"
        );
    }

    #[test]
    fn nothing_to_correct_gives_no_click() {
        let truth = region(&["##..", "...."]);
        assert_eq!(next_click(&truth, &truth), None);
        let truth = mask(&["1122", "0000"]);
        assert_eq!(
            next_label_click(&truth, &truth, &[LabelId(1), LabelId(2)]),
            None
        );
    }

    #[test]
    fn wrong_label_is_corrected_by_a_click_for_the_right_one() {
        let truth = mask(&["111222", "111222", "111222"]);
        let answer = mask(&["111111", "111111", "111111"]);
        let (one, two) = (LabelId(1), LabelId(2));
        let at_px = DVec2::new(4.5, 1.5);
        let expected = |label, include| LabelClick {
            label,
            click: Click { at_px, include },
            wrong_px: 9,
        };
        assert_eq!(
            next_label_click(&truth, &answer, &[one, two]),
            Some(expected(two, true))
        );
        assert_eq!(
            next_label_click(&truth, &answer, &[one]),
            Some(expected(one, false))
        );
    }
}
