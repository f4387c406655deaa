use glam::DVec3;

/// Where two sets of points come nearest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Meeting {
    /// Of the first set.
    pub(super) a: DVec3,
    /// Of the second set.
    pub(super) b: DVec3,
}

/// So many points of each set are compared each with each.
const COMPARED: usize = 2000;
/// Steps of the refinement at most.
const STEPS: usize = 20;

impl Meeting {
    /// The nearest two of an even sample, from which each set's nearest point to the other's is taken in turn. `None` where a
    /// set is empty.
    pub(super) fn of(a: &[DVec3], b: &[DVec3]) -> Option<Self> {
        let [few_a, few_b] = [sample(a), sample(b)];
        let pairs = few_a.iter().map(|&x| {
            Some(Self {
                a: x,
                b: nearest(&few_b, x)?,
            })
        });
        let mut meeting = pairs
            .flatten()
            .min_by(|one, other| one.gap().total_cmp(&other.gap()))?;
        for _ in 0..STEPS {
            let on_a = nearest(a, meeting.b)?;
            let next = Self {
                a: on_a,
                b: nearest(b, on_a)?,
            };
            if next.gap() >= meeting.gap() {
                break;
            }
            meeting = next;
        }
        Some(meeting)
    }

    /// How far the two are apart.
    pub(super) fn gap(&self) -> f64 {
        self.a.distance(self.b)
    }
}

fn sample(points: &[DVec3]) -> Vec<DVec3> {
    points
        .iter()
        .copied()
        .step_by(points.len().div_ceil(COMPARED).max(1))
        .collect()
}

fn nearest(points: &[DVec3], x: DVec3) -> Option<DVec3> {
    points
        .iter()
        .copied()
        .min_by(|a, b| a.distance_squared(x).total_cmp(&b.distance_squared(x)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_lines_meet_where_they_come_nearest() {
        let line = |from: DVec3, step: DVec3| {
            (0..30_000)
                .map(move |k| from + f64::from(k) * step)
                .collect::<Vec<_>>()
        };
        let a = line(DVec3::new(-1.0, 0.0, 0.0), 1e-4 * DVec3::X);
        let b = line(DVec3::new(0.5, -2.0, 0.01), 1e-4 * DVec3::Y);
        let meeting = Meeting::of(&a, &b).unwrap();
        assert!((meeting.gap() - 0.01).abs() < 1e-9, "{meeting:?}");
        assert!(
            meeting.a.distance(DVec3::new(0.5, 0.0, 0.0)) < 1e-9,
            "{meeting:?}"
        );
        assert_eq!(Meeting::of(&a, &[]), None);
    }
}
