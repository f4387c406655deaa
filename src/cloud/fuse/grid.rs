use std::hash::BuildHasherDefault;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::layers::merge_layers;
use super::lift::{Lift, LiftCount};
use super::voxel_map::{SHARDS, VoxelMap};
use crate::morton;
use ostra_core::job::{Progress, Stopped};

/// Rows of a picture that one task lifts.
const BLOCK_ROWS: u32 = 16;
/// Steps into which a voxel's edge is cut for summing positions.
pub(super) const FRACTION: f32 = 4096.0;
/// Steps of a normal's component.
const NORMAL_STEPS: f32 = 1024.0;
/// Samples that a voxel takes, enough for a mean that another does not move. The sums stay within 32 bits, with those of the six
/// neighbours that may give theirs to it.
const MAX_SAMPLES: u32 = 1 << 15;
/// Samples whose voxels are looked up together.
const LOOKED_UP: usize = 64;
/// Voxels from the origin in each direction that the grid reaches.
const REACH: i32 = 1 << 20;
/// Where the indices along x, y and z begin in a key.
pub(super) const AXIS_SHIFTS: [u32; 3] = [42, 21, 0];

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

/// A place in the grid: voxel, and where in it in 1 / 4096 of its edge.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cell {
    pub(super) index: [i32; 3],
    pub(super) fraction: [u16; 3],
}

/// One pixel lifted to 3-D.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    key: u64,
    fraction: [u16; 3],
    normal: [i16; 3],
    color: [u8; 3],
}

/// Sums over the samples of one voxel.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Voxel {
    pub(super) fraction: [i32; 3],
    pub(super) color: [u32; 3],
    pub(super) normal: [i32; 3],
    pub(super) samples: u32,
    pub(super) views: u32,
    pub(super) last_frame: u32,
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

impl Cell {
    /// The cell that holds a point in grid units; `None` beyond the grid.
    pub(super) fn holding(in_grid: Vec3) -> Option<Self> {
        if !in_grid.abs().cmplt(Vec3::splat(REACH as f32 - 1.0)).all() {
            return None;
        }
        // Rounding down by hand: without the processor's own instruction `floor` is a call for every number.
        let index = in_grid.to_array().map(|at| {
            let whole = at as i32;
            whole - i32::from(whole as f32 > at)
        });
        let fraction = (in_grid - glam::IVec3::from_array(index).as_vec3()) * FRACTION;
        Some(Self {
            index,
            fraction: fraction.to_array().map(|f| f as u16),
        })
    }
}

impl Sample {
    pub(super) fn new(key: u64, fraction: [u16; 3], color: [u8; 3], normal: Vec3) -> Self {
        Self {
            key,
            fraction,
            color,
            normal: (normal * NORMAL_STEPS).to_array().map(|n| n as i16),
        }
    }
}

/// A voxel's index in one number, 21 bits a direction.
pub(super) fn cell_key(index: [i32; 3]) -> u64 {
    index
        .iter()
        .fold(0, |key, &i| key << 21 | (i + REACH) as u64)
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

impl Voxel {
    pub(super) fn mean_normal(&self) -> Vec3 {
        Vec3::from_array(self.normal.map(|n| n as f32)).normalize_or_zero()
    }
}

fn cell_index(key: u64) -> DVec3 {
    DVec3::from_array(AXIS_SHIFTS.map(|shift| f64::from((key >> shift & 0x1F_FFFF) as i32 - REACH)))
}
