//! The voxel grid that averages unprojected pixels, and the merging of surface layers in it.

use std::hash::BuildHasherDefault;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::lift::{DepthUnprojection, LiftCount};
use super::voxel_map::{
    AXIS_SHIFTS, FRACTION, GridFrame, SHARDS, Sample, VoxelMap, VoxelSums, cell_index, shard_of,
};
use crate::morton;
use ostra_core::job::{Progress, Stopped};

/// Number of image rows unprojected by one task.
const BLOCK_ROWS: u32 = 16;
/// Maximum number of samples per voxel, enough that one more does not change the mean.
///
/// The sums stay within 32 bits, including those of the six neighbours that may be merged into a
/// voxel.
const MAX_SAMPLES: u32 = 1 << 15;
/// Number of samples whose voxels are looked up together.
const LOOKUPS: usize = 64;

/// A hashed voxel grid that averages the samples in each voxel.
///
/// All sums are integers, so the result does not depend on the order in which threads add to it.
pub(super) struct VoxelGrid {
    frame: GridFrame,
    shards: Vec<VoxelMap>,
    blocks: Vec<ShardedSamples>,
    frames: u32,
}

/// Samples of some rows by shard, and the counts of their pixels.
///
/// Blocks are reused from frame to frame to avoid allocations.
struct ShardedSamples {
    samples: Vec<Vec<Sample>>,
    count: LiftCount,
}

/// The points of a grid, in Morton order of their voxels.
///
/// Neighbours in the list are therefore neighbours in space.
#[derive(Debug, Default, PartialEq)]
pub(super) struct GridPoints {
    pub(super) positions: Vec<Vec3>,
    pub(super) normals: Vec<Vec3>,
    pub(super) colors: Vec<[u8; 3]>,
    /// Number of voxels left out because too few frames measured them.
    pub(super) few_views: usize,
    /// Number of voxels that were another layer of a surface and were merged into a neighbour.
    pub(super) merged: usize,
}

impl VoxelGrid {
    /// Creates an empty grid of voxels with edge length `voxel`, near the point `near`.
    ///
    /// Memory is reserved for about `expected` voxels.
    pub(super) fn new(near: DVec3, voxel: f64, expected: usize) -> Self {
        let room =
            || VoxelMap::with_capacity_and_hasher(expected / SHARDS, BuildHasherDefault::default());
        let shards = (0..SHARDS).map(|_| room()).collect();
        Self {
            frame: GridFrame {
                origin: (near / voxel).floor() * voxel,
                voxel,
            },
            shards,
            blocks: Vec::new(),
            frames: 0,
        }
    }

    /// Returns the grid's origin in world space and the edge length of its voxels.
    pub(super) fn frame(&self) -> GridFrame {
        self.frame
    }

    /// Adds all pixels of one frame of `height` rows.
    pub(super) fn add(
        &mut self,
        lift: &DepthUnprojection<'_>,
        height: u32,
        progress: &Progress,
    ) -> Result<LiftCount, Stopped> {
        let blocks = height.div_ceil(BLOCK_ROWS) as usize;
        let empty = || ShardedSamples {
            samples: vec![Vec::new(); SHARDS],
            count: LiftCount::default(),
        };
        self.blocks
            .resize_with(self.blocks.len().max(blocks), empty);
        self.blocks[..blocks]
            .par_iter_mut()
            .enumerate()
            .try_for_each(|(index, block)| {
                let first = index as u32 * BLOCK_ROWS;
                block.samples.iter_mut().for_each(Vec::clear);
                block.count =
                    lift.rows(first..(first + BLOCK_ROWS).min(height), &mut block.samples);
                progress.check()
            })?;
        self.frames += 1;
        let (blocks, frame) = (&self.blocks[..blocks], self.frames);
        self.shards
            .par_iter_mut()
            .enumerate()
            .for_each(|(shard, voxels)| {
                for block in blocks {
                    add_samples(voxels, &block.samples[shard], frame);
                }
            });
        let sum = |a: LiftCount, b: &ShardedSamples| LiftCount {
            measured: a.measured + b.count.measured,
            flying: a.flying + b.count.flying,
            beyond: a.beyond + b.count.beyond,
        };
        Ok(blocks.iter().fold(LiftCount::default(), sum))
    }

    /// Returns the number of voxels that hold samples.
    pub(super) fn voxels(&self) -> usize {
        self.shards.iter().map(VoxelMap::len).sum()
    }

    /// Returns the mean of each voxel that at least `min_views` frames measured.
    ///
    /// With `one_layer`, the layers of a surface are merged first.
    pub(super) fn into_points(
        mut self,
        min_views: u32,
        one_layer: bool,
        progress: &Progress,
    ) -> Result<GridPoints, Stopped> {
        let GridFrame { origin, voxel } = self.frame;
        self.blocks = Vec::new();
        let merged = if one_layer {
            merge_layers(&mut self.shards, progress)?
        } else {
            0
        };
        let filled = self.voxels();
        // The Morton code is computed once per voxel and stored as the sort key.
        let mut kept: Vec<(u64, u64, VoxelSums)> = Vec::with_capacity(filled);
        for shard in self.shards {
            progress.check()?;
            let seen = shard
                .into_iter()
                .filter(|(_, voxel)| voxel.views >= min_views);
            kept.extend(seen.map(|(key, voxel)| (morton([key >> 42, key >> 21, key]), key, voxel)));
        }
        kept.par_sort_unstable_by_key(|&(place, ..)| place);
        let position = |&(_, key, sum): &(u64, u64, VoxelSums)| {
            // Fractions were truncated to whole steps, on average by half a step.
            let mean = |sum_of: i32| {
                (f64::from(sum_of) / f64::from(sum.samples) + 0.5) / f64::from(FRACTION)
            };
            let fraction = DVec3::from_array(sum.fraction.map(mean));
            (origin + (cell_index(key) + fraction) * voxel).as_vec3()
        };
        Ok(GridPoints {
            positions: kept.par_iter().map(position).collect(),
            normals: kept.par_iter().map(|(.., sum)| sum.mean_normal()).collect(),
            colors: kept
                .par_iter()
                .map(|(.., sum)| {
                    sum.color
                        .map(|c| ((c + sum.samples / 2) / sum.samples) as u8)
                })
                .collect(),
            few_views: filled - kept.len(),
            merged,
        })
    }
}

