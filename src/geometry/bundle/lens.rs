use glam::{DMat2, DVec2, DVec3};

use super::problem::Refine;
use crate::blocks::BLOCK;
use crate::{Camera, Distortion};

/// Maximum number of one camera's intrinsics: two blocks of unknowns.
///
/// They are a common focal factor, the principal point, and at most eight coefficients.
pub(super) const INTRINSICS: usize = 2 * BLOCK;
/// Number of slots for the coefficients of all models.
///
/// Numerator 0–3, denominator 4–6, tangential 7–8, prism 9–10.
const SLOTS: usize = 11;
/// Number of angles from the axis at which a lens is checked for folding back.
const FOLD_STEPS: u32 = 180;

/// A camera prepared for many projections with derivatives; formulas as in [`Camera::project`].
#[derive(Debug, Clone)]
pub(super) struct Lens {
    focal: DVec2,
    principal: DVec2,
    fisheye: bool,
    slots: [f64; SLOTS],
    /// Slots that the camera's model has, in the order of its coefficients.
    used: &'static [usize],
    /// Squared radius at which the lens folds back.
    fold: f64,
    refine: Refine,
}

/// Projection of a point, with derivatives by the point in camera space.
pub(super) struct ProjectedPoint {
    pub at_px: DVec2,
    /// Derivatives of the pixel's x and y.
    pub by_point: [DVec3; 2],
    /// Position on the plane z = 1, contracted for a fisheye lens.
    q: DVec2,
    /// Position after distortion, before the focal length.
    distorted: DVec2,
}

impl Lens {
    pub fn new(camera: &Camera, refine: Refine) -> Self {
        let (slots, used) = slots(&camera.distortion);
        let fisheye = matches!(
            camera.distortion,
            Distortion::OpenCvFisheye { .. } | Distortion::ThinPrismFisheye { .. }
        );
        let mut lens = Self {
            focal: camera.focal_px,
            principal: camera.principal_px,
            fisheye,
            slots,
            used,
            fold: f64::INFINITY,
            refine,
        };
        lens.fold = lens.find_fold();
        lens
    }

    /// Returns another camera with the same intrinsics refined.
    pub fn of(&self, camera: &Camera) -> Self {
        Self::new(camera, self.refine)
    }

    /// Returns the number of refined intrinsics, fewer than [`INTRINSICS`].
    pub fn intrinsics(&self) -> usize {
        let Refine {
            focal,
            principal,
            distortion,
        } = self.refine;
        usize::from(focal)
            + if principal { 2 } else { 0 }
            + if distortion { self.used.len() } else { 0 }
    }

    /// Projects a point in camera space to pixels; `None` if [`Camera::project`] returns `None`.
    #[inline(always)]
    pub fn project(&self, x: DVec3) -> Option<DVec2> {
        let q = self.at_plane(x)?;
        let q = if self.fisheye {
            q * draw_in(q.length_squared()).0
        } else {
            q
        };
        let at_px = self.distort(q)?.0 * self.focal + self.principal;
        at_px.is_finite().then_some(at_px)
    }

    /// Same as [`Self::project`], with derivatives.
    #[inline(always)]
    pub fn see(&self, x: DVec3) -> Option<ProjectedPoint> {
        let plane = self.at_plane(x)?;
        let (q, by_plane) = if self.fisheye {
            draw_in_jacobian(plane)
        } else {
            (plane, DMat2::IDENTITY)
        };
        let (distorted, by_q) = self.distort(q)?;
        let jacobian = if self.fisheye { by_q * by_plane } else { by_q };
        let at_px = distorted * self.focal + self.principal;
        // d(x/z, y/z) / dx = (1, 0, −u; 0, 1, −v) / z.
        let row = |a: DVec2| DVec3::new(a.x, a.y, -a.dot(plane)) / x.z;
        let by_point = [
            row(self.focal.x * jacobian.row(0)),
            row(self.focal.y * jacobian.row(1)),
        ];
        (at_px.is_finite() && by_point[0].is_finite() && by_point[1].is_finite()).then_some(
            ProjectedPoint {
                at_px,
                by_point,
                q,
                distorted,
            },
        )
    }

