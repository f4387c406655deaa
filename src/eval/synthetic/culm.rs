use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};

use super::mesh::{Bend, Curve, Mesh, smoothstep};
use super::noise::Dice;
use ostra_core::statistics::upper_median;

/// The shape of a culm: a straight taper with swollen nodes, 4–6 mm in diameter.
#[derive(Debug, Clone)]
pub(super) struct Culm {
    pub(super) curve: Curve,
    base_diameter_m: f64,
    top_diameter_m: f64,
    /// Arc lengths of the nodes, in metres.
    pub(super) nodes_m: Vec<f64>,
}

impl Culm {
    const SIDES: usize = 24;

    pub(super) fn new(curve: Curve, nodes_m: Vec<f64>, dice: &mut Dice) -> Self {
        let base_diameter_m = dice.range(0.0050, 0.0055);
        Self {
            curve,
            base_diameter_m,
            top_diameter_m: base_diameter_m - dice.range(0.0003, 0.0007),
            nodes_m,
        }
    }

    /// Returns the radius at an arc length, in metres.
    pub(super) fn radius(&self, at_m: f64) -> f64 {
        let share = (at_m / self.curve.length_m()).clamp(0.0, 1.0);
        let swell: f64 = self
            .nodes_m
            .iter()
            .map(|node| (-((at_m - node) / 0.003).powi(2)).exp())
            .sum();
        0.5 * (self.base_diameter_m + (self.top_diameter_m - self.base_diameter_m) * share)
            * (1.0 + 0.06 * swell)
    }

    /// Returns the median diameter over the length, in metres.
    pub(super) fn median_diameter_m(&self) -> f64 {
        let mut diameters: Vec<f64> = (0..=400)
            .map(|k| 2.0 * self.radius(self.curve.length_m() * f64::from(k) / 400.0))
            .collect();
        upper_median(&mut diameters).unwrap_or(0.0)
    }

    pub(super) fn mesh(&self) -> Mesh {
        let rows = (self.curve.length_m() / 0.0015).ceil() as usize;
        let mut mesh = Mesh::tube(&self.curve, rows, Self::SIDES, |at| self.radius(at));
        mesh.append(self.cap());
        mesh
    }

    /// Returns a low cone that closes the upper end.
    fn cap(&self) -> Mesh {
        let end = self.curve.end();
        let radius = self.radius(end.at_m);
        Mesh::patch(1, Self::SIDES, true, |r, c| {
            let angle = TAU * c as f64 / Self::SIDES as f64;
            let ring = radius * (1.0 - r as f64) * (angle.cos() * end.side + angle.sin() * end.up);
            let uv = DVec2::new(angle * radius, end.at_m + 0.0005 * r as f64);
            (end.x + ring + 0.0005 * r as f64 * end.tangent, uv.as_vec2())
        })
    }
}

/// A leaf sheath: a sheet rolled around the culm from a node to the collar.
///
/// Its margins overlap on the side opposite the blade.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sheath {
    /// Arc length of the node on the culm, in metres.
    pub(super) from_m: f64,
    /// Arc length of the collar, in metres.
    pub(super) to_m: f64,
    /// Angle of the blade around the culm's axis, from `side` towards `up`, in radians.
    pub(super) angle: f64,
}

impl Sheath {
    const OVERLAP: f64 = 0.6;
    /// Share of the sheet that is not covered by its own margin.
    pub(super) const VISIBLE: f64 = TAU / (TAU + Self::OVERLAP);
    const GAP_M: f64 = 0.000_45;

    pub(super) fn length_m(&self) -> f64 {
        self.to_m - self.from_m
    }

    /// Returns the distance of the sheath from the culm's axis below the blade, in metres.
    pub(super) fn radius(&self, culm: &Culm, at_m: f64) -> f64 {
        culm.radius(at_m) + Self::GAP_M + 0.0002 * smoothstep(self.from_m, self.to_m, at_m)
    }

    pub(super) fn mesh(&self, culm: &Culm) -> Mesh {
        let rows = (self.length_m() / 0.0015).ceil() as usize;
        Mesh::patch(rows, 30, false, |r, c| {
            let turn = (c as f64 / 30.0 - 0.5) * (TAU + Self::OVERLAP);
            // The rim slopes down towards the opening opposite the blade.
            let reach = self.length_m() - 0.004 * 0.5 * (1.0 - (turn.clamp(-PI, PI)).cos());
            let at_m = self.from_m + reach * r as f64 / rows as f64;
            let station = culm.curve.at(at_m);
            let radius = self.radius(culm, at_m) + 0.000_15 * turn / PI;
            let angle = self.angle + turn;
            let x = station.x + radius * (angle.cos() * station.side + angle.sin() * station.up);
            (x, DVec2::new(turn * radius, at_m - self.from_m).as_vec2())
        })
    }
}

