use glam::Mat3;

use super::pyramid::{Level, Pyramid};
use ostra_geometry::Pose;

/// The level that agreement is looked at on.
const LEVEL: usize = 1;
/// Share of the depth by which surfaces may differ and be the same.
const TOLERANCE: f32 = 0.03;
/// Standard deviation of luma below which likeness of the pictures tells nothing.
const LEAST_TEXTURE: f64 = 0.02;

/// How well what two views see fits together under a pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Agreement {
    /// Share of the source's pixels of known depth that lie on what the target sees, 0–1.
    pub overlap: f64,
    /// Of the pixels on or in front of what the target sees: the share on it, 0–1. What stands in front would hide what the
    /// target sees behind it.
    pub consistent: f64,
    /// Correlation of the two pictures where they show the same, −1 to 1; 1 where that has no texture.
    pub likeness: f64,
}

impl Agreement {
    /// Both directions in one: the lesser of each.
    #[must_use]
    pub fn of(source: &Pyramid, target: &Pyramid, target_from_source: &Pose) -> Self {
        let one = seen_by(
            &source.levels[LEVEL],
            &target.levels[LEVEL],
            target_from_source,
        );
        let other = seen_by(
            &target.levels[LEVEL],
            &source.levels[LEVEL],
            &target_from_source.inverse(),
        );
        Self {
            overlap: one.overlap.max(other.overlap),
            consistent: one.consistent.min(other.consistent),
            likeness: one.likeness.min(other.likeness),
        }
    }
}

fn seen_by(source: &Level, target: &Level, pose: &Pose) -> Agreement {
    let rotation = Mat3::from_quat(pose.rotation.as_quat());
    let shift = pose.translation.as_vec3();
    let (mut known, mut same, mut before) = (0u32, 0u32, 0u32);
    let mut moments = Moments::default();
    for y in 0..source.height {
        for x in 0..source.width {
            let pixel = y * source.width + x;
            let depth = source.depths[pixel];
            if depth <= 0.0 {
                continue;
            }
            known += 1;
            let point = rotation * (source.ray(x, y) * depth) + shift;
            let Some(at_px) = target.project(point) else {
                continue;
            };
            let there = target.depths[at_px.y as usize * target.width + at_px.x as usize];
            if there <= 0.0 {
                continue;
            }
            if (there - point.z).abs() < TOLERANCE * there {
                same += 1;
                if let Some((seen, _)) = target.grey_at(at_px) {
                    moments.add(f64::from(source.grey[pixel]), f64::from(seen));
                }
            } else if point.z < there {
                before += 1;
            }
        }
    }
    Agreement {
        overlap: f64::from(same) / f64::from(known.max(1)),
        consistent: f64::from(same) / f64::from((same + before).max(1)),
        likeness: moments.correlation(),
    }
}

/// Sums for a correlation.
#[derive(Default)]
struct Moments {
    count: f64,
    sums: [f64; 2],
    products: [f64; 3],
}

impl Moments {
    fn add(&mut self, a: f64, b: f64) {
        self.count += 1.0;
        self.sums = [self.sums[0] + a, self.sums[1] + b];
        self.products = [
            self.products[0] + a * a,
            self.products[1] + a * b,
            self.products[2] + b * b,
        ];
    }

    fn correlation(&self) -> f64 {
        let count = self.count.max(1.0);
        let [a, b] = self.sums.map(|sum| sum / count);
        let [aa, ab, bb] = self.products.map(|sum| sum / count);
        let (spread_a, spread_b) = ((aa - a * a).max(0.0).sqrt(), (bb - b * b).max(0.0).sqrt());
        if spread_a.max(spread_b) < LEAST_TEXTURE {
            return 1.0;
        }
        (ab - a * b) / (spread_a * spread_b).max(1e-9)
    }
}
