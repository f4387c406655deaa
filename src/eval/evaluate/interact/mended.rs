use std::ops::Range;

use anyhow::Result;

use super::aim::Aim;
use super::outline::{Correction, Drawn, Iou, corrections};
use super::pulls::{Pulled, pulls};
use ostra_masks::{LabelId, LabelMask, LabelTree};

/// Of what is seen to be amiss, this much of the best for each click is mended before the hand looks again.
const OF_BEST: f64 = 0.6;
/// Less for each click, in pixels, is not worth a hand.
const LEAST_PX: f64 = 2.0;

/// Something that a hand does.
enum Change {
    Polygon(Correction),
    Pull(Pulled),
}

impl Change {
    /// Pixels that it mends, for each of its clicks.
    fn worth(&self) -> f64 {
        match self {
            Self::Polygon(correction) => correction.worth,
            Self::Pull(pulled) => pulled.mended as f64,
        }
    }

    /// What it passes (places in the frame's pixels row by row).
    fn pixels(&self) -> &[Range<usize>] {
        match self {
            Self::Polygon(correction) => &correction.pixels,
            Self::Pull(pulled) => &pulled.pixels,
        }
    }

    fn made(&self, drawn: &Drawn, (label, tree): (LabelId, &LabelTree)) -> Result<Drawn> {
        let mut next = drawn.clone();
        match self {
            Self::Polygon(correction) => {
                next.draw(&correction.ring, (label, tree), correction.include)?
            }
            Self::Pull(pulled) => next.pull(pulled.ends_px, (label, tree))?,
        }
        Ok(next)
    }
}

/// Mends a label by pulling its borders and by polygons around wrong parts, whatever mends most for each click, as long as
/// that pays and can still outdo `best`; `None` where nothing does.
///
/// # Errors
/// When the masks differ in size.
pub fn mended(
    (truth, mask): (&LabelMask, &LabelMask),
    (label, tree): (LabelId, &LabelTree),
    (iou, aim): (Iou<'_>, &Aim),
    best: f64,
) -> Result<Option<Drawn>> {
    let mut drawn = Drawn {
        mask: mask.clone(),
        corners: 0,
    };
    let mut value = aim.value(iou(mask), 0);
    loop {
        let changes = changes(truth, &drawn.mask, label, aim)?;
        let mut touched = vec![false; mask.ids.len()];
        let looked_at = value;
        for change in changes {
            let is_touched = |pixels: &Range<usize>| touched[pixels.clone()].contains(&true);
            if aim.value(1.0, drawn.corners + 1) <= best || change.pixels().iter().any(is_touched) {
                continue;
            }
            let next = change.made(&drawn, (label, tree))?;
            let next_value = aim.value(iou(&next.mask), next.corners);
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

/// What is worth most to be done now, the best first.
fn changes(truth: &LabelMask, mask: &LabelMask, label: LabelId, aim: &Aim) -> Result<Vec<Change>> {
    let mut all: Vec<Change> = pulls(truth, mask, label, aim.finest_px)?
        .into_iter()
        .map(Change::Pull)
        .collect();
    for off_px in aim.off_px() {
        all.extend(
            corrections(truth, mask, label, off_px)?
                .into_iter()
                .map(Change::Polygon),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::interact::tests::shape::{LABEL, mask};

    fn mended_from(
        truth: &LabelMask,
        mask: &LabelMask,
        price_beyond: f64,
        best: f64,
    ) -> Option<Drawn> {
        let truth_region = truth.region(LABEL);
        let iou = |mask: &LabelMask| mask.region(LABEL).iou(&truth_region);
        let aim = Aim {
            good_iou: 0.95,
            price: 1e-6,
            price_beyond,
            finest_px: 1.0,
        };
        mended(
            (truth, mask),
            (LABEL, &LabelTree::default()),
            (&iou, &aim),
            best,
        )
        .unwrap()
    }

    #[test]
    fn a_border_is_pulled_where_that_is_less_work_than_a_polygon() {
        let square = |x: u32, y: u32| (20..80).contains(&x) && (20..80).contains(&y);
        // What a pull of 4 px gives, over 24 px of the lower side.
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
    fn what_cannot_outdo_the_best_so_far_is_not_done() {
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
}
