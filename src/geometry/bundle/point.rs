use glam::{DVec2, DVec3};

/// What a point's observations say about it: `V` (upper triangle: xx xy xz yy yz zz) and the gradient.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PointTerms {
    v: [f64; 6],
    gradient: DVec3,
}

/// The lower triangle `L` of a damped `V = L Lᵀ`, its diagonal inverted.
#[derive(Debug, Clone, Copy)]
pub(super) struct PointFactor {
    inverse_diagonal: [f64; 3],
    below: [f64; 3],
}

impl PointTerms {
    /// Adds one observation's derivatives and (the other unknowns moved first, where they are) its residual.
    #[inline(always)]
    pub fn add(&mut self, by_point: &[DVec3; 2], residual: DVec2) {
        for (d, r) in by_point.iter().zip(residual.to_array()) {
            let terms = [
                d.x * d.x,
                d.x * d.y,
                d.x * d.z,
                d.y * d.y,
                d.y * d.z,
                d.z * d.z,
            ];
            for (v, term) in self.v.iter_mut().zip(terms) {
                *v += term;
            }
            self.gradient += *d * r;
        }
    }

    /// `None` where the observations do not hold the point.
    #[inline(always)]
    pub fn factor(&self, damping: f64) -> Option<PointFactor> {
        let [xx, xy, xz, yy, yz, zz] = self.v;
        let more = 1.0 + damping;
        let a = (xx * more).sqrt();
        let (b, c) = (xy / a, xz / a);
        let d = (yy * more - b * b).sqrt();
        let e = (yz - b * c) / d;
        let f = (zz * more - c * c - e * e).sqrt();
        let inverse_diagonal = [1.0 / a, 1.0 / d, 1.0 / f];
        inverse_diagonal
            .iter()
            .all(|v| v.is_finite())
            .then_some(PointFactor {
                inverse_diagonal,
                below: [b, c, e],
            })
    }

    /// The point's step.
    #[inline(always)]
    pub fn step(&self, factor: &PointFactor) -> DVec3 {
        -factor.backward(factor.forward(self.gradient))
    }

    /// By how much the quadratic model of the cost changes with the point's step.
    #[inline(always)]
    pub fn change(&self, step: DVec3) -> f64 {
        let [xx, xy, xz, yy, yz, zz] = self.v;
        let v_step = DVec3::new(
            xx * step.x + xy * step.y + xz * step.z,
            xy * step.x + yy * step.y + yz * step.z,
            xz * step.x + yz * step.y + zz * step.z,
        );
        step.dot(self.gradient + 0.5 * v_step)
    }
}

impl PointFactor {
    /// `L⁻¹ v`.
    #[inline(always)]
    pub fn forward(&self, v: DVec3) -> DVec3 {
        let ([a, d, f], [b, c, e]) = (self.inverse_diagonal, self.below);
        let x = v.x * a;
        let y = (v.y - b * x) * d;
        DVec3::new(x, y, (v.z - c * x - e * y) * f)
    }

    /// `L⁻ᵀ v`.
    #[inline(always)]
    fn backward(&self, v: DVec3) -> DVec3 {
        let ([a, d, f], [b, c, e]) = (self.inverse_diagonal, self.below);
        let z = v.z * f;
        let y = (v.y - e * z) * d;
        DVec3::new((v.x - b * y - c * z) * a, y, z)
    }
}
