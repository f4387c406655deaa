use std::ops::Range;

use anyhow::Result;
use glam::DVec2;
use rayon::prelude::*;

use super::options::Aim;
use super::outline::{DrawingTask, DrawnMask, PolygonCorrection, corrections, outlined};
use ostra_masks::{BorderDrag, ElasticBorders, LabelId, LabelMask, LabelTree};

/// Draws what clicks could not correct, or returns `None` if no drawing pays.
///
/// It compares polygons around the whole label or its wrong parts with a sequence of border drags
/// and polygons, sorted by gain per click. Errors finer than the precision of the aim are not
/// corrected.
///
/// # Errors
/// Returns an error if the masks differ in size.
pub fn drawn(task: &DrawingTask<'_>) -> Result<Option<DrawnMask>> {
    if task.aim.value(1.0, 1) <= task.value(task.mask, 0) {
        return Ok(None);
    }
    let (outlined, value) = outlined(task)?;
    let corrected = corrected(task, value)?;
    Ok(corrected
        .filter(|drawn| task.value(&drawn.mask, drawn.corners) > value)
        .or(outlined))
}

/// Share of the best gain per click that a change needs to be made in the same round.
const OF_BEST: f64 = 0.6;
/// Minimum gain per click, in pixels.
const LEAST_PX: f64 = 2.0;

/// A change that is drawn by hand.
enum DrawnCorrection {
    Polygon(PolygonCorrection),
    Pull(Pulled),
}

impl DrawnCorrection {
    /// Returns the number of corrected pixels per click.
    fn worth(&self) -> f64 {
        match self {
            Self::Polygon(correction) => correction.worth,
            Self::Pull(pulled) => pulled.corrected as f64,
        }
    }

    /// Returns the affected pixels (ranges of row-major positions in the frame).
    fn pixels(&self) -> &[Range<usize>] {
        match self {
            Self::Polygon(correction) => &correction.pixels,
            Self::Pull(pulled) => &pulled.pixels,
        }
    }

    fn made(&self, drawn: &DrawnMask, label: LabelId, tree: &LabelTree) -> Result<DrawnMask> {
        let mut next = drawn.clone();
        match self {
            Self::Polygon(correction) => {
                next.draw(&correction.ring, label, tree, correction.include)?;
            }
            Self::Pull(pulled) => next.pull(pulled.drag, label, tree)?,
        }
        Ok(next)
    }
}

/// Corrects a label with border drags and polygons, by decreasing gain per click.
///
/// It continues while changes pay and can still exceed `best`. Returns `None` if no change does.
///
/// # Errors
/// Returns an error if the masks differ in size.
pub fn corrected(task: &DrawingTask<'_>, best: f64) -> Result<Option<DrawnMask>> {
    let mut drawn = task.undrawn();
    let mut value = task.value(task.mask, 0);
    loop {
        let changes = changes(task.truth, &drawn.mask, task.label, task.aim)?;
        let mut touched = vec![false; task.mask.ids.len()];
        let looked_at = value;
        for change in changes {
            let is_touched = |pixels: &Range<usize>| touched[pixels.clone()].contains(&true);
            if task.aim.value(1.0, drawn.corners + 1) <= best
                || change.pixels().iter().any(is_touched)
            {
                continue;
            }
            let next = change.made(&drawn, task.label, task.tree)?;
            let next_value = task.value(&next.mask, next.corners);
            if next_value > value {
                (drawn, value) = (next, next_value);
                change
                    .pixels()
                    .iter()
                    .for_each(|pixels| touched[pixels.clone()].fill(true));
            }
        }
        if value <= looked_at {
            return Ok((drawn.corners > 0).then_some(drawn));
        }
    }
}

/// Returns the changes with the highest gain per click, the best one first.
fn changes(
    truth: &LabelMask,
    mask: &LabelMask,
    label: LabelId,
    aim: &Aim,
) -> Result<Vec<DrawnCorrection>> {
    let mut all: Vec<DrawnCorrection> = pulls(truth, mask, label, aim.finest_px)?
        .into_iter()
        .map(DrawnCorrection::Pull)
        .collect();
    for off_px in aim.off_px() {
        all.extend(
            corrections(truth, mask, label, off_px)?
                .into_iter()
                .map(DrawnCorrection::Polygon),
        );
    }
    all.sort_by(|a, b| b.worth().total_cmp(&a.worth()));
    let least = all
        .first()
        .map_or(0.0, |best| best.worth() * OF_BEST)
        .max(LEAST_PX);
    all.retain(|change| change.worth() >= least);
    Ok(all)
}

/// Distance between the border points at which a drag may start, in pixels.
const STEP_PX: f64 = 3.0;
/// Lengths of a drag to either side, in pixels.
const FAR_PX: [f64; 9] = [1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0];
/// Border points without an error within this distance are skipped, in pixels.
const NEAR_PX: i64 = 2;

