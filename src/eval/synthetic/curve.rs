use glam::{DQuat, DVec3};

/// A place on a [`Curve`]: `tangent`, `side` and `up` are a right-handed orthonormal frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Station {
    /// Arc length from the start, metres.
    pub(super) at_m: f64,
    pub(super) x: DVec3,
    pub(super) tangent: DVec3,
    pub(super) side: DVec3,
    pub(super) up: DVec3,
}

/// The centre line of an organ: a finely divided polyline with a frame that turns as little as possible along it.
#[derive(Debug, Clone)]
pub(super) struct Curve {
    stations: Vec<Station>,
}

impl Curve {
    const STEPS: usize = 160;

    /// From `start`, `length_m` long; the direction turns from `from` to `to` (unit vectors, not opposite) along the
    /// great circle between them, by the share `t^power` at the share `t` of the length.
    pub(super) fn turning(
        start: DVec3,
        from: DVec3,
        to: DVec3,
        power: f64,
        length_m: f64,
        side: DVec3,
    ) -> Self {
        let turn = DQuat::from_rotation_arc(from, to);
        let direction = |t: f64| DQuat::IDENTITY.slerp(turn, t.powf(power)) * from;
        let step = length_m / Self::STEPS as f64;
        let (mut x, mut side) = (start, side);
        let stations = (0..=Self::STEPS)
            .map(|k| {
                let t = k as f64 / Self::STEPS as f64;
                let tangent = direction(t);
                side = side.reject_from(tangent).normalize();
                let station = Station {
                    at_m: t * length_m,
                    x,
                    tangent,
                    side,
                    up: tangent.cross(side),
                };
                x += step * direction((t + 0.5 / Self::STEPS as f64).min(1.0));
                station
            })
            .collect();
        Self { stations }
    }

    /// Arc length in metres.
    pub(super) fn length_m(&self) -> f64 {
        self.stations.last().map_or(0.0, |station| station.at_m)
    }

    /// The place at arc length `at_m`, clamped to the ends.
    pub(super) fn at(&self, at_m: f64) -> Station {
        let place = (at_m / self.length_m()).clamp(0.0, 1.0) * (self.stations.len() - 1) as f64;
        let index = (place as usize).min(self.stations.len() - 2);
        let (a, b, f) = (
            &self.stations[index],
            &self.stations[index + 1],
            place - index as f64,
        );
        let tangent = a.tangent.lerp(b.tangent, f).normalize();
        let side = a.side.lerp(b.side, f).reject_from(tangent).normalize();
        Station {
            at_m: a.at_m + (b.at_m - a.at_m) * f,
            x: a.x.lerp(b.x, f),
            tangent,
            side,
            up: tangent.cross(side),
        }
    }

    /// The last place.
    pub(super) fn end(&self) -> Station {
        self.at(self.length_m())
    }
}

/// 0 below `low`, 1 above `high`, smooth between.
pub(super) fn smoothstep(low: f64, high: f64, x: f64) -> f64 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
