use glam::{DVec3, IVec3};
use rustc_hash::FxHashMap;

use super::block::{Block, EDGE};
use super::options::VolumeOptions;

/// Signed distances near surfaces, in blocks of voxels that are made where frames see something: memory grows with the
/// surface. (M. Nießner et al., *Real-time 3D Reconstruction at Scale using Voxel Hashing*, SIGGRAPH Asia 2013.)
#[derive(Debug)]
pub(super) struct Volume {
    pub(super) options: VolumeOptions,
    /// Where block (0, 0, 0) begins in the world.
    pub(super) origin: DVec3,
    /// In the order in which they were made.
    pub(super) blocks: Vec<Block>,
    places: FxHashMap<IVec3, u32>,
    pub(super) frames: u32,
}

impl Volume {
    /// An empty volume, its voxels counted from the point `near`.
    pub(super) fn new(near: DVec3, options: VolumeOptions) -> Self {
        let origin = (near / options.voxel).floor() * options.voxel;
        Self {
            options,
            origin,
            blocks: Vec::new(),
            places: FxHashMap::default(),
            frames: 0,
        }
    }

    /// Distance from the surface up to which voxels are kept, world units.
    pub(super) fn truncation(&self) -> f32 {
        self.options.truncation * self.options.voxel as f32
    }

    /// Where a block's first voxel lies in the world.
    pub(super) fn corner(&self, place: IVec3) -> DVec3 {
        self.origin + place.as_dvec3() * (EDGE as f64 * self.options.voxel)
    }

    pub(super) fn block(&self, place: IVec3) -> Option<usize> {
        self.places.get(&place).map(|&index| index as usize)
    }

    /// Notes that the frame of this number comes near to these blocks; those that are missing are made.
    pub(super) fn touch(&mut self, places: &[IVec3], frame: u32) {
        for &place in places {
            let index = *self.places.entry(place).or_insert_with(|| {
                self.blocks.push(Block::new(place));
                (self.blocks.len() - 1) as u32
            });
            self.blocks[index as usize].frame = frame;
        }
    }

    /// What the blocks take.
    pub(super) fn bytes(&self) -> usize {
        self.blocks.iter().map(Block::bytes).sum()
    }
}
