use std::num::NonZero;

use glam::Vec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};

/// Points whose distance to their neighbour is measured for [`spacing`].
const SPACING_SAMPLES: usize = 2000;

/// A k-d tree over points.
pub struct Neighbours {
    tree: ImmutableKdTree<f32, 3>,
    count: usize,
}

impl std::fmt::Debug for Neighbours {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Neighbours")
            .field("count", &self.count)
            .finish_non_exhaustive()
    }
}

impl Neighbours {
    /// Builds the tree; `None` without points. Points that are not finite are never anybody's neighbour.
    #[must_use]
    pub fn new(points: &[Vec3]) -> Option<Self> {
        // So far away that it is not found, so near that its distance is still a number.
        let place = |point: &Vec3| {
            if point.is_finite() {
                point.to_array()
            } else {
                [1e18; 3]
            }
        };
        let places: Vec<[f32; 3]> = points.iter().map(place).collect();
        if places.is_empty() {
            return None;
        }
        let tree = ImmutableKdTree::new_from_slice(&places).ok()?;
        Some(Self {
            tree,
            count: points.len(),
        })
    }

    /// The nearest point, as (index, distance).
    #[must_use]
    pub fn nearest(&self, to: Vec3) -> (usize, f32) {
        let found = self
            .tree
            .query(&to.to_array())
            .nearest_one::<SquaredEuclidean<f32>>()
            .execute();
        (found.item as usize, found.distance.sqrt())
    }

    /// The `count` nearest points (fewer where there are not as many), nearest first, as (index, distance).
    #[must_use]
    pub fn nearest_n(&self, to: Vec3, count: usize) -> Vec<(usize, f32)> {
        let Some(count) = NonZero::new(count.min(self.count)) else {
            return Vec::new();
        };
        let found = self
            .tree
            .query(&to.to_array())
            .nearest_n::<SquaredEuclidean<f32>>(count)
            .execute();
        found
            .iter()
            .map(|one| (one.item as usize, one.distance.sqrt()))
            .collect()
    }

    /// As [`spacing`], of the points that the tree was built of.
    #[must_use]
    pub fn spacing(&self, points: &[Vec3]) -> Option<f64> {
        let step = points.len().div_ceil(SPACING_SAMPLES).max(1);
        let nearest_other = |&point: &Vec3| {
            let around = self.nearest_n(point, 8);
            around
                .into_iter()
                .map(|(_, distance)| distance)
                .find(|&distance| distance > 0.0 && distance < 1e17)
        };
        let mut distances: Vec<f32> = points
            .iter()
            .filter(|p| p.is_finite())
            .step_by(step)
            .filter_map(nearest_other)
            .collect();
        if distances.is_empty() {
            return None;
        }
        let middle = distances.len() / 2;
        let (_, median, _) = distances.select_nth_unstable_by(middle, f32::total_cmp);
        Some(f64::from(*median))
    }
}

/// How far apart neighbours typically are: the median distance of a point to the nearest at another place; `None` for
/// fewer than two places.
#[must_use]
pub fn spacing(points: &[Vec3]) -> Option<f64> {
    Neighbours::new(points)?.spacing(points)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn nearest_is_nearest(raw in prop::collection::vec(prop::array::uniform3(-4i8..4), 1..200), to in prop::array::uniform3(-6i8..6)) {
            let point = |p: &[i8; 3]| Vec3::from_array(p.map(f32::from));
            let points: Vec<Vec3> = raw.iter().map(point).collect();
            let to = point(&to);
            let neighbours = Neighbours::new(&points).unwrap();
            let mut plain: Vec<f32> = points.iter().map(|p| p.distance(to)).collect();
            plain.sort_by(f32::total_cmp);
            let (index, distance) = neighbours.nearest(to);
            prop_assert!((distance - plain[0]).abs() < 1e-5 && (points[index].distance(to) - distance).abs() < 1e-5);
            let found = neighbours.nearest_n(to, 7);
            prop_assert_eq!(found.len(), points.len().min(7));
            for (one, expected) in found.iter().zip(&plain) {
                prop_assert!((one.1 - expected).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn spacing_of_a_lattice() {
        let points: Vec<Vec3> = (0..1000)
            .map(|i| Vec3::new((i % 10) as f32, (i / 10 % 10) as f32, (i / 100) as f32) * 0.25)
            .collect();
        assert_eq!(spacing(&points), Some(0.25));
        assert_eq!(spacing(&[Vec3::ONE, Vec3::NAN, Vec3::ONE]), None);
        assert_eq!(spacing(&[]), None);
    }

    #[test]
    fn many_points_in_one_place() {
        let neighbours = Neighbours::new(&vec![Vec3::ONE; 5000]).unwrap();
        assert_eq!(neighbours.nearest(Vec3::ZERO).1, 3f32.sqrt());
        assert_eq!(neighbours.nearest_n(Vec3::ZERO, 40).len(), 40);
    }
}
