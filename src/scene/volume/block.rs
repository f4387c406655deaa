use glam::{IVec3, Vec3};

use super::measured::Pixel;

/// Voxels along an edge of a block.
pub(super) const EDGE: usize = 8;
/// Voxels in a block.
pub(super) const VOXELS: usize = EDGE * EDGE * EDGE;
/// Surfaces whose normals differ by more than this cosine are two sides of something thin.
const SAME_SIDE: f32 = -0.3;
/// Sum of weights beyond which a mean moves no more slowly.
const MOST_WEIGHT: f32 = 255.0;
/// What a frame counts that sees far past a voxel: at the rim of something thin half a pixel decides whether it does.
const PAST: f32 = 0.05;

/// Times better that one layer of a voxel was seen than another that then is none.
const FAR_WORSE: u8 = 4;

/// A cube of voxels, x running fastest. A voxel is a sample at its lower corner, in up to two layers: a thin sheet is seen
/// from both sides, and what is before it from the one is behind it from the other (after M. Splietker, S. Behnke,
/// *Directional TSDF: Modeling Surface Orientation for Coherent Meshes*, IROS 2019, with two sides a voxel for six in all).
#[derive(Debug, Clone)]
pub(super) struct Block {
    /// Place of the block, in blocks from the volume's origin.
    pub(super) place: IVec3,
    /// The number of the last frame that came near.
    pub(super) frame: u32,
    first: Box<[Voxel; VOXELS]>,
    /// Made where something is seen from two sides.
    second: Option<Box<[Voxel; VOXELS]>>,
}

/// One side of a surface near a sample.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Voxel {
    /// Signed distance from the surface in truncations, −1 (behind) to 1 (before); the mean of what frames say.
    pub(super) distance: f32,
    /// Sum of the frames' weights; 0 = unseen.
    pub(super) weight: f32,
    /// Mean colour in steps of 1/256 of sRGB's.
    color: [u16; 3],
    /// The normal of the frame that saw most of it, in steps of 1/127, and that frame's weight in steps of 1/255.
    normal: [i8; 3],
    sight: u8,
}

impl Block {
    pub(super) fn new(place: IVec3) -> Self {
        Self { place, frame: 0, first: Box::new([Voxel::default(); VOXELS]), second: None }
    }

    /// The layers of a voxel that were seen.
    fn layers(&self, voxel: usize) -> [Option<&Voxel>; 2] {
        let second = self.second.as_ref().map(|layer| &layer[voxel]);
        [Some(&self.first[voxel]), second].map(|layer| layer.filter(|layer| layer.weight > 0.0))
    }

    /// The layers of a voxel that are sides of a surface: where one was seen well, another that was only seen from its rim
    /// is none.
    pub(super) fn sides(&self, voxel: usize) -> [Option<&Voxel>; 2] {
        let layers = self.layers(voxel);
        let best = layers.into_iter().flatten().map(|layer| layer.sight).max().unwrap_or(0);
        layers.map(|layer| layer.filter(|layer| layer.sight >= best / FAR_WORSE))
    }

    /// Adds what a pixel says of a voxel: `distance` in truncations, −1 or more.
    pub(super) fn update(&mut self, voxel: usize, distance: f32, weight: f32, pixel: &Pixel) {
        if distance >= 1.0 {
            let second = self.second.as_mut().map(|layer| &mut layer[voxel]);
            for layer in [Some(&mut self.first[voxel]), second].into_iter().flatten().filter(|layer| layer.weight > 0.0)
            {
                layer.pull(1.0, weight * PAST);
            }
            return;
        }
        let side = self.layers(voxel).map(|layer| layer.map(|layer| layer.normal().dot(pixel.normal)));
        let layer = match side {
            [None, _] => &mut self.first,
            [Some(first), None] if first > SAME_SIDE => &mut self.first,
            [Some(_), None] => self.second.get_or_insert_with(|| Box::new([Voxel::default(); VOXELS])),
            [Some(first), Some(second)] if first >= second => &mut self.first,
            [Some(_), Some(_)] => self.second.get_or_insert_with(|| Box::new([Voxel::default(); VOXELS])),
        };
        layer[voxel].see(distance, weight, pixel);
    }

    /// What the block takes.
    pub(super) fn bytes(&self) -> usize {
        size_of::<Self>() + (1 + usize::from(self.second.is_some())) * VOXELS * size_of::<Voxel>()
    }
}

impl Voxel {
    fn pull(&mut self, distance: f32, weight: f32) {
        self.distance += (distance - self.distance) * (weight / (self.weight + weight));
        self.weight = (self.weight + weight).min(MOST_WEIGHT);
    }

    fn see(&mut self, distance: f32, weight: f32, pixel: &Pixel) {
        let share = weight / (self.weight + weight);
        for (mean, new) in self.color.iter_mut().zip(pixel.color) {
            let old = f32::from(*mean);
            *mean = (old + (f32::from(new) * 256.0 - old) * share + 0.5) as u16;
        }
        let sight = (pixel.weight * 255.0) as u8;
        if self.weight == 0.0 || sight > self.sight {
            (self.normal, self.sight) = (pixel.normal.to_array().map(|along| (along * 127.0) as i8), sight);
        }
        self.pull(distance, weight);
    }

    pub(super) fn normal(&self) -> Vec3 {
        Vec3::from_array(self.normal.map(f32::from)) / 127.0
    }

    /// sRGB.
    pub(super) fn color(&self) -> Vec3 {
        Vec3::from_array(self.color.map(f32::from)) / 256.0
    }

    /// Whether this may be the same side of a surface as one with this normal.
    pub(super) fn agrees(&self, normal: Vec3) -> bool {
        self.normal().dot(normal) > SAME_SIDE
    }
}

/// Place of a voxel within its block.
pub(super) const fn voxel_at(x: usize, y: usize, z: usize) -> usize {
    (z * EDGE + y) * EDGE + x
}