/// A drag of a label's border across itself.
#[derive(Debug, Clone, PartialEq)]
struct Pulled {
    /// Start and end of the drag.
    pub drag: BorderDrag,
    /// Number of corrected pixels minus the number of newly wrong ones.
    pub corrected: i64,
    /// The pixels that the border passes (ranges of row-major positions in the frame).
    pub pixels: Vec<Range<usize>>,
}

/// Returns the best drag at each border point of a label with an error close to it.
///
/// Drags shorter than `finest_px` are excluded.
///
/// # Errors
/// Returns an error if the masks differ in size.
fn pulls(
    truth: &LabelMask,
    mask: &LabelMask,
    label: LabelId,
    finest_px: f64,
) -> Result<Vec<Pulled>> {
    let borders = ElasticBorders::of(&mask.region(label));
    let judge = Judge { truth, mask, label };
    let places: Vec<DVec2> = borders
        .rings()
        .iter()
        .flat_map(|ring| places_along(ring))
        .collect();
    let near = places
        .into_par_iter()
        .filter(|&place| judge.is_wrong_near(place));
    let best: Result<Vec<Option<Pulled>>> = near
        .map(|place| best_at(&judge, &borders, place, finest_px))
        .collect();
    Ok(best?.into_iter().flatten().collect())
}

/// Returns points at equal distances along a closed line.
fn places_along(ring: &[DVec2]) -> Vec<DVec2> {
    let mut places = Vec::new();
    let mut due = 0.0;
    for (at, &from) in ring.iter().enumerate() {
        let to = ring[(at + 1) % ring.len()];
        let length = from.distance(to);
        while due < length {
            places.push(from + (to - from) * (due / length));
            due += STEP_PX;
        }
        due -= length;
    }
    places
}

fn best_at(
    judge: &Judge<'_>,
    borders: &ElasticBorders,
    from: DVec2,
    finest_px: f64,
) -> Result<Option<Pulled>> {
    let mut best: Option<Pulled> = None;
    for far_px in FAR_PX.into_iter().filter(|&far_px| far_px >= finest_px) {
        let Some(mut pull) = borders.pull(from, from + DVec2::X * far_px) else {
            continue;
        };
        let across = pull
            .gives_way
            .first()
            .zip(pull.gives_way.last())
            .map(|(&a, &b)| (b - a).perp());
        let Some(across) = across.and_then(DVec2::try_normalize) else {
            continue;
        };
        for to in [from + across * far_px, from - across * far_px] {
            pull.to_px = to;
            let (mut corrected, mut pixels) = (0, Vec::new());
            pull.spans(|span, comes| {
                corrected += judge.corrected(span.clone(), comes);
                pixels.push(span);
            })?;
            if corrected > best.as_ref().map_or(0, |best| best.corrected) {
                best = Some(Pulled {
                    drag: BorderDrag {
                        from_px: from,
                        to_px: to,
                    },
                    corrected,
                    pixels,
                });
            }
        }
    }
    Ok(best)
}

/// Counts correct and wrong pixels of a label.
struct Judge<'a> {
    truth: &'a LabelMask,
    mask: &'a LabelMask,
    label: LabelId,
}

