use glam::{DMat3, DVec2};

use crate::Pose;
use crate::epipolar::poses_from_essential;

/// A motion and what it makes of the matches.
pub(super) struct Motion {
    pub second_from_first: Pose,
    /// Median angle between the rays of matches in front of both cameras, in radians.
    pub parallax: f64,
}

/// Which of the four motions of an essential matrix puts most points in front of both cameras; `None` where that is less
/// than half of them.
pub(super) fn motion_in_front(essential: DMat3, pairs: &[[DVec2; 2]]) -> Option<Motion> {
    let mut best: Option<(Pose, Vec<f64>)> = None;
    for pose in poses_from_essential(essential)? {
        let angles = angles_in_front(&pose, pairs);
        if best
            .as_ref()
            .is_none_or(|(_, most)| angles.len() > most.len())
        {
            best = Some((pose, angles));
        }
    }
    let (second_from_first, mut angles) = best?;
    if 2 * angles.len() < pairs.len() || angles.is_empty() {
        return None;
    }
    let middle = angles.len() / 2;
    let (_, parallax, _) = angles.select_nth_unstable_by(middle, f64::total_cmp);
    Some(Motion {
        second_from_first,
        parallax: *parallax,
    })
}

/// Angles between the rays of all matches whose rays come nearest to each other in front of both cameras.
fn angles_in_front(pose: &Pose, pairs: &[[DVec2; 2]]) -> Vec<f64> {
    let (r, t) = (DMat3::from_quat(pose.rotation), pose.translation);
    let angle = |[x1, x2]: &[DVec2; 2]| {
        let (a, b) = (r * x1.extend(1.0), x2.extend(1.0));
        let (aa, ab, bb, at, bt) = (a.dot(a), a.dot(b), b.dot(b), a.dot(t), b.dot(t));
        // Both depths, times (aa · bb − ab²), which is never negative.
        let [first, second] = [ab * bt - bb * at, aa * bt - ab * at];
        (first > 0.0 && second > 0.0).then(|| a.cross(b).length().atan2(ab))
    };
    pairs.iter().filter_map(angle).collect()
}
