use std::ops::Range;

use anyhow::Result;
use glam::DVec2;

use super::options::Aim;
use ostra_masks::{
    BorderDrag, LabelId, LabelMask, LabelTree, Outline, PaintRule, Region, assign, erase,
    fill_polygons, outlines, polygon_spans, pull,
};

/// The result of drawing with the polygon tool and of dragging borders.
#[derive(Debug, Clone, PartialEq)]
pub struct DrawnMask {
    /// Mask of the frame after drawing.
    pub mask: LabelMask,
    /// Number of polygon corners and border drags; each one is a click.
    pub corners: usize,
}

/// Returns the IoU of a label on a frame for a mask.
pub(super) type Iou<'a> = &'a dyn Fn(&LabelMask) -> f64;

/// A label that is drawn on a frame, and how drawings of it are valued.
#[derive(Clone, Copy)]
pub struct DrawingTask<'a> {
    /// Ground truth mask of the frame.
    pub truth: &'a LabelMask,
    /// Mask of the frame before drawing.
    pub mask: &'a LabelMask,
    /// The label.
    pub label: LabelId,
    /// The tree that contains it.
    pub tree: &'a LabelTree,
    /// Returns the IoU of the label for a mask.
    pub iou: Iou<'a>,
    /// What a drawing must gain.
    pub aim: &'a Aim,
}

impl DrawingTask<'_> {
    /// Returns the mask before drawing.
    pub(super) fn undrawn(&self) -> DrawnMask {
        DrawnMask {
            mask: self.mask.clone(),
            corners: 0,
        }
    }

    /// Returns the value of a mask that needed this many corners.
    pub(super) fn value(&self, mask: &LabelMask, corners: usize) -> f64 {
        self.aim.value((self.iou)(mask), corners)
    }
}

/// Returns the best drawing with polygons alone, and its value.
///
/// If no drawing pays, returns `None` and the value of the unchanged mask.
pub(super) fn outlined(task: &DrawingTask<'_>) -> Result<(Option<DrawnMask>, f64)> {
    let mut best = (None, task.value(task.mask, 0));
    for off_px in task.aim.off_px() {
        let whole = drawn_whole(task, off_px)?;
        let parts = drawn_parts(task, off_px, best.1)?;
        for drawn in [whole, parts].into_iter().flatten() {
            let value = task.value(&drawn.mask, drawn.corners);
            if value > best.1 {
                best = (Some(drawn), value);
            }
        }
    }
    Ok(best)
}

/// Erases the label and draws it again; a label that does not belong there is erased by one click.
fn drawn_whole(task: &DrawingTask<'_>, off_px: f64) -> Result<Option<DrawnMask>> {
    let DrawingTask {
        truth,
        mask,
        label,
        tree,
        ..
    } = *task;
    let mut drawn = task.undrawn();
    erase(&mut drawn.mask, &mask.region(label), Some(label))?;
    for polygon in polygons(&truth.region(label), off_px) {
        drawn.draw(&polygon.keyhole(), label, tree, true)?;
    }
    if !truth.ids.contains(&label) {
        drawn.corners = 1;
    }
    Ok((drawn.corners > 0).then_some(drawn))
}

/// Draws wrong parts one by one while that pays and can still exceed `best`.
///
/// Returns `None` if nothing is drawn.
fn drawn_parts(task: &DrawingTask<'_>, off_px: f64, best: f64) -> Result<Option<DrawnMask>> {
    let mut drawn = task.undrawn();
    let mut value = task.value(task.mask, 0);
    for PolygonCorrection { ring, include, .. } in
        corrections(task.truth, task.mask, task.label, off_px)?
    {
        if task.aim.value(1.0, drawn.corners + ring.len()) <= best {
            continue;
        }
        let mut next = drawn.clone();
        next.draw(&ring, task.label, task.tree, include)?;
        let next_value = task.value(&next.mask, next.corners);
        if next_value > value {
            (drawn, value) = (next, next_value);
        }
    }
    Ok((drawn.corners > 0).then_some(drawn))
}

/// A polygon around a wrong part.
pub(super) struct PolygonCorrection {
    pub ring: Vec<DVec2>,
    pub include: bool,
    /// Number of corrected pixels per corner.
    pub worth: f64,
    /// The pixels inside (ranges of row-major positions in the frame).
    pub pixels: Vec<Range<usize>>,
}

