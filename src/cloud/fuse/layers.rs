use glam::Vec3;
use rayon::prelude::*;

use super::grid::{AXIS_SHIFTS, FRACTION, Voxel};
use super::voxel_map::{VoxelMap, shard_of};
use ostra_core::job::{Progress, Stopped};

/// Cosine between the normals of two voxels from which they can be one surface: the other side of a leaf is another one.
const SAME_SIDE: f32 = 0.5;
/// Share of the squared distance between two voxels that lies along the normal where one is behind the other. Neighbours on a
/// slanted surface lie next to each other instead.
const ALONG_NORMAL: f32 = 0.5;
/// Distance along the normal up to which two layers are one surface, in voxels.
const ONE_SURFACE: f32 = 1.0;

/// Voxels by key, in parts that are filled in parallel.
type Shards = [VoxelMap];

/// Gives the samples of a voxel to the neighbour before or behind it that has more, where both are the same surface: noise of
/// depths and poses, and a surface along the border of two voxels, would otherwise make two points of one. Returns how many
/// voxels went. What is decided depends on the sums alone, not on any order.
pub(super) fn merge_layers(shards: &mut Shards, progress: &Progress) -> Result<usize, Stopped> {
    let all: &Shards = shards;
    let stronger: Vec<VoxelMap<u64>> = all
        .par_iter()
        .map(|shard| {
            progress.check()?;
            Ok(shard
                .iter()
                .filter_map(|(&key, voxel)| Some((key, stronger_layer(all, key, voxel)?)))
                .collect())
        })
        .collect::<Result<_, Stopped>>()?;
    let mut merged = 0;
    for (shard, targets) in stronger.iter().enumerate() {
        progress.check()?;
        for (key, target) in targets {
            // A voxel that gives its own samples away takes none: they would move by more than one voxel.
            if stronger[shard_of(*target)].contains_key(target) {
                continue;
            }
            let Some(voxel) = shards[shard].remove(key) else {
                continue;
            };
            if let Some(taking) = shards[shard_of(*target)].get_mut(target) {
                taking.take(&voxel, offset(*key, *target));
                merged += 1;
            }
        }
    }
    Ok(merged)
}

/// The neighbour along the normal that is the same surface and has more samples, if any.
fn stronger_layer(shards: &Shards, key: u64, voxel: &Voxel) -> Option<u64> {
    let normal = voxel.mean_normal();
    if normal == Vec3::ZERO {
        return None;
    }
    let step = 1u64 << AXIS_SHIFTS[normal.abs().max_position()];
    let mut best: Option<(u64, u32)> = None;
    for other in [key.wrapping_add(step), key.wrapping_sub(step)] {
        let Some(found) = shards[shard_of(other)].get(&other) else {
            continue;
        };
        let is_stronger = (found.samples, key) > (voxel.samples, other);
        let is_better = best.is_none_or(|best| (found.samples, best.0) > (best.1, other));
        if is_stronger && is_better && is_same_surface(voxel, normal, found, offset(other, key)) {
            best = Some((other, found.samples));
        }
    }
    best.map(|(other, _)| other)
}

fn is_same_surface(voxel: &Voxel, normal: Vec3, other: &Voxel, offset: [i32; 3]) -> bool {
    let way = other.mean_place() + Vec3::from_array(offset.map(|o| o as f32)) - voxel.mean_place();
    let along = way.dot(normal);
    normal.dot(other.mean_normal()) >= SAME_SIDE
        && along.abs() <= ONE_SURFACE
        && along * along >= ALONG_NORMAL * way.length_squared()
}

/// Voxels from `origin` to `key` along each axis; they are neighbours.
fn offset(key: u64, origin: u64) -> [i32; 3] {
    AXIS_SHIFTS.map(|shift| {
        let index = |key: u64| (key >> shift & 0x1F_FFFF) as i32;
        index(key) - index(origin)
    })
}

impl Voxel {
    /// The mean place of its samples in the voxel, 0 to 1.
    fn mean_place(&self) -> Vec3 {
        Vec3::from_array(self.fraction.map(|sum| sum as f32))
            / (self.samples.max(1) as f32 * FRACTION)
    }

