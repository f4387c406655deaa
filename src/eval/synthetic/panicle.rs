use glam::{DQuat, DVec3};

use super::mesh::{Bend, Curve, Mesh, Station};
use super::noise::Dice;

/// Length of a grain, a spheroid of 7 × 3 mm.
const GRAIN_LENGTH_M: f64 = 0.007;
const GRAIN_WIDTH_M: f64 = 0.003;
/// Minimum distance between grains (1 mm), in metres.
const GAP_M: f64 = 0.001;
const BRANCHES: usize = 14;
const MIN_GRAINS: usize = 80;
const MAX_GRAINS: usize = 120;

/// A grain: centre and unit axis.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grain {
    centre: DVec3,
    axis: DVec3,
}

/// A panicle: a drooping rachis and branches with grains.
pub(super) struct Panicle {
    rachis: Curve,
    neck_radius_m: f64,
    branches: Vec<Curve>,
    pub(super) grains: Vec<Grain>,
    stalks: Vec<(DVec3, DVec3)>,
}

impl Panicle {
    /// Creates a panicle at the upper end of a culm of the given radius.
    ///
    /// It droops towards the compass direction `azimuth`.
    pub(super) fn grow(neck: Station, neck_radius_m: f64, azimuth: f64, dice: &mut Dice) -> Self {
        let tip = dice.range(-50.0, -20.0_f64).to_radians();
        let level = DVec3::new(azimuth.cos(), azimuth.sin(), 0.0);
        let to = tip.cos() * level + tip.sin() * DVec3::Z;
        let rachis = Curve::turning(
            neck.x,
            Bend {
                from: neck.tangent,
                to,
                power: 1.6,
            },
            dice.range(0.150, 0.170),
            neck.side,
        );
        let branches = (0..BRANCHES).map(|k| branch(&rachis, k, dice)).collect();
        let mut panicle = Self {
            rachis,
            neck_radius_m,
            branches,
            grains: Vec::new(),
            stalks: Vec::new(),
        };
        panicle.set_grains(dice);
        panicle
    }

    /// Places grains next to the branches, in passes, until there are enough.
    ///
    /// A grain that would be too close to another one is skipped.
    fn set_grains(&mut self, dice: &mut Dice) {
        for pass in 0..40 {
            for k in 0..self.branches.len() {
                let length = self.branches[k].length_m();
                let mut at_m = 0.010 + dice.range(0.0, 0.004);
                while at_m < length && self.grains.len() < MAX_GRAINS {
                    let station = self.branches[k].at(at_m);
                    self.try_grain(&station, dice);
                    at_m += dice.range(0.0042, 0.0055);
                }
            }
            if pass >= 1 && self.grains.len() >= MIN_GRAINS {
                return;
            }
        }
    }

    fn try_grain(&mut self, station: &Station, dice: &mut Dice) {
        let angle = dice.range(0.0, std::f64::consts::TAU);
        let outward = angle.cos() * station.side + angle.sin() * station.up;
        let lean = dice.range(0.25, 0.6_f64);
        let axis = (lean.cos() * station.tangent + lean.sin() * outward).normalize();
        let foot = station.x + 0.0016 * outward;
        let grain = Grain {
            centre: foot + 0.5 * GRAIN_LENGTH_M * axis,
            axis,
        };
        if self.grains.iter().all(|other| grain.is_clear_of(other)) {
            self.grains.push(grain);
            self.stalks.push((station.x, foot + 0.0004 * axis));
        }
    }

    pub(super) fn grain_mesh(grain: &Grain) -> Mesh {
        Mesh::spheroid(
            grain.centre,
            grain.axis,
            0.5 * GRAIN_LENGTH_M,
            0.5 * GRAIN_WIDTH_M,
        )
    }

    /// Returns a mesh of rachis, branches and the stalks of the grains.
    pub(super) fn axes_mesh(&self) -> Mesh {
        let length = self.rachis.length_m();
        let neck = self.neck_radius_m;
        let rachis_radius =
            |at: f64| 0.0010 - 0.0006 * at / length + (neck - 0.0010) * (-(at / 0.004)).exp();
        let mut mesh = Mesh::tube(&self.rachis, 100, 10, rachis_radius);
        for branch in &self.branches {
            let length = branch.length_m();
            mesh.append(Mesh::tube(branch, 24, 6, |at| {
                0.000_45 - 0.000_2 * at / length
            }));
        }
        for &(from, to) in &self.stalks {
            let along = (to - from).normalize_or(DVec3::Z);
            let curve = Curve::turning(
                from,
                Bend {
                    from: along,
                    to: along,
                    power: 1.0,
                },
                (to - from).length(),
                along.any_orthonormal_vector(),
            );
            mesh.append(Mesh::tube(&curve, 1, 5, |_| 0.000_25));
        }
        mesh
    }
}

/// Creates the `k`-th branch.
///
/// Branches leave the rachis in a spiral (137.5°) and bend down; lower branches are longer.
fn branch(rachis: &Curve, k: usize, dice: &mut Dice) -> Curve {
    let share = 0.12 + 0.80 * (k as f64 + dice.range(-0.25, 0.25)) / (BRANCHES - 1) as f64;
    let station = rachis.at(share.clamp(0.05, 0.97) * rachis.length_m());
    let outward = DQuat::from_axis_angle(station.tangent, 2.4 * k as f64 + dice.range(-0.3, 0.3))
        * station.side;
    let angle = dice.range(0.42, 0.75_f64);
    let from = (angle.cos() * station.tangent + angle.sin() * outward).normalize();
    let to = (from - 0.55 * DVec3::Z).normalize();
    let length = 0.062 - 0.026 * share + dice.range(-0.006, 0.006);
    Curve::turning(
        station.x,
        Bend {
            from,
            to,
            power: 1.0,
        },
        length,
        station.tangent.cross(outward),
    )
}

impl Grain {
    /// Returns whether the gap to another grain is certainly kept.
    ///
    /// A spheroid lies inside the capsule of the same width and length, so comparing the axes of
    /// the capsules is sufficient.
    fn is_clear_of(&self, other: &Self) -> bool {
        segment_distance(self.capsule(), other.capsule()) > GRAIN_WIDTH_M + GAP_M + 1e-5
    }

    /// Returns the axis of the capsule around the grain.
    fn capsule(&self) -> Segment {
        let half = 0.5 * (GRAIN_LENGTH_M - GRAIN_WIDTH_M) * self.axis;
        Segment {
            start: self.centre - half,
            end: self.centre + half,
        }
    }
}

/// A line segment.
#[derive(Clone, Copy)]
struct Segment {
    start: DVec3,
    end: DVec3,
}

/// Returns the distance between two segments.
///
/// Source: Ericson, "Real-Time Collision Detection", 2005, section 5.1.9.
fn segment_distance(p: Segment, q: Segment) -> f64 {
    let (d, e, r) = (p.end - p.start, q.end - q.start, p.start - q.start);
    let (a, b, c, f, g) = (d.dot(d), d.dot(e), d.dot(r), e.dot(e), e.dot(r));
    let denominator = a * f - b * b;
    let s = if denominator > 1e-18 {
        ((b * g - c * f) / denominator).clamp(0.0, 1.0)
    } else {
        0.0
    };
    let t = (b * s + g) / f;
    let (s, t) = match t {
        t if t < 0.0 => ((-c / a).clamp(0.0, 1.0), 0.0),
        t if t > 1.0 => (((b - c) / a).clamp(0.0, 1.0), 1.0),
        t => (s, t),
    };
    (r + s * d - t * e).length()
}
