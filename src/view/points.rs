use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

use super::paint::Paint;
use crate::scene::LabelledCloud;

/// What all shaders know of the camera.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct EyeUniform {
    pub clip_from_world: [[f32; 4]; 4],
    /// Takes the inside of the clip box to the cube from -1 to 1.
    pub cube_from_world: [[f32; 4]; 4],
    /// Width and height in pixels, pixels per world unit at clip w = 1, disc radius in world units.
    pub view: [f32; 4],
    /// Smallest and largest disc radius in pixels, two unused.
    pub disc: [f32; 4],
    /// Where the camera is, and the light on a surface that is seen along itself.
    pub place: [f32; 4],
}

/// One point on the GPU; opacity 0 = not drawn. Lines have the same layout.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct PointInstance {
    pub position: [f32; 3],
    pub color: [u8; 4],
}

/// An order of `0..count` in which every prefix is spread evenly over the whole: multiples of the golden section.
#[derive(Debug, Clone, Copy)]
pub(super) struct SpreadOrder {
    count: u64,
    stride: u64,
}

impl SpreadOrder {
    pub(super) fn new(count: usize) -> Self {
        let count = count as u64;
        let mut stride = ((count as f64 * 0.618_033_988_75) as u64).max(1);
        while gcd(stride, count) > 1 {
            stride += 1;
        }
        Self { count, stride }
    }

    /// The element at `place`.
    pub(super) fn at(&self, place: usize) -> usize {
        (place as u64 * self.stride % self.count.max(1)) as usize
    }
}

fn gcd(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// Packs the points at `places` of the spread order.
pub(super) fn pack(
    cloud: &LabelledCloud,
    order: SpreadOrder,
    places: std::ops::Range<usize>,
    paint: &Paint,
) -> Vec<PointInstance> {
    places
        .into_par_iter()
        .map(|place| {
            let index = order.at(place);
            let color = paint.color(cloud, index).unwrap_or_default();
            PointInstance { position: cloud.positions[index].to_array(), color }
        })
        .collect()
}

/// Mean distance between neighbouring points, from how many share a cell of a coarse grid; a surface is assumed.
pub(super) fn spacing(cloud: &LabelledCloud) -> f32 {
    let order = SpreadOrder::new(cloud.len());
    let sampled = cloud.len().min(200_000);
    let sample = || (0..sampled).map(|place| cloud.positions[order.at(place)]);
    let Some(bounds) = super::Bounds::of(sample()) else { return 0.0 };
    let cell = bounds.radius() * 2.0 / 96.0;
    let cells: rustc_hash::FxHashSet<[i32; 3]> =
        sample().map(|x| ((x - bounds.min) / cell).floor().as_ivec3().to_array()).collect();
    cell * (cells.len() as f32 / cloud.len().max(1) as f32).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spread_order_visits_every_point_once() {
        for count in [1, 2, 7, 100, 4096, 99_991] {
            let order = SpreadOrder::new(count);
            let mut seen = vec![false; count];
            for place in 0..count {
                assert!(!std::mem::replace(&mut seen[order.at(place)], true), "{count}");
            }
        }
    }

    #[test]
    fn spacing_of_a_plane_is_its_grid_step() {
        let positions = (0..40_000).map(|i| glam::Vec3::new((i % 200) as f32, (i / 200) as f32, 0.0) * 0.01).collect();
        let spacing = spacing(&LabelledCloud { positions, ..Default::default() });
        assert!((0.007..0.013).contains(&spacing), "{spacing}");
    }
}