    /// Returns the derivatives of the pixel's x and y by each refined intrinsic.
    ///
    /// The order is focal factor, principal point, coefficients.
    #[inline(always)]
    pub fn by_intrinsics(&self, seen: &ProjectedPoint, out: &mut [DVec2; INTRINSICS]) {
        let mut next = 0;
        let mut push = |value: DVec2| {
            out[next] = value;
            next += 1;
        };
        if self.refine.focal {
            push(seen.distorted * self.focal);
        }
        if self.refine.principal {
            push(DVec2::X);
            push(DVec2::Y);
        }
        if self.refine.distortion {
            for &slot in self.used {
                push(self.focal * self.by_slot(slot, seen.q));
            }
        }
    }

    /// Returns the camera after a step of the refined intrinsics.
    ///
    /// They are in the order of [`Self::by_intrinsics`].
    pub fn moved(&self, camera: &Camera, step: &[f64]) -> Camera {
        let mut moved = *camera;
        let mut step = step.iter().copied();
        let mut take = || step.next().unwrap_or(0.0);
        if self.refine.focal {
            moved.focal_px *= take().exp();
        }
        if self.refine.principal {
            moved.principal_px += DVec2::new(take(), take());
        }
        if self.refine.distortion {
            let mut slots = self.slots;
            for &slot in self.used {
                slots[slot] += take();
            }
            moved.distortion = from_slots(&camera.distortion, &slots);
        }
        moved
    }

    #[inline(always)]
    fn at_plane(&self, x: DVec3) -> Option<DVec2> {
        (x.z > 0.0).then(|| x.truncate() / x.z)
    }

    /// Returns the distorted position and its derivative; `None` if the lens folds back there.
    #[inline(always)]
    fn distort(&self, q: DVec2) -> Option<(DVec2, DMat2)> {
        let s = q.length_squared();
        if self.used.is_empty() {
            return Some((q, DMat2::IDENTITY));
        }
        if s >= self.fold {
            return None;
        }
        let [.., p1, p2, sx, sy] = self.slots;
        let (factor, slope) = self.radial(s);
        let (t, prism) = (DVec2::new(p2, p1), DVec2::new(sx, sy));
        let along = factor + 2.0 * t.dot(q);
        let across = 2.0 * (t + prism);
        let inward = 2.0 * (slope * q + t);
        // Of q·f(s): f I + 2 f' q qᵀ; of 2 (t·q) q: 2 (t·q) I + 2 q tᵀ; of s·v: 2 v qᵀ.
        let jacobian = DMat2::from_cols(
            q * inward.x + across * q.x + DVec2::new(along, 0.0),
            q * inward.y + across * q.y + DVec2::new(0.0, along),
        );
        Some((q * along + s * (t + prism), jacobian))
    }

    /// Returns the radial factor at squared radius `s` and its derivative by `s`.
    #[inline(always)]
    fn radial(&self, s: f64) -> (f64, f64) {
        let [a1, a2, a3, a4, b1, b2, b3, ..] = self.slots;
        let above = 1.0 + s * (a1 + s * (a2 + s * (a3 + s * a4)));
        let above_slope = a1 + s * (2.0 * a2 + s * (3.0 * a3 + s * 4.0 * a4));
        let below = 1.0 / (1.0 + s * (b1 + s * (b2 + s * b3)));
        let below_slope = b1 + s * (2.0 * b2 + s * 3.0 * b3);
        let factor = above * below;
        (factor, (above_slope - factor * below_slope) * below)
    }

    /// Returns the derivative of the distorted position by one coefficient.
    #[inline(always)]
    fn by_slot(&self, slot: usize, q: DVec2) -> DVec2 {
        let s = q.length_squared();
        let below = || 1.0 + s * (self.slots[4] + s * (self.slots[5] + s * self.slots[6]));
        let power = |exponent: usize| (0..exponent).fold(1.0, |power, _| power * s);
        match slot {
            0..4 => q * (power(slot + 1) / below()),
            4..7 => q * (-self.radial(s).0 * power(slot - 3) / below()),
            7 => 2.0 * q.y * q + DVec2::new(0.0, s),
            8 => 2.0 * q.x * q + DVec2::new(s, 0.0),
            9 => DVec2::new(s, 0.0),
            _ => DVec2::new(0.0, s),
        }
    }