/// Returns polygons around the wrong parts of a label, by decreasing gain per corner.
pub(super) fn corrections(
    truth: &LabelMask,
    mask: &LabelMask,
    label: LabelId,
    off_px: f64,
) -> Result<Vec<PolygonCorrection>> {
    let mut all = Vec::new();
    for include in [true, false] {
        // Which pixels a polygon changes, and where the change is a correction.
        let changed = |is: LabelId| (is == label) != include;
        let mends = |truth: LabelId| (truth == label) == include;
        let pairs = || truth.ids.iter().zip(&mask.ids);
        let wrong = pairs()
            .map(|(&truth, &is)| changed(is) && mends(truth))
            .collect();
        for polygon in polygons(
            &Region {
                width: mask.width,
                height: mask.height,
                inside: wrong,
            },
            off_px,
        ) {
            let ring = polygon.keyhole();
            let mut pixels = Vec::new();
            polygon_spans(
                mask.width,
                mask.height,
                std::slice::from_ref(&ring),
                |span| pixels.push(span),
            )?;
            let inside = pixels
                .iter()
                .cloned()
                .flatten()
                .filter(|&at| changed(mask.ids[at]));
            let corrected: i64 = inside
                .map(|at| if mends(truth.ids[at]) { 1 } else { -1 })
                .sum();
            if corrected > 0 {
                all.push(PolygonCorrection {
                    worth: corrected as f64 / ring.len() as f64,
                    ring,
                    include,
                    pixels,
                });
            }
        }
    }
    all.sort_by(|a, b| b.worth.total_cmp(&a.worth));
    Ok(all)
}

impl DrawnMask {
    pub(super) fn draw(
        &mut self,
        ring: &Vec<DVec2>,
        label: LabelId,
        tree: &LabelTree,
        include: bool,
    ) -> Result<()> {
        let region = fill_polygons(
            self.mask.width,
            self.mask.height,
            std::slice::from_ref(ring),
        )?;
        if include {
            assign(&mut self.mask, &region, label, PaintRule::Replace, tree)?;
        } else {
            erase(&mut self.mask, &region, Some(label))?;
        }
        self.corners += ring.len();
        Ok(())
    }

    /// Drags the border of a label.
    pub(super) fn pull(
        &mut self,
        drag: BorderDrag,
        label: LabelId,
        tree: &LabelTree,
    ) -> Result<()> {
        pull(&mut self.mask, drag, label, PaintRule::Replace, tree)?;
        self.corners += 1;
        Ok(())
    }
}

