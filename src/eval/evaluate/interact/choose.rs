use std::collections::{BTreeMap, BTreeSet};

use ostra_masks::LabelId;

/// IoU of a label on each frame on which truth or result shows it, by label.
pub type IousByLabel = BTreeMap<LabelId, BTreeMap<usize, f64>>;

/// A label on a frame that is worth a correction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Worth {
    /// Frame number.
    pub frame: usize,
    /// The label.
    pub label: LabelId,
    /// Its IoU there, below 1.
    pub iou: f64,
}

/// Where a correction is likely to mend most, as a user sees who goes through the film: of all stretches between anchors
/// the one over which a label lacks most, there the frame in the middle of what it lacks. Where nothing is amiss between
/// anchors, the poorest anchor. Those in `left_alone` are passed over.
pub fn most_worth(
    ious: &IousByLabel,
    anchors: &BTreeSet<usize>,
    left_alone: &BTreeSet<(usize, LabelId)>,
) -> Option<Worth> {
    let is_open =
        |worth: &Worth| worth.iou < 1.0 && !left_alone.contains(&(worth.frame, worth.label));
    let lack = |stretch: &[Worth]| stretch.iter().map(|worth| 1.0 - worth.iou).sum::<f64>();
    let (mut poorest, mut widest): (Option<Worth>, Option<(f64, Worth)>) = (None, None);
    for (&label, of) in ious {
        let all: Vec<Worth> = of
            .iter()
            .map(|(&frame, &iou)| Worth { frame, label, iou })
            .collect();
        let at_anchors = all
            .iter()
            .filter(|worth| anchors.contains(&worth.frame) && is_open(worth));
        poorest = at_anchors
            .chain(&poorest)
            .min_by(|a, b| a.iou.total_cmp(&b.iou))
            .copied();
        for stretch in all.split(|worth| anchors.contains(&worth.frame)) {
            let all = lack(stretch);
            if all > widest.map_or(0.0, |(most, _)| most) {
                let middle = middle_of(stretch);
                let open = stretch.iter().filter(|worth| is_open(worth));
                let nearest = open.min_by_key(|worth| worth.frame.abs_diff(middle));
                widest = nearest.map(|&worth| (all, worth)).or(widest);
            }
        }
    }
    widest.map(|(_, worth)| worth).or(poorest)
}

/// The frame before which a label lacks as much as after it.
fn middle_of(stretch: &[Worth]) -> usize {
    let half = stretch.iter().map(|worth| 1.0 - worth.iou).sum::<f64>() / 2.0;
    let mut sum = 0.0;
    let middle = stretch.iter().find(|worth| {
        sum += 1.0 - worth.iou;
        sum >= half
    });
    middle.map_or(0, |worth| worth.frame)
}

#[cfg(test)]
mod tests {
    use super::*;

    const LABEL: LabelId = LabelId(1);

    fn chosen(ious: &[f64], anchors: &[usize], left_alone: &[usize]) -> Option<usize> {
        let ious = BTreeMap::from([(LABEL, ious.iter().copied().enumerate().collect())]);
        let left_alone = left_alone.iter().map(|&frame| (frame, LABEL)).collect();
        most_worth(&ious, &anchors.iter().copied().collect(), &left_alone).map(|worth| worth.frame)
    }

    #[test]
    fn the_middle_of_the_widest_lack_comes_before_one_poor_frame() {
        let ious = [1.0, 0.1, 0.9, 1.0, 0.7, 0.6, 0.6, 0.7, 0.9];
        assert_eq!(chosen(&ious, &[0, 3], &[]), Some(6));
        assert_eq!(
            chosen(&ious, &[0, 3], &[6]),
            Some(5),
            "the nearest that is not left alone"
        );
        assert_eq!(
            chosen(&ious, &[0, 3, 6], &[]),
            Some(1),
            "an anchor parts stretches"
        );
    }

    #[test]
    fn anchors_come_last_and_what_is_right_never() {
        assert_eq!(chosen(&[0.8, 1.0, 0.7, 1.0], &[0, 2], &[]), Some(2));
        assert_eq!(chosen(&[0.8, 1.0, 0.7, 1.0], &[0, 2], &[2]), Some(0));
        assert_eq!(chosen(&[0.8, 0.99, 0.7], &[0, 2], &[]), Some(1));
        assert_eq!(chosen(&[1.0, 1.0], &[0], &[]), None);
        assert_eq!(chosen(&[0.5, 0.5], &[0], &[0, 1]), None);
        assert_eq!(
            most_worth(&BTreeMap::new(), &BTreeSet::new(), &BTreeSet::new()),
            None
        );
    }

    #[test]
    fn the_label_that_lacks_most_goes_first() {
        let of = |ious: [f64; 3]| ious.into_iter().enumerate().collect::<BTreeMap<_, _>>();
        let ious = BTreeMap::from([
            (LABEL, of([1.0, 0.5, 0.5])),
            (LabelId(2), of([1.0, 0.4, 0.4])),
        ]);
        let worth = most_worth(&ious, &BTreeSet::from([0]), &BTreeSet::new()).unwrap();
        assert_eq!(
            worth,
            Worth {
                frame: 1,
                label: LabelId(2),
                iou: 0.4
            }
        );
    }
}
