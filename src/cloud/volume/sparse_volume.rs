//! The options of a volume, and its blocks by place.

use glam::{DVec3, IVec3};
use rustc_hash::FxHashMap;
use serde::{Deserialize, Serialize};

use super::block::{Block, EDGE};

/// How depth maps become a surface.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct VolumeOptions {
    /// Edge of a voxel in voxels' world units, above 0.
    pub voxel: f64,
    /// Distance from the surface up to which voxels are kept, in voxels, 2 to 16: wide enough for the noise of the
    /// depths, narrower than the thinnest thing is thick.
    pub truncation: f32,
    /// A difference of depth up to this share is one surface, 0–1; pixels with no such neighbour along either axis fly
    /// between two surfaces and are left out.
    pub edge_tolerance: f32,
    /// What frames must have seen of the surface, as a sum over them of the squared cosine between ray and normal: 1 =
    /// one frame from straight above; 0 or more.
    pub min_weight: f32,
    /// Make voxels only near labelled pixels; frames without a mask make none.
    pub only_labelled: bool,
    /// Memory that the voxels may take; a surface that needs more is refused.
    pub max_bytes: usize,
    /// Separate pieces with fewer triangles are left out.
    pub min_triangles: usize,
    /// But not those of which some place was seen well: a grain is small, too. For measured depths; where they are made by
    /// comparing pictures, several may see the same thing that is not there.
    pub keep_well_seen: bool,
}

impl Default for VolumeOptions {
    fn default() -> Self {
        Self {
            voxel: 0.005,
            truncation: 3.0,
            edge_tolerance: 0.03,
            min_weight: 0.25,
            only_labelled: false,
            max_bytes: 2 << 30,
            min_triangles: 64,
            keep_well_seen: true,
        }
    }
}

impl VolumeOptions {
    /// Voxels along the edge of a block, the unit in which voxels are made, and the bytes that a block takes at least.
    pub const BLOCK: (u32, usize) = (EDGE as u32, Block::BYTES);

    /// For depths made by comparing pictures: they lie closer to the surface than a sensor's, but several views may see the
    /// same thing that is not there, so a surface takes more than one of them.
    #[must_use]
    pub fn for_stereo() -> Self {
        Self {
            truncation: 2.0,
            min_weight: 0.5,
            min_triangles: 32,
            keep_well_seen: false,
            ..Self::default()
        }
    }
}

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
