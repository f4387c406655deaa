use bytemuck::{Pod, Zeroable};

/// What all shaders know of the camera.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct EyeUniform {
    pub clip_from_world: [[f32; 4]; 4],
    /// Takes the inside of the clip box to the cube from -1 to 1.
    pub cube_from_world: [[f32; 4]; 4],
    /// Width and height in pixels, pixels per world unit at clip w = 1, one unused.
    pub view: [f32; 4],
    /// Smallest and largest disc radius in pixels, two unused.
    pub disc: [f32; 4],
    /// Where the camera is, and the light on a surface that is seen along itself.
    pub place: [f32; 4],
}

/// One point on the GPU; opacity 0 = not drawn.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct PointInstance {
    pub position: [f32; 3],
    pub color: [u8; 4],
    /// Of its disc where all points are drawn, in world units.
    pub radius: f32,
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spread_order_visits_every_point_once() {
        for count in [1, 2, 7, 100, 4096, 99_991] {
            let order = SpreadOrder::new(count);
            let mut seen = vec![false; count];
            for place in 0..count {
                assert!(
                    !std::mem::replace(&mut seen[order.at(place)], true),
                    "{count}"
                );
            }
        }
    }
}
