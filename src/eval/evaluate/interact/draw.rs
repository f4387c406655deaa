use anyhow::Result;

use super::aim::Aim;
use super::mended::mended;
use super::outline::{Drawn, Iou, outlined};
use ostra_masks::{LabelId, LabelMask, LabelTree};

/// Draws what clicks could not: polygons around the whole of a label on a frame or around its wrong parts, or borders pulled
/// and polygons among each other, those first that mend most for each click, as long as they pay. `None` where nothing does, or
/// everything is finer than the finest of the aim.
///
/// # Errors
/// When the masks differ in size.
pub fn drawn(
    (truth, mask): (&LabelMask, &LabelMask),
    (label, tree): (LabelId, &LabelTree),
    iou: Iou<'_>,
    aim: &Aim,
) -> Result<Option<Drawn>> {
    if aim.value(1.0, 1) <= aim.value(iou(mask), 0) {
        return Ok(None);
    }
    let (outlined, value) = outlined((truth, mask), (label, tree), iou, aim)?;
    let mended = mended((truth, mask), (label, tree), (iou, aim), value)?;
    Ok(mended
        .filter(|drawn| aim.value(iou(&drawn.mask), drawn.corners) > value)
        .or(outlined))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::interact::tests::shape::{LABEL, mask};

    #[test]
    fn borders_are_pulled_or_polygons_drawn_whatever_is_less_work() {
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
            drawn((truth, mask), (LABEL, &tree), &iou, &aim)
                .unwrap()
                .unwrap()
                .corners
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
}