/// Adds the samples of one block.
fn add_samples(voxels: &mut VoxelMap, samples: &[Sample], frame: u32) {
    for piece in samples.chunks(LOOKUPS) {
        // Looking the keys up one right after the other lets the processor wait for the memory of
        // several voxels at once.
        let known = piece
            .chunk_by(|a, b| a.key == b.key)
            .filter(|run| voxels.contains_key(&run[0].key))
            .count();
        std::hint::black_box(known);
        add_piece(voxels, piece, frame);
    }
}

/// Adds samples to their voxels.
///
/// Consecutive samples of the same voxel share one lookup.
fn add_piece(voxels: &mut VoxelMap, samples: &[Sample], frame: u32) {
    for run in samples.chunk_by(|a, b| a.key == b.key) {
        let voxel = voxels.entry(run[0].key).or_default();
        for sample in run {
            if voxel.samples == MAX_SAMPLES {
                break;
            }
            for axis in 0..3 {
                voxel.fraction[axis] += i32::from(sample.fraction[axis]);
                voxel.color[axis] += u32::from(sample.color[axis]);
                voxel.normal[axis] += i32::from(sample.normal[axis]);
            }
            voxel.samples += 1;
        }
        voxel.views += u32::from(voxel.last_frame != frame);
        voxel.last_frame = frame;
    }
}

/// Minimum cosine between the normals of two voxels of one surface.
///
/// The other side of a leaf is another surface.
const SAME_SIDE: f32 = 0.5;
/// Minimum share along the normal of the squared distance between two voxels of different layers.
///
/// Neighbours on a slanted surface lie next to each other instead.
const ALONG_NORMAL: f32 = 0.5;
/// Maximum distance along the normal between two layers of one surface, in voxels.
const ONE_SURFACE: f32 = 1.0;

/// Voxels by key, in shards that are filled in parallel.
type Shards = [VoxelMap];

/// Merges each voxel into the neighbour along its normal that has more samples, if any.
///
/// Both must belong to the same surface. Otherwise the noise of depths and poses, or a surface
/// along the border of two voxels, would make two points of one. Returns the number of merged
/// voxels. The decision depends only on the sums, not on any order.
fn merge_layers(shards: &mut Shards, progress: &Progress) -> Result<usize, Stopped> {
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
            // A voxel that is merged itself takes no samples: they would move by more than one
            // voxel.
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

/// Returns the neighbour along the normal that is the same surface and has more samples, if any.
fn stronger_layer(shards: &Shards, key: u64, voxel: &VoxelSums) -> Option<u64> {
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

fn is_same_surface(voxel: &VoxelSums, normal: Vec3, other: &VoxelSums, offset: [i32; 3]) -> bool {
    let way = other.mean_place() + Vec3::from_array(offset.map(|o| o as f32)) - voxel.mean_place();
    let along = way.dot(normal);
    normal.dot(other.mean_normal()) >= SAME_SIDE
        && along.abs() <= ONE_SURFACE
        && along * along >= ALONG_NORMAL * way.length_squared()
}

/// Returns the number of voxels from `origin` to its neighbour `key` along each axis.
fn offset(key: u64, origin: u64) -> [i32; 3] {
    AXIS_SHIFTS.map(|shift| {
        let index = |key: u64| (key >> shift & 0x1F_FFFF) as i32;
        index(key) - index(origin)
    })
}

impl VoxelSums {
    /// Returns the mean position of the samples within the voxel, 0 to 1.
    fn mean_place(&self) -> Vec3 {
        Vec3::from_array(self.fraction.map(|sum| sum as f32))
            / (self.samples.max(1) as f32 * FRACTION)
    }

    /// Adds the samples of a neighbour that lies `offset` voxels away.
    ///
    /// `views` becomes the larger of the two counts, so that frames that measured both voxels count
    /// once.
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
    use super::*;
    use crate::fuse::voxel_map::{SHARDS, cell_key};

    /// Returns a voxel that faces `normal`, with its samples at `height` along z.
    fn voxel(height: f32, samples: u32, normal: [i32; 3]) -> VoxelSums {
        let half = (FRACTION / 2.0) as i32 * samples as i32;
        let at = (height * FRACTION) as i32 * samples as i32;
        let normal = normal.map(|n| n * 1024 * samples as i32);
        VoxelSums {
            fraction: [half, half, at],
            color: [100 * samples; 3],
            normal,
            samples,
            views: samples,
            last_frame: 0,
        }
    }

    fn merged(voxels: &[([i32; 3], VoxelSums)]) -> (usize, Vec<(u64, VoxelSums)>) {
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
    fn two_layers_of_one_surface_merge_at_their_mean() {
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
    fn two_sides_of_a_leaf_and_two_surfaces_are_not_merged() {
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
    fn samples_move_by_at_most_one_voxel() {
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