/// Parameters that vary between blades.
#[derive(Debug, Clone, Copy)]
pub(super) struct BladePlan {
    pub(super) length_m: f64,
    /// Maximum width, in metres.
    pub(super) width_m: f64,
    /// Angle between culm and blade at the collar, in radians.
    pub(super) insertion: f64,
    /// Elevation of the direction of the tip, in radians; negative values point down.
    pub(super) tip_elevation: f64,
    /// Rotation of the blade about its midrib towards the tip, in radians.
    pub(super) twist: f64,
}

impl BladePlan {
    pub(super) fn draw(length_m: f64, dice: &mut Dice) -> Self {
        Self {
            length_m,
            width_m: dice.range(0.0095, 0.0145),
            insertion: dice.range(18.0, 38.0).to_radians(),
            tip_elevation: dice.range(-75.0, -15.0).to_radians(),
            twist: dice.range(0.5, 1.3) * if dice.below(2) == 0 { 1.0 } else { -1.0 },
        }
    }
}

/// A leaf blade: a sheet along its midrib.
///
/// It is wrapped around the culm at the collar and lightly folded beyond.
pub(super) struct Blade {
    plan: BladePlan,
    midrib: Curve,
    collar_radius_m: f64,
}

impl Blade {
    /// Creates a blade at the upper end of its sheath.
    pub(super) fn grow(plan: BladePlan, sheath: &Sheath, culm: &Culm) -> Self {
        let collar = culm.curve.at(sheath.to_m);
        let outward = sheath.angle.cos() * collar.side + sheath.angle.sin() * collar.up;
        let radius = sheath.radius(culm, sheath.to_m);
        let from = plan.insertion.cos() * collar.tangent + plan.insertion.sin() * outward;
        let level = outward.reject_from(DVec3::Z).normalize_or(DVec3::X);
        let to = plan.tip_elevation.cos() * level + plan.tip_elevation.sin() * DVec3::Z;
        let side = collar.tangent.cross(outward);
        let midrib = Curve::turning(
            collar.x + radius * outward,
            Bend {
                from,
                to,
                power: 1.35,
            },
            plan.length_m,
            side,
        );
        Self {
            plan,
            midrib,
            collar_radius_m: radius,
        }
    }

    /// Returns the full width at a share of the length, in metres.
    fn width(&self, share: f64) -> f64 {
        let base = 0.72 + 0.28 * smoothstep(0.0, 0.3, share);
        let taper = 1.0 - ((share - 0.45).max(0.0) / 0.55).powf(2.2);
        self.plan.width_m * base * taper
    }

    pub(super) fn mesh(&self) -> Mesh {
        let (rows, columns) = ((self.plan.length_m / 0.0025).ceil() as usize, 10);
        Mesh::patch(rows, columns, false, |r, c| {
            let share = r as f64 / rows as f64;
            let station = self.midrib.at(share * self.plan.length_m);
            let across = (c as f64 / columns as f64 - 0.5) * self.width(share);
            let offset = self.cross_section(across, station.at_m);
            let (sin, cos) = (self.plan.twist * share * share).sin_cos();
            let side = cos * station.side + sin * station.up;
            let up = cos * station.up - sin * station.side;
            (
                station.x + offset.x * side + offset.y * up,
                DVec2::new(across, station.at_m).as_vec2(),
            )
        })
    }

    /// Returns the position in the cross-section for the texture position `across`.
    ///
    /// The cross-section is a circular arc, tight at the collar and open beyond. Widths along the
    /// arc are exact.
    fn cross_section(&self, across: f64, at_m: f64) -> DVec2 {
        let open = 1.0 / 0.016;
        let tight = 1.0 / self.collar_radius_m;
        let bend = tight + (open - tight) * smoothstep(0.0, 0.02, at_m);
        DVec2::new(
            (bend * across).sin() / bend,
            (1.0 - (bend * across).cos()) / bend,
        )
    }

    /// Returns the mean width over the length, in metres.
    pub(super) fn mean_width_m(&self) -> f64 {
        (0..400)
            .map(|k| self.width((f64::from(k) + 0.5) / 400.0))
            .sum::<f64>()
            / 400.0
    }

    /// Returns the angle in degrees between the culm's axis and the first `reach_m` of the midrib.
    ///
    /// `axis` is the direction of the culm at the collar.
    pub(super) fn insertion_deg(&self, axis: DVec3, reach_m: f64) -> f64 {
        (self.midrib.at(reach_m).x - self.midrib.at(0.0).x)
            .angle_between(axis)
            .to_degrees()
    }
}
