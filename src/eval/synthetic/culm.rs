use std::f64::consts::{PI, TAU};

use glam::DVec2;

use super::curve::{Curve, smoothstep};
use super::dice::Dice;
use super::mesh::Mesh;

/// A culm's shape: a straight taper with swollen nodes. Every diameter lies within 4–6 mm.
#[derive(Debug, Clone)]
pub(super) struct Culm {
    pub(super) curve: Curve,
    base_diameter_m: f64,
    top_diameter_m: f64,
    /// Arc lengths of the nodes, metres.
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

    /// Radius at an arc length, metres.
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

    /// Median diameter over the length, metres.
    pub(super) fn median_diameter_m(&self) -> f64 {
        let mut diameters: Vec<f64> = (0..=400)
            .map(|k| 2.0 * self.radius(self.curve.length_m() * f64::from(k) / 400.0))
            .collect();
        diameters.sort_by(f64::total_cmp);
        diameters[200]
    }

    pub(super) fn mesh(&self) -> Mesh {
        let rows = (self.curve.length_m() / 0.0015).ceil() as usize;
        let mut mesh = Mesh::tube(&self.curve, (rows, Self::SIDES), |at| self.radius(at));
        mesh.append(self.cap());
        mesh
    }

    /// A low cone that closes the upper end.
    fn cap(&self) -> Mesh {
        let end = self.curve.end();
        let radius = self.radius(end.at_m);
        Mesh::patch((1, Self::SIDES), true, |r, c| {
            let angle = TAU * c as f64 / Self::SIDES as f64;
            let ring = radius * (1.0 - r as f64) * (angle.cos() * end.side + angle.sin() * end.up);
            let uv = DVec2::new(angle * radius, end.at_m + 0.0005 * r as f64);
            (end.x + ring + 0.0005 * r as f64 * end.tangent, uv.as_vec2())
        })
    }
}

/// A leaf sheath: a sheet rolled around the culm from a node to the collar, its margins overlapping on the side away
/// from the blade.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sheath {
    /// Arc length of the node on the culm, metres.
    pub(super) from_m: f64,
    /// Arc length of the collar, metres.
    pub(super) to_m: f64,
    /// Angle of the blade about the culm's axis, from `side` towards `up`, radians.
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

    /// Distance of the sheath from the culm's axis below the blade, metres.
    pub(super) fn radius(&self, culm: &Culm, at_m: f64) -> f64 {
        culm.radius(at_m) + Self::GAP_M + 0.0002 * smoothstep(self.from_m, self.to_m, at_m)
    }

    pub(super) fn mesh(&self, culm: &Culm) -> Mesh {
        let rows = (self.length_m() / 0.0015).ceil() as usize;
        Mesh::patch((rows, 30), false, |r, c| {
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
