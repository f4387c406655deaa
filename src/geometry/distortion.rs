use glam::{DMat2, DVec2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Lens distortion, with the parameters and formulas of the COLMAP camera model of the same name.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Distortion {
    /// `PINHOLE`, `SIMPLE_PINHOLE`.
    #[default]
    None,
    /// `SIMPLE_RADIAL` (k2 = 0) and `RADIAL`: `1 + k1 r² + k2 r⁴`.
    Radial {
        /// k1, k2.
        k: [f64; 2],
    },
    /// `OPENCV`: k1, k2, p1, p2.
    OpenCv {
        /// Radial k1, k2.
        k: [f64; 2],
        /// Tangential p1, p2.
        p: [f64; 2],
    },
    /// `FULL_OPENCV`: k1, k2, p1, p2, k3, k4, k5, k6 (rational).
    FullOpenCv {
        /// Radial k1 … k6.
        k: [f64; 6],
        /// Tangential p1, p2.
        p: [f64; 2],
    },
    /// `OPENCV_FISHEYE`: equidistant, k1 … k4.
    OpenCvFisheye {
        /// k1 … k4.
        k: [f64; 4],
    },
    /// `THIN_PRISM_FISHEYE`: k1, k2, p1, p2, k3, k4, sx1, sy1.
    ThinPrismFisheye {
        /// k1 … k4.
        k: [f64; 4],
        /// p1, p2.
        p: [f64; 2],
        /// Thin prism sx1, sy1.
        s: [f64; 2],
    },
}

impl Distortion {
    /// Returns the distortion of the same lens for a rotated image.
    ///
    /// `rotation` is that of the plane z = 1. Coefficients that are not symmetric about the optical
    /// axis rotate with the image.
    #[must_use]
    pub(super) fn rotated(self, rotation: DMat2) -> Self {
        // The tangential term is 2 (t · q) q + |q|² t with t = (p2, p1), the prism's is |q|² (sx1,
        // sy1).
        let tangential = |p: [f64; 2]| {
            let t = rotation * DVec2::new(p[1], p[0]);
            [t.y, t.x]
        };
        match self {
            Self::None | Self::Radial { .. } | Self::OpenCvFisheye { .. } => self,
            Self::OpenCv { k, p } => Self::OpenCv {
                k,
                p: tangential(p),
            },
            Self::FullOpenCv { k, p } => Self::FullOpenCv {
                k,
                p: tangential(p),
            },
            Self::ThinPrismFisheye { k, p, s } => Self::ThinPrismFisheye {
                k,
                p: tangential(p),
                s: (rotation * DVec2::from(s)).to_array(),
            },
        }
    }

    /// Returns the general form of all models; `None` without distortion.
    pub(super) fn terms(&self) -> Option<LensTerms> {
        let plain = LensTerms::default();
        Some(match *self {
            Self::None => return None,
            Self::Radial { k } => LensTerms {
                above: [k[0], k[1], 0.0, 0.0],
                ..plain
            },
            Self::OpenCv { k, p } => LensTerms {
                above: [k[0], k[1], 0.0, 0.0],
                p,
                ..plain
            },
            Self::FullOpenCv { k, p } => LensTerms {
                above: [k[0], k[1], k[2], 0.0],
                below: [k[3], k[4], k[5]],
                p,
                ..plain
            },
            Self::OpenCvFisheye { k } => LensTerms {
                fisheye: true,
                above: k,
                ..plain
            },
            Self::ThinPrismFisheye { k, p, s } => LensTerms {
                fisheye: true,
                above: k,
                p,
                s,
                ..plain
            },
        })
    }
}

/// General form of all models: `d(q) = q · A(|q|²) / B(|q|²) + tangential + prism`.
///
/// `q` is the point on the plane z = 1. For a fisheye lens, it is that point contracted so that its
/// radius is the angle from the axis.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct LensTerms {
    fisheye: bool,
    above: [f64; 4],
    below: [f64; 3],
    p: [f64; 2],
    s: [f64; 2],
}

/// Number of steps along the radius at which a lens is checked for folding back.
const FOLD_STEPS: u32 = 16;
/// Maximum number of Newton steps; then the position counts as not covered by the lens.
const MAX_STEPS: usize = 40;

impl LensTerms {
    /// Returns the distorted position of a point on the plane z = 1.
    ///
    /// `None` beyond the radius where the model folds back.
    #[inline]
    pub fn distort(&self, at_plane: DVec2) -> Option<DVec2> {
        let q = if self.fisheye {
            draw_in(at_plane)
        } else {
            at_plane
        };
        (!self.folds_within(q.length_squared())).then(|| self.evaluate(q).0)
    }

