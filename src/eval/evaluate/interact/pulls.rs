use std::ops::Range;

use anyhow::Result;
use glam::DVec2;
use rayon::prelude::*;

use ostra_masks::{ElasticBorders, LabelId, LabelMask};

/// How far apart the places are at which a border may be pulled, in pixels.
const STEP_PX: f64 = 3.0;
/// How far a border may be pulled, to either side, in pixels.
const FAR_PX: [f64; 9] = [1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0];
/// Borders with nothing wrong so near to them are left alone, in pixels.
const NEAR_PX: i64 = 2;

/// A border of a label pulled across itself.
#[derive(Debug, Clone, PartialEq)]
pub struct Pulled {
    /// From where to where, in pixels.
    pub ends_px: (DVec2, DVec2),
    /// Pixels that it mends, less those that it spoils.
    pub mended: i64,
    /// The pixels that it passes (places in the frame's pixels row by row).
    pub pixels: Vec<Range<usize>>,
}

/// For places along the borders of a label beside which something is wrong, the pull that mends most there, among those that
/// are no shorter than the finest that the hand does, in pixels.
///
/// # Errors
/// When the masks differ in size.
pub fn pulls(
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

/// Places at equal distances along a closed line.
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
            let (mut mended, mut pixels) = (0, Vec::new());
            pull.spans(|span, comes| {
                mended += judge.mended(span.clone(), comes);
                pixels.push(span);
            })?;
            if mended > best.as_ref().map_or(0, |best| best.mended) {
                best = Some(Pulled {
                    ends_px: (from, to),
                    mended,
                    pixels,
                });
            }
        }
    }
    Ok(best)
}

/// What is right and wrong of a label.
struct Judge<'a> {
    truth: &'a LabelMask,
    mask: &'a LabelMask,
    label: LabelId,
}

impl Judge<'_> {
    /// What is mended, less what is spoilt, where pixels come to the label or go.
    fn mended(&self, pixels: Range<usize>, comes: bool) -> i64 {
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
    fn a_corner_that_was_cut_off_is_pulled_out() {
        let truth = mask(|x, y| (20..60).contains(&x) && (20..60).contains(&y));
        let cut = mask(|x, y| (20..60).contains(&x) && (20..60).contains(&y) && x + y < 106);
        let all = pulls(&truth, &cut, LABEL, 1.0).unwrap();
        let best = all.iter().max_by_key(|pulled| pulled.mended).unwrap();
        let missed = truth.region(LABEL).area() - cut.region(LABEL).area();
        assert!(
            best.mended as usize > missed * 3 / 4,
            "{} of {missed}",
            best.mended
        );
        assert!(
            best.ends_px.1.distance(DVec2::splat(60.0)) < 3.0,
            "{:?}",
            best.ends_px
        );
        assert!(
            all.iter()
                .all(|pulled| pulled.ends_px.0.min_element() > 40.0),
            "the rest is right"
        );
        assert_eq!(
            pulls(&truth, &cut, LABEL, 20.0).unwrap(),
            [],
            "a coarse hand does nothing so fine"
        );
    }

    #[test]
    fn what_is_right_or_far_from_borders_is_left_alone() {
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
