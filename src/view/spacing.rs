use glam::Vec3;
use rayon::prelude::*;

use super::points::SpreadOrder;

/// Points before and after in the order among which neighbours are looked for.
const REACH: usize = 16;
/// The neighbour whose distance counts: on a surface the fourth lies about as far away as a square that a point has to
/// itself is wide, be the points strewn or on a grid.
const NEIGHBOUR: usize = 4;
/// On a surface the fourth neighbour is hardly farther away than this many times the second (1.46 where points are
/// strewn); along a stem of single points it is, whose discs would stand out.
const MOST_OF_SECOND: f32 = 1.5;
/// Points in a row that are held against each other.
const RUN: usize = 16;
/// A point is no farther from its neighbours than this many times what is usual in most of its run and the two beside it …
const MOST_OF_RUNS: f32 = 1.5;
/// … and this many times what is usual in the cloud, so that strays get no giant discs.
const MOST_OF_CLOUD: f32 = 6.0;
/// Points worked on by one thread at a time.
const PIECE: usize = 256 * RUN;

/// How far apart points are around each point of `order`, along which neighbours in space are near each other, in world
/// units; 0 where a cloud has too few points to tell.
pub(super) fn local_spacing(positions: &[Vec3], order: &[u32]) -> Vec<f32> {
    let mut spacing = vec![0.0; order.len()];
    spacing
        .par_chunks_mut(PIECE)
        .enumerate()
        .for_each(|(piece, own)| to_neighbours(positions, order, piece * PIECE, own));
    let usual_of_runs: Vec<f32> = spacing
        .par_chunks(RUN)
        .map(|run| median(run.to_vec()))
        .collect();
    let sample = SpreadOrder::new(usual_of_runs.len());
    let usual = median(
        (0..usual_of_runs.len().min(100_000))
            .map(|place| usual_of_runs[sample.at(place)])
            .collect(),
    );
    let most = if usual.is_finite() {
        usual * MOST_OF_CLOUD
    } else {
        0.0
    };
    spacing
        .par_chunks_mut(RUN)
        .enumerate()
        .for_each(|(run, own)| {
            let around = &usual_of_runs[run.saturating_sub(1)..(run + 2).min(usual_of_runs.len())];
            let most = (median(around.to_vec()) * MOST_OF_RUNS).min(most);
            own.iter_mut().for_each(|one| *one = one.min(most));
        });
    spacing
}

/// Fills in how far each point from place `first` on lies from its neighbours (infinity where it has too few); another point
/// at the very same place is none.
fn to_neighbours(positions: &[Vec3], order: &[u32], first: usize, own: &mut [f32]) {
    let begin = first.saturating_sub(REACH);
    let end = (first + own.len() + REACH).min(order.len());
    let near: Vec<Vec3> = order[begin..end]
        .iter()
        .map(|&index| positions[index as usize])
        .collect();
    for (offset, own) in own.iter_mut().enumerate() {
        let at = first + offset - begin;
        let mut nearest = [f32::INFINITY; NEIGHBOUR];
        for other in &near[at.saturating_sub(REACH)..(at + REACH + 1).min(near.len())] {
            let mut squared = other.distance_squared(near[at]);
            if squared > 0.0 && squared < nearest[NEIGHBOUR - 1] {
                for kept in &mut nearest {
                    (*kept, squared) = (kept.min(squared), kept.max(squared));
                }
            }
        }
        *own = nearest[NEIGHBOUR - 1]
            .sqrt()
            .min(nearest[1].sqrt() * MOST_OF_SECOND);
    }
}

/// 0 for none.
fn median(mut values: Vec<f32>) -> f32 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f32::total_cmp).1
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};

    use super::*;
    use crate::z_order::ZOrder;

    /// By index of the point.
    fn spacing(positions: &[Vec3]) -> Vec<f32> {
        let order = ZOrder::new(positions, positions.len(), |place| place, 1000).order;
        let along = local_spacing(positions, &order);
        let mut by_index = vec![0.0; positions.len()];
        order
            .iter()
            .zip(along)
            .for_each(|(&index, spacing)| by_index[index as usize] = spacing);
        by_index
    }

    /// Points strewn over a square, `side` × `side` of them in the mean.
    fn strewn(side: usize, width: f32) -> Vec<Vec3> {
        let mut random = rand_pcg::Pcg64::seed_from_u64(7);
        (0..side * side)
            .map(|_| Vec3::new(random.random::<f32>(), random.random::<f32>(), 0.0) * width)
            .collect()
    }

    #[test]
    fn the_spacing_of_a_plane_is_its_step_on_a_grid_and_strewn() {
        let grid: Vec<Vec3> = (0..40_000)
            .map(|i| Vec3::new((i % 200) as f32, (i / 200) as f32, 0.0) * 0.01)
            .collect();
        for (what, positions) in [("grid", grid), ("strewn", strewn(200, 2.0))] {
            let spacing = spacing(&positions);
            let usual = median(spacing.clone());
            assert!((0.0095..0.0145).contains(&usual), "{what}: {usual}");
            let near = spacing
                .iter()
                .filter(|one| (0.006..0.02).contains(*one))
                .count();
            assert!(near * 100 >= spacing.len() * 90, "{what}: {near}");
        }
    }

    #[test]
    fn each_half_of_a_cloud_has_its_own_spacing_and_strays_none_of_their_own() {
        let mut positions = strewn(150, 1.0);
        let dense = positions.len();
        positions.extend(strewn(40, 1.0).into_iter().map(|x| x - Vec3::X));
        let sparse = positions.len();
        positions.extend([Vec3::splat(30.0), Vec3::new(-20.0, 9.0, 1.0), Vec3::NAN]);
        let spacing = spacing(&positions);
        let share = |range: std::ops::Range<usize>, step: f32| {
            let near = spacing[range.clone()]
                .iter()
                .filter(|one| (0.5 * step..2.0 * step).contains(*one))
                .count();
            near * 100 / range.len()
        };
        assert!(
            share(0..dense, 1.0 / 150.0) >= 90,
            "{}",
            share(0..dense, 1.0 / 150.0)
        );
        assert!(
            share(dense..sparse, 1.0 / 40.0) >= 85,
            "{}",
            share(dense..sparse, 1.0 / 40.0)
        );
        assert!(
            spacing[sparse..].iter().all(|&one| one < 0.06),
            "{:?}",
            &spacing[sparse..]
        );
    }

    #[test]
    fn too_few_points_have_no_spacing_and_doubles_do_not_count() {
        assert_eq!(spacing(&[Vec3::ONE, Vec3::X]), [0.0; 2]);
        let square = strewn(60, 1.0);
        let twice: Vec<Vec3> = square.iter().flat_map(|&x| [x; 3]).collect();
        assert!(median(spacing(&twice)) > 1.0 / 60.0 * 0.6);
    }
}