    /// Adds the samples of a neighbour that lies `offset` voxels away. Frames that measured both count once.
    fn take(&mut self, other: &Self, offset: [i32; 3]) {
        for (axis, voxels) in offset.into_iter().enumerate() {
            self.fraction[axis] +=
                other.fraction[axis] + voxels * FRACTION as i32 * other.samples as i32;
            self.color[axis] += other.color[axis];
            self.normal[axis] += other.normal[axis];
        }
        self.samples += other.samples;
        self.views = self.views.max(other.views);
    }
}

#[cfg(test)]
mod tests {
    use super::super::grid::cell_key;
    use super::super::voxel_map::SHARDS;
    use super::*;

    /// A voxel that faces `normal`, its samples at `height` along z.
    fn voxel(height: f32, samples: u32, normal: [i32; 3]) -> Voxel {
        let half = (FRACTION / 2.0) as i32 * samples as i32;
        let at = (height * FRACTION) as i32 * samples as i32;
        let normal = normal.map(|n| n * 1024 * samples as i32);
        Voxel {
            fraction: [half, half, at],
            color: [100 * samples; 3],
            normal,
            samples,
            views: samples,
            last_frame: 0,
        }
    }

    fn merged(voxels: &[([i32; 3], Voxel)]) -> (usize, Vec<(u64, Voxel)>) {
        let mut shards = vec![VoxelMap::default(); SHARDS];
        for &(index, voxel) in voxels {
            let key = cell_key(index);
            shards[shard_of(key)].insert(key, voxel);
        }
        let count = merge_layers(&mut shards, &Progress::default()).unwrap();
        let mut left: Vec<_> = shards.into_iter().flatten().collect();
        left.sort_unstable_by_key(|&(key, _)| key);
        (count, left)
    }

    #[test]
    fn two_layers_of_one_surface_become_one_at_their_mean() {
        let up = [0, 0, 1];
        let (count, left) = merged(&[
            ([4, 4, 7], voxel(0.9, 30, up)),
            ([4, 4, 8], voxel(0.1, 10, up)),
        ]);
        assert_eq!((count, left.len(), left[0].0), (1, 1, cell_key([4, 4, 7])));
        let sum = left[0].1;
        assert_eq!((sum.samples, sum.views, sum.color), (40, 30, [4000; 3]));
        assert!(
            (sum.mean_place().z - 0.95).abs() < 0.001,
            "{}",
            sum.mean_place()
        );
        let (down, _) = merged(&[
            ([4, 4, 7], voxel(0.9, 10, up)),
            ([4, 4, 8], voxel(0.1, 30, up)),
        ]);
        assert_eq!(down, 1, "whichever is stronger");
    }

    #[test]
    fn two_sides_of_a_leaf_and_two_surfaces_stay_apart() {
        let (leaf, _) = merged(&[
            ([4, 4, 7], voxel(0.9, 30, [0, 0, 1])),
            ([4, 4, 8], voxel(0.1, 10, [0, 0, -1])),
        ]);
        let (steps, _) = merged(&[
            ([4, 4, 7], voxel(0.1, 30, [0, 0, 1])),
            ([4, 4, 8], voxel(0.9, 10, [0, 0, 1])),
        ]);
        let (next, _) = merged(&[
            ([4, 4, 7], voxel(0.5, 30, [0, 0, 1])),
            ([5, 4, 7], voxel(0.5, 10, [0, 0, 1])),
        ]);
        assert_eq!((leaf, steps, next), (0, 0, 0));
    }

    #[test]
    fn no_samples_move_by_more_than_a_voxel() {
        let up = [0, 0, 1];
        let layers = [9, 20, 30].map(|samples| voxel(0.5, samples, up));
        let (count, left) = merged(&[
            ([4, 4, 7], layers[0]),
            ([4, 4, 8], layers[1]),
            ([4, 4, 9], layers[2]),
        ]);
        assert_eq!(
            (count, left.len()),
            (1, 2),
            "the weakest stays, its neighbour went to the strongest"
        );
        assert_eq!(left.iter().map(|(_, voxel)| voxel.samples).sum::<u32>(), 59);
    }
}