    /// Returns the point on the plane z = 1 that is distorted to `target`; NaN if there is none.
    #[inline]
    pub fn undistort(&self, target: DVec2) -> DVec2 {
        let q = self
            .solve(target)
            .filter(|q| !self.folds_within(q.length_squared()));
        match q {
            Some(q) if self.fisheye => draw_out(q),
            Some(q) => q,
            None => DVec2::NAN,
        }
    }

    /// Newton's method with step halving.
    fn solve(&self, target: DVec2) -> Option<DVec2> {
        let mut q = target;
        let (mut at, mut jacobian) = self.evaluate(q);
        for _ in 0..MAX_STEPS {
            let miss = at - target;
            let close = 1e-15 * (1.0 + target.length_squared());
            if miss.length_squared() <= close * close {
                return Some(q);
            }
            if jacobian.determinant() <= 0.0 {
                return None;
            }
            let step = jacobian.inverse() * miss;
            let (mut share, before) = (1.0, q);
            loop {
                q = before - share * step;
                (at, jacobian) = self.evaluate(q);
                if (at - target).length_squared() < miss.length_squared() {
                    break;
                }
                share *= 0.5;
                if share < 1e-4 {
                    // No step improves: rounding is reached, or there is no solution.
                    return (miss.length_squared() < 1e-20).then_some(before);
                }
            }
        }
        ((at - target).length_squared() < 1e-20).then_some(q)
    }

    /// Returns the distorted position and its derivative.
    fn evaluate(&self, q: DVec2) -> (DVec2, DMat2) {
        let s = q.length_squared();
        let (factor, slope) = self.factor(s);
        let t = DVec2::new(self.p[1], self.p[0]);
        let prism = DVec2::from(self.s);
        let along = 2.0 * t.dot(q);
        let at = q * (factor + along) + s * (t + prism);
        // d/dq of q·f(s): f I + 2 f' q qᵀ; of 2 (t·q) q: 2 (t·q) I + 2 q tᵀ; of s·v: 2 v qᵀ.
        let outer = |a: DVec2, b: DVec2| DMat2::from_cols(a * b.x, a * b.y);
        let jacobian = DMat2::from_diagonal(DVec2::splat(factor + along))
            + outer(q, 2.0 * slope * q + 2.0 * t)
            + outer(2.0 * (t + prism), q);
        (at, jacobian)
    }

    /// Returns the radial factor at squared radius `s`, and its derivative by `s`.
    fn factor(&self, s: f64) -> (f64, f64) {
        let [a1, a2, a3, a4] = self.above;
        let [b1, b2, b3] = self.below;
        let above = 1.0 + s * (a1 + s * (a2 + s * (a3 + s * a4)));
        let above_slope = a1 + s * (2.0 * a2 + s * (3.0 * a3 + s * 4.0 * a4));
        let below = 1.0 + s * (b1 + s * (b2 + s * b3));
        let below_slope = b1 + s * (2.0 * b2 + s * 3.0 * b3);
        (
            above / below,
            (above_slope * below - above * below_slope) / (below * below),
        )
    }

    /// Returns a lower bound of the growth of the distorted radius up to the squared radius `end`.
    ///
    /// Terms that make it grow faster are left out. The divisor must be 1.
    fn slowest_growth(&self, end: f64) -> f64 {
        // Not `min`, which would hide a coefficient that is not a number.
        let [a1, a2, a3, a4] = self.above.map(|a| if a > 0.0 { 0.0 } else { a });
        1.0 + end * (3.0 * a1 + end * (5.0 * a2 + end * (7.0 * a3 + end * 9.0 * a4)))
    }

    /// Returns whether the distorted radius stops growing before the squared radius `end`.
    fn folds_within(&self, end: f64) -> bool {
        if self.below == [0.0; 3] && self.slowest_growth(end) > 0.0 {
            return false;
        }
        (1..=FOLD_STEPS).any(|step| {
            let share = f64::from(step) / f64::from(FOLD_STEPS);
            let s = share * share * end;
            let (factor, slope) = self.factor(s);
            let growth = factor + 2.0 * s * slope;
            growth.is_nan() || growth <= 0.0
        })
    }
}

/// Contracts a point on the plane z = 1 so that its radius is the angle from the axis.
fn draw_in(at_plane: DVec2) -> DVec2 {
    let radius = at_plane.length();
    if radius < 1e-12 {
        at_plane
    } else {
        at_plane * (radius.atan() / radius)
    }
}

/// Reverses [`draw_in`]; NaN at a right angle from the axis and beyond.
fn draw_out(q: DVec2) -> DVec2 {
    let angle = q.length();
    if angle < 1e-12 {
        q
    } else if angle < std::f64::consts::FRAC_PI_2 {
        q * (angle.tan() / angle)
    } else {
        DVec2::NAN
    }
}