impl Judge<'_> {
    /// Returns the number of corrected minus newly wrong pixels after a change.
    ///
    /// The pixels are added to the label if `comes` is true, otherwise removed.
    fn corrected(&self, pixels: Range<usize>, comes: bool) -> i64 {
        let pairs = self.truth.ids[pixels.clone()]
            .iter()
            .zip(&self.mask.ids[pixels]);
        let changed = pairs.filter(|(_, is)| (**is == self.label) != comes);
        changed
            .map(|(truth, _)| {
                if (*truth == self.label) == comes {
                    1
                } else {
                    -1
                }
            })
            .sum()
    }

    fn is_wrong_near(&self, at_px: DVec2) -> bool {
        let (width, height) = (i64::from(self.mask.width), i64::from(self.mask.height));
        let around =
            |at: f64, size: i64| (at as i64 - NEAR_PX).max(0)..(at as i64 + NEAR_PX + 1).min(size);
        let is_wrong =
            |at: usize| (self.truth.ids[at] == self.label) != (self.mask.ids[at] == self.label);
        let mut columns_of_rows = around(at_px.y, height).map(|y| (y, around(at_px.x, width)));
        columns_of_rows.any(|(y, mut columns)| columns.any(|x| is_wrong((y * width + x) as usize)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::interact::tests::shape::{LABEL, mask};

    #[test]
    fn drag_or_polygon_is_chosen_by_the_number_of_clicks() {
        let tree = LabelTree::default();
        let drawn_with = |truth: &LabelMask, mask: &LabelMask, good_iou: f64| {
            let region = truth.region(LABEL);
            let iou = |mask: &LabelMask| mask.region(LABEL).iou(&region);
            let aim = Aim {
                good_iou,
                price: 1e-6,
                price_beyond: 1.0,
                finest_px: 1.0,
            };
            let task = DrawingTask {
                truth,
                mask,
                label: LABEL,
                tree: &tree,
                iou: &iou,
                aim: &aim,
            };
            drawn(&task).unwrap().unwrap().corners
        };
        let square = |x: u32, y: u32| (20..80).contains(&x) && (20..80).contains(&y);
        let tip = |x: u32, y: u32| (80..84).contains(&y) && x.abs_diff(50) < 12 - 3 * (y - 80);
        let tipped = mask(|x, y| square(x, y) || tip(x, y));
        assert_eq!(drawn_with(&tipped, &mask(square), 0.995), 1, "one pull");
        assert_eq!(
            drawn_with(&mask(square), &mask(|_, _| false), 0.995),
            4,
            "there is no border to be pulled"
        );
    }

    fn mended_from(
        truth: &LabelMask,
        mask: &LabelMask,
        price_beyond: f64,
        best: f64,
    ) -> Option<DrawnMask> {
        let truth_region = truth.region(LABEL);
        let iou = |mask: &LabelMask| mask.region(LABEL).iou(&truth_region);
        let aim = Aim {
            good_iou: 0.95,
            price: 1e-6,
            price_beyond,
            finest_px: 1.0,
        };
        let task = DrawingTask {
            truth,
            mask,
            label: LABEL,
            tree: &LabelTree::default(),
            iou: &iou,
            aim: &aim,
        };
        corrected(&task, best).unwrap()
    }

    #[test]
    fn border_is_dragged_where_that_costs_less_than_a_polygon() {
        let square = |x: u32, y: u32| (20..80).contains(&x) && (20..80).contains(&y);
        // A drag of 4 px gives this over 24 px of the lower side.
        let tip = |x: u32, y: u32| (80..84).contains(&y) && x.abs_diff(50) < 12 - 3 * (y - 80);
        let apart = |x: u32, y: u32| (2..14).contains(&x) && (2..14).contains(&y);
        let truth = mask(|x, y| square(x, y) || tip(x, y) || apart(x, y));
        let drawn = mended_from(&truth, &mask(square), 0.003, 0.0).unwrap();
        assert_eq!(
            drawn.corners, 5,
            "one for the tip, four for what no border is near"
        );
        assert!(drawn.mask.region(LABEL).iou(&truth.region(LABEL)) > 0.98);
    }

    #[test]
    fn changes_that_cannot_exceed_the_best_value_are_skipped() {
        let truth = mask(|x, y| (20..80).contains(&x) && (20..80).contains(&y));
        let half = mask(|x, y| (20..80).contains(&x) && (20..60).contains(&y));
        assert!(mended_from(&truth, &half, 0.001, 0.0).is_some());
        assert_eq!(mended_from(&truth, &half, 0.001, 1e9), None);
        assert_eq!(
            mended_from(&truth, &truth, 0.001, 0.0),
            None,
            "nothing is wrong"
        );
    }

    #[test]
    fn cut_off_corner_is_restored_by_a_drag() {
        let truth = mask(|x, y| (20..60).contains(&x) && (20..60).contains(&y));
        let cut = mask(|x, y| (20..60).contains(&x) && (20..60).contains(&y) && x + y < 106);
        let all = pulls(&truth, &cut, LABEL, 1.0).unwrap();
        let best = all.iter().max_by_key(|pulled| pulled.corrected).unwrap();
        let missed = truth.region(LABEL).area() - cut.region(LABEL).area();
        assert!(
            best.corrected as usize > missed * 3 / 4,
            "{} of {missed}",
            best.corrected
        );
        assert!(
            best.drag.to_px.distance(DVec2::splat(60.0)) < 3.0,
            "{:?}",
            best.drag
        );
        assert!(
            all.iter()
                .all(|pulled| pulled.drag.from_px.min_element() > 40.0),
            "the rest is right"
        );
        assert_eq!(
            pulls(&truth, &cut, LABEL, 20.0).unwrap(),
            [],
            "a coarse hand does nothing so fine"
        );
    }

    #[test]
    fn correct_borders_and_distant_errors_give_no_drag() {
        let truth = mask(|x, y| (20..60).contains(&x) && (20..60).contains(&y));
        assert_eq!(pulls(&truth, &truth, LABEL, 1.0).unwrap(), []);
        assert_eq!(pulls(&truth, &mask(|_, _| false), LABEL, 1.0).unwrap(), []);
        let holed =
            mask(|x, y| (20..60).contains(&x) && (20..60).contains(&y) && !(x == 40 && y == 40));
        assert_eq!(
            pulls(&holed, &truth, LABEL, 1.0).unwrap(),
            [],
            "a hole is not at a border"
        );
    }
}
