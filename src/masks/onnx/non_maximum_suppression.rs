use crate::PxBox;

/// Keeps only the first of any boxes that overlap by an IoU of more than `most_overlap`.
///
/// `found` must be sorted by score, highest first.
pub(super) fn non_maximum_suppression<T>(
    found: Vec<T>,
    most_overlap: f64,
    extent: impl Fn(&T) -> PxBox,
) -> Vec<T> {
    let mut kept: Vec<T> = Vec::new();
    for one in found {
        if kept
            .iter()
            .all(|other| extent(&one).iou(&extent(other)) <= most_overlap)
        {
            kept.push(one);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;

    #[test]
    fn first_of_overlapping_boxes_is_kept() {
        let square = |x: f64| PxBox {
            min_px: DVec2::new(x, 0.0),
            max_px: DVec2::new(x + 10.0, 10.0),
        };
        // IoU of squares 2 px apart: 2/3; 4 px apart: 3/7.
        let kept = non_maximum_suppression(vec![4.0, 6.0, 0.0, 30.0], 0.5, |&x| square(x));
        assert_eq!(kept, [4.0, 0.0, 30.0]);
        assert_eq!(
            non_maximum_suppression(vec![4.0, 0.0], 0.4, |&x| square(x)),
            [4.0]
        );
    }
}
