//! The options of a volume, and its blocks by position.

use glam::{DVec3, IVec3};
use rustc_hash::FxHashMap;
use serde::{Deserialize, Serialize};

use super::block::{EDGE, VoxelBlock};

/// Options of surface reconstruction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct VolumeOptions {
    /// Edge length of a voxel in world units, above 0.
    pub voxel: f64,
    /// Maximum distance of voxels from the surface, in voxels, 2 to 16.
    ///
    /// It should exceed the noise of the depths, and be smaller than the thickness of the thinnest
    /// object.
    pub truncation: f32,
    /// Maximum depth difference between pixels of one surface, as a share of the depth, 0–1.
    ///
    /// Pixels without such a neighbour along either axis are flying pixels between two surfaces and
    /// are left out.
    pub edge_tolerance: f32,
    /// Minimum visibility of the surface, 0 or more.
    ///
    /// The visibility is the sum over frames of the squared cosine between ray and normal; one
    /// frame that looks straight at the surface gives 1.
    pub min_weight: f32,
    /// Whether voxels are allocated only near labelled pixels.
    ///
    /// Frames without a mask then allocate none.
    pub only_labelled: bool,
    /// Memory limit of the voxels in bytes; a surface that needs more is an error.
    pub max_bytes: usize,
    /// Minimum number of triangles of a connected component; smaller ones are left out.
    pub min_triangles: usize,
    /// Whether smaller components are kept if some part of them was seen well, such as a grain.
    ///
    /// This suits measured depths. With depths from stereo, several views may agree on a surface
    /// that does not exist.
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
    /// Number of voxels along the edge of a block, and the minimum size of a block in bytes.
    pub const BLOCK: (u32, usize) = (EDGE as u32, VoxelBlock::BYTES);

    /// Returns the options for depths from stereo.
    ///
    /// Stereo depths are closer to the surface than those of a sensor. However, several views may
    /// agree on a surface that does not exist, so more than one of them is required.
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

/// A sparse volume of signed distances near surfaces.
///
/// Its blocks of voxels are allocated where frames see a surface, so memory grows with the surface.
/// (M. Nießner et al., *Real-time 3D Reconstruction at Scale using Voxel Hashing*, SIGGRAPH Asia
/// 2013.)
#[derive(Debug)]
pub(super) struct Volume {
    pub(super) options: VolumeOptions,
    /// Origin of block (0, 0, 0) in world space.
    pub(super) origin: DVec3,
    /// Blocks in order of allocation.
    pub(super) blocks: Vec<VoxelBlock>,
    places: FxHashMap<IVec3, u32>,
    pub(super) frames: u32,
}

impl Volume {
    /// Creates an empty volume whose voxels are counted from the point `near`.
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

    /// Returns the maximum distance of voxels from the surface, in world units.
    pub(super) fn truncation(&self) -> f32 {
        self.options.truncation * self.options.voxel as f32
    }

    /// Returns the first voxel of a block in world space.
    pub(super) fn corner(&self, place: IVec3) -> DVec3 {
        self.origin + place.as_dvec3() * (EDGE as f64 * self.options.voxel)
    }

    pub(super) fn block(&self, place: IVec3) -> Option<usize> {
        self.places.get(&place).map(|&index| index as usize)
    }

    /// Marks blocks as near the surface of frame `frame`, allocating those that are missing.
    pub(super) fn touch(&mut self, places: &[IVec3], frame: u32) {
        for &place in places {
            let index = *self.places.entry(place).or_insert_with(|| {
                self.blocks.push(VoxelBlock::new(place));
                (self.blocks.len() - 1) as u32
            });
            self.blocks[index as usize].frame = frame;
        }
    }

    /// Returns the size of the blocks in bytes.
    pub(super) fn bytes(&self) -> usize {
        self.blocks.iter().map(VoxelBlock::bytes).sum()
    }
}