/// Returns the polygons that a user draws around the parts of a region.
fn polygons(region: &Region, off_px: f64) -> Vec<Outline> {
    outlines(region)
        .iter()
        .filter_map(|outline| outline.simplified(off_px))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::interact::tests::shape::{LABEL, SIZE, mask};

    fn drawn_from(truth: &LabelMask, mask: &LabelMask) -> Option<DrawnMask> {
        drawn_for(truth, mask, 1.0)
    }

    fn drawn_for(truth: &LabelMask, mask: &LabelMask, price_beyond: f64) -> Option<DrawnMask> {
        let iou = |mask: &LabelMask| {
            let pairs = || mask.ids.iter().zip(&truth.ids);
            let both = pairs()
                .filter(|(a, b)| **a == LABEL && **b == LABEL)
                .count();
            both as f64
                / pairs()
                    .filter(|(a, b)| **a == LABEL || **b == LABEL)
                    .count() as f64
        };
        let aim = Aim {
            good_iou: 0.9,
            price: 1e-6,
            price_beyond,
            finest_px: 2.0,
        };
        let task = DrawingTask {
            truth,
            mask,
            label: LABEL,
            tree: &LabelTree::default(),
            iou: &iou,
            aim: &aim,
        };
        outlined(&task).unwrap().0
    }

    #[test]
    fn only_the_part_worth_drawing_is_drawn() {
        let truth = mask(|x, y| (20..80).contains(&x) && (20..80).contains(&y));
        let missed = mask(|x, y| (20..80).contains(&x) && (20..60).contains(&y) && x + y > 45);
        assert_eq!(
            drawn_from(&truth, &missed).unwrap().corners,
            4,
            "the missed stripe, not the corner"
        );
        let taken = mask(|x, y| (20..80).contains(&x) && (20..95).contains(&y));
        assert_eq!(
            drawn_from(&truth, &taken).unwrap(),
            DrawnMask {
                mask: truth.clone(),
                corners: 4
            }
        );
    }

    #[test]
    fn additional_corners_are_drawn_only_if_they_pay() {
        let within = |x: u32, y: u32, across: std::ops::Range<u32>| {
            across.contains(&x) && (20..80).contains(&y)
        };
        let truth =
            mask(|x, y| within(x, y, 20..80) || within(x, y, 80..86) && (45..75).contains(&y));
        let nothing = mask(|_, _| false);
        assert_eq!(drawn_for(&truth, &nothing, 1.0).unwrap().corners, 4);
        assert_eq!(
            drawn_for(&truth, &nothing, 0.004).unwrap(),
            DrawnMask {
                mask: truth.clone(),
                corners: 8
            }
        );
        assert_eq!(
            drawn_for(&truth, &nothing, 0.02).unwrap().corners,
            4,
            "four for 0.05 are too dear"
        );
    }

    #[test]
    fn drawing_up_to_the_good_iou_must_pay_too() {
        let square = |x: u32, y: u32| (20..80).contains(&x) && (20..80).contains(&y);
        let (truth, mask) = (mask(square), mask(|x, y| square(x, y) && y < 70));
        let drawn_with = |price: f64| {
            let region = truth.region(LABEL);
            let iou = |mask: &LabelMask| mask.region(LABEL).iou(&region);
            let aim = Aim {
                good_iou: 0.9,
                price,
                price_beyond: 1.0,
                finest_px: 1.0,
            };
            let task = DrawingTask {
                truth: &truth,
                mask: &mask,
                label: LABEL,
                tree: &LabelTree::default(),
                iou: &iou,
                aim: &aim,
            };
            outlined(&task).unwrap().0
        };
        // Four corners for a gain of 0.07, from five sixths to 0.9.
        assert_eq!(drawn_with(0.015).map(|drawn| drawn.corners), Some(4));
        assert_eq!(drawn_with(0.02), None);
    }

    #[test]
    fn part_with_the_highest_gain_per_corner_is_drawn_first() {
        let square = |x: u32, y: u32| (20..80).contains(&x) && (20..80).contains(&y);
        let comb = |x: u32, y: u32| {
            (20..80).contains(&x)
                && ((80..82).contains(&y) || (82..90).contains(&y) && (x / 4).is_multiple_of(2))
        };
        let truth = mask(|x, y| square(x, y) || comb(x, y));
        // The mask misses 300 pixels of the square and all 344 of the comb, which has many corners.
        let drawn = drawn_from(&truth, &mask(|x, y| square(x, y) && y >= 25)).unwrap();
        assert_eq!(
            drawn,
            DrawnMask {
                mask: mask(square),
                corners: 4
            }
        );
    }

    #[test]
    fn whole_label_is_drawn_where_that_needs_fewer_corners() {
        let truth = mask(|x, y| (20..80).contains(&x) && (20..80).contains(&y));
        let stripes = mask(|x, y| (20..80).contains(&x) && (20..80).contains(&y) && x / 5 % 2 == 0);
        assert_eq!(
            drawn_from(&truth, &stripes).unwrap(),
            DrawnMask {
                mask: truth.clone(),
                corners: 4
            }
        );
        let within =
            |x: u32, y: u32, side: std::ops::Range<u32>| side.contains(&x) && side.contains(&y);
        let ring = mask(|x, y| within(x, y, 20..80) && !within(x, y, 40..60));
        let again = drawn_from(&ring, &mask(|_, _| false)).unwrap();
        assert!(
            again.mask.ids[(50 * SIZE + 50) as usize] == LabelId::NONE,
            "holes stay"
        );
    }

    #[test]
    fn parts_finer_than_the_precision_are_not_drawn() {
        let dust = mask(|x, y| x % 10 == 0 && y % 10 == 0);
        assert_eq!(drawn_from(&dust, &mask(|_, _| false)), None);
        let line = mask(|x, y| x == 50 && y < 90);
        let adjacent = mask(|x, y| (50..60).contains(&x) && y < 90);
        let drawn = drawn_from(&line, &adjacent);
        assert_eq!(
            drawn,
            Some(DrawnMask {
                mask: line,
                corners: 4
            }),
            "but the excess next to it is removed"
        );
    }
}
