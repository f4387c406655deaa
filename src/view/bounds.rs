use glam::Vec3;

/// An axis-parallel box in world space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Smallest corner.
    pub min: Vec3,
    /// Largest corner.
    pub max: Vec3,
}

impl Bounds {
    /// The box that holds all but the outermost 0.5 % of the points along each axis, so that a few stray points do not
    /// shrink the scene to a dot; `None` without finite points.
    #[must_use]
    pub fn of(points: impl Iterator<Item = Vec3>) -> Option<Self> {
        let points: Vec<Vec3> = points.filter(|p| p.is_finite()).collect();
        if points.is_empty() {
            return None;
        }
        let (mut min, mut max) = (Vec3::ZERO, Vec3::ZERO);
        for axis in 0..3 {
            let mut values: Vec<f32> = points.iter().map(|p| p[axis]).collect();
            let cut = values.len() / 200;
            let last = values.len() - 1 - cut;
            min[axis] = *values.select_nth_unstable_by(cut, f32::total_cmp).1;
            max[axis] = *values.select_nth_unstable_by(last, f32::total_cmp).1;
        }
        Some(Self { min, max })
    }

    /// The middle.
    #[must_use]
    pub fn centre(&self) -> Vec3 {
        (self.min + self.max) / 2.0
    }

    /// Half the diagonal, above 0.
    #[must_use]
    pub fn radius(&self) -> f32 {
        ((self.max - self.min).length() / 2.0).max(1e-6)
    }
}