    /// Returns the squared radius up to which the distorted radius grows.
    fn find_fold(&self) -> f64 {
        let squared = |angle: f64| {
            if self.fisheye {
                angle * angle
            } else {
                angle.tan().powi(2)
            }
        };
        let grows = |angle: f64| {
            let s = squared(angle);
            let (factor, slope) = self.radial(s);
            factor + 2.0 * s * slope > 0.0
        };
        let step = std::f64::consts::FRAC_PI_2 / f64::from(FOLD_STEPS);
        let Some(first) = (1..FOLD_STEPS)
            .map(|k| f64::from(k) * step)
            .find(|&angle| !grows(angle))
        else {
            return f64::INFINITY;
        };
        let (mut below, mut above) = (first - step, first);
        for _ in 0..50 {
            let middle = 0.5 * (below + above);
            if grows(middle) {
                below = middle;
            } else {
                above = middle;
            }
        }
        squared(below)
    }
}

/// Returns the factor that contracts a point on the plane z = 1 to its angle from the axis.
///
/// Takes the squared radius. Also returns the factor's derivative by half the squared radius.
#[inline(always)]
fn draw_in(s: f64) -> (f64, f64) {
    if s < 1e-6 {
        return (1.0 - s / 3.0, -2.0 / 3.0 + 0.8 * s);
    }
    let radius = s.sqrt();
    let factor = radius.atan() / radius;
    (factor, (1.0 / (1.0 + s) - factor) / s)
}

#[inline(always)]
fn draw_in_jacobian(plane: DVec2) -> (DVec2, DMat2) {
    let (factor, slope) = draw_in(plane.length_squared());
    let bend = slope * plane;
    let jacobian = DMat2::from_cols(
        plane * bend.x + DVec2::new(factor, 0.0),
        plane * bend.y + DVec2::new(0.0, factor),
    );
    (plane * factor, jacobian)
}

/// Returns all coefficients by slot, and which slots the model has.
fn slots(distortion: &Distortion) -> ([f64; SLOTS], &'static [usize]) {
    let mut slots = [0.0; SLOTS];
    let mut fill = |values: &[f64], used: &'static [usize]| {
        for (&slot, &value) in used.iter().zip(values) {
            slots[slot] = value;
        }
        used
    };
    let used = match *distortion {
        Distortion::None => fill(&[], &[]),
        Distortion::Radial { k } => fill(&k, &[0, 1]),
        Distortion::OpenCv { k, p } => fill(&[k[0], k[1], p[0], p[1]], &[0, 1, 7, 8]),
        Distortion::FullOpenCv { k, p } => fill(
            &[k[0], k[1], k[2], k[3], k[4], k[5], p[0], p[1]],
            &[0, 1, 2, 4, 5, 6, 7, 8],
        ),
        Distortion::OpenCvFisheye { k } => fill(&k, &[0, 1, 2, 3]),
        Distortion::ThinPrismFisheye { k, p, s } => fill(
            &[k[0], k[1], k[2], k[3], p[0], p[1], s[0], s[1]],
            &[0, 1, 2, 3, 7, 8, 9, 10],
        ),
    };
    (slots, used)
}

/// Returns the model of `like` with other coefficients.
fn from_slots(like: &Distortion, slots: &[f64; SLOTS]) -> Distortion {
    let [a1, a2, a3, a4, b1, b2, b3, p1, p2, sx, sy] = *slots;
    match like {
        Distortion::None => Distortion::None,
        Distortion::Radial { .. } => Distortion::Radial { k: [a1, a2] },
        Distortion::OpenCv { .. } => Distortion::OpenCv {
            k: [a1, a2],
            p: [p1, p2],
        },
        Distortion::FullOpenCv { .. } => Distortion::FullOpenCv {
            k: [a1, a2, a3, b1, b2, b3],
            p: [p1, p2],
        },
        Distortion::OpenCvFisheye { .. } => Distortion::OpenCvFisheye {
            k: [a1, a2, a3, a4],
        },
        Distortion::ThinPrismFisheye { .. } => Distortion::ThinPrismFisheye {
            k: [a1, a2, a3, a4],
            p: [p1, p2],
            s: [sx, sy],
        },
    }
}
