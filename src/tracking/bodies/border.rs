use glam::Vec3;

/// Angles between normals that say nothing, degrees.
const EVEN_DEG: f32 = 10.0;
/// A ridge bent by this much more counts as a full border.
const RIDGE_DEG: f32 = 200.0;

/// Where two supervoxels touch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Border {
    pub a: u32,
    pub b: u32,
    /// Pairs of voxels that touch.
    pub length: f32,
    /// Angle between the normals, degrees: above 0 over a ridge, below in a groove.
    pub bend_deg: f32,
    /// Difference of colour, ΔE with half the lightness: shade falls within one thing.
    pub color: f32,
}

/// How much bends and colours count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Judgement {
    /// A groove bent by this much more than nothing is a full border, degrees.
    pub groove_deg: f32,
    /// A difference of colour that is a full border, ΔE.
    pub color: f32,
}

impl Judgement {
    /// How likely one thing ends and another begins at a border, from 0; 1 is a full border. A groove is where things meet, a
    /// ridge is mostly one thing's own edge (Stein, Schoeler, Papon, Wörgötter, "Object partitioning using local convexity",
    /// CVPR 2014).
    pub fn strength(&self, border: &Border) -> f32 {
        let bend = (border.bend_deg.abs() - EVEN_DEG).max(0.0);
        let shape = if border.bend_deg < 0.0 {
            (bend / self.groove_deg).min(1.0)
        } else {
            bend / RIDGE_DEG
        };
        shape + border.color / self.color
    }
}

/// Angle between the normals of two places, degrees, below 0 in a groove; 0 where one has no normal.
pub fn bend_deg((place_a, normal_a): (Vec3, Vec3), (place_b, normal_b): (Vec3, Vec3)) -> f32 {
    if normal_a == Vec3::ZERO || normal_b == Vec3::ZERO {
        return 0.0;
    }
    let bend = normal_a.angle_between(normal_b).to_degrees();
    if (normal_a - normal_b).dot(place_a - place_b) < 0.0 {
        -bend
    } else {
        bend
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_groove_parts_and_a_ridge_does_not() {
        let (left, right) = (Vec3::NEG_X, Vec3::X);
        let (leaning, away) = (
            Vec3::new(1.0, 0.0, 1.0).normalize(),
            Vec3::new(-1.0, 0.0, 1.0).normalize(),
        );
        let groove = bend_deg((left, leaning), (right, away));
        let ridge = bend_deg((left, away), (right, leaning));
        assert!(
            (groove + 90.0).abs() < 0.1 && (ridge - 90.0).abs() < 0.1,
            "{groove} {ridge}"
        );
        assert_eq!(bend_deg((left, Vec3::ZERO), (right, away)), 0.0);
        let judgement = Judgement {
            groove_deg: 30.0,
            color: 80.0,
        };
        let strength = |bend_deg, color| {
            judgement.strength(&Border {
                a: 0,
                b: 1,
                length: 1.0,
                bend_deg,
                color,
            })
        };
        assert_eq!(strength(groove, 0.0), 1.0);
        assert!(
            strength(ridge, 0.0) < 0.5 && strength(9.0, 0.0) == 0.0 && strength(0.0, 40.0) == 0.5
        );
    }
}
