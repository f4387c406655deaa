//! The grid that averages lifted pixels, and the layers of one surface in it.

use std::hash::BuildHasherDefault;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::lift::{Lift, LiftCount};
use super::voxel_map::{
    AXIS_SHIFTS, FRACTION, SHARDS, Sample, Voxel, VoxelMap, cell_index, shard_of,
};
use crate::morton;
use ostra_core::job::{Progress, Stopped};

/// Rows of a picture that one task lifts.
const BLOCK_ROWS: u32 = 16;
/// Samples that a voxel takes, enough for a mean that another does not move. The sums stay within 32 bits, with those of the six
/// neighbours that may give theirs to it.
const MAX_SAMPLES: u32 = 1 << 15;
/// Samples whose voxels are looked up together.
const LOOKED_UP: usize = 64;
/// A hashed voxel grid that averages what falls into each voxel. All sums are integers, so the result does not depend on
/// the order in which threads add to it.
pub(super) struct Grid {
    origin: DVec3,
    voxel: f64,
    shards: Vec<VoxelMap>,
    blocks: Vec<Block>,
    frames: u32,
}

/// Samples of some rows, by shard, and what became of their pixels; kept from frame to frame for its memory.
struct Block {
    samples: Vec<Vec<Sample>>,
    count: LiftCount,
}

/// The points of a grid, in Morton order of their voxels so that neighbours in the list are neighbours in space.
#[derive(Debug, Default, PartialEq)]
pub(super) struct GridPoints {
    pub(super) positions: Vec<Vec3>,
    pub(super) normals: Vec<Vec3>,
    pub(super) colors: Vec<[u8; 3]>,
    /// Voxels left out because too few frames measured them.
    pub(super) few_views: usize,
    /// Voxels that were another layer of a surface and became part of a neighbour.
    pub(super) merged: usize,
}

impl Grid {
    /// An empty grid of voxels with edge `voxel`, counted from the point `near`, with room for about so many of them.
    pub(super) fn new(near: DVec3, voxel: f64, expected: usize) -> Self {
        let room =
            || VoxelMap::with_capacity_and_hasher(expected / SHARDS, BuildHasherDefault::default());
        let shards = (0..SHARDS).map(|_| room()).collect();
        Self {
            origin: (near / voxel).floor() * voxel,
            voxel,
            shards,
            blocks: Vec::new(),
            frames: 0,
        }
    }

    /// The grid's origin in the world, and the edge of its voxels.
    pub(super) fn frame(&self) -> (DVec3, f64) {
        (self.origin, self.voxel)
    }

    /// Adds all pixels of one frame of `height` rows.
    pub(super) fn add(
        &mut self,
        lift: &Lift<'_>,
        height: u32,
        progress: &Progress,
    ) -> Result<LiftCount, Stopped> {
        let blocks = height.div_ceil(BLOCK_ROWS) as usize;
        let empty = || Block {
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
        let sum = |a: LiftCount, b: &Block| LiftCount {
            measured: a.measured + b.count.measured,
            flying: a.flying + b.count.flying,
            beyond: a.beyond + b.count.beyond,
        };
        Ok(blocks.iter().fold(LiftCount::default(), sum))
    }

    /// Number of voxels that hold samples.
    pub(super) fn voxels(&self) -> usize {
        self.shards.iter().map(VoxelMap::len).sum()
    }

    /// The mean of each voxel that at least `min_views` frames measured; with `one_layer` one for each place of a surface.
    pub(super) fn into_points(
        mut self,
        min_views: u32,
        one_layer: bool,
        progress: &Progress,
    ) -> Result<GridPoints, Stopped> {
        let (origin, voxel) = self.frame();
        self.blocks = Vec::new();
        let merged = if one_layer {
            merge_layers(&mut self.shards, progress)?
        } else {
            0
        };
        let filled = self.voxels();
        // With their place along the curve, which is worked out once for each.
        let mut kept: Vec<(u64, u64, Voxel)> = Vec::with_capacity(filled);
        for shard in self.shards {
            progress.check()?;
            let seen = shard
                .into_iter()
                .filter(|(_, voxel)| voxel.views >= min_views);
            kept.extend(seen.map(|(key, voxel)| (morton([key >> 42, key >> 21, key]), key, voxel)));
        }
        kept.par_sort_unstable_by_key(|&(place, ..)| place);
        let position = |&(_, key, sum): &(u64, u64, Voxel)| {
            // Fractions were cut off to whole steps, on average by half a step.
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

/// Adds one block's samples.
fn add_samples(voxels: &mut VoxelMap, samples: &[Sample], frame: u32) {
    for piece in samples.chunks(LOOKED_UP) {
        // Looked up one right after the other, so that the processor waits for the memory of several voxels at once.
        let known = piece
            .chunk_by(|a, b| a.key == b.key)
            .filter(|run| voxels.contains_key(&run[0].key))
            .count();
        std::hint::black_box(known);
        add_piece(voxels, piece, frame);
    }
}

/// Runs in the same voxel are summed before the voxel is looked up.
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
    use super::*;
    use crate::fuse::voxel_map::{SHARDS, cell_key};

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
