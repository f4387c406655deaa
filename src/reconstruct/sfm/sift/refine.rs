use glam::{DVec2, Mat2, Mat3, Vec2, Vec3};

use super::extrema::Candidate;
use super::keypoint::SiftOptions;
use super::rows::Rows;

/// A keypoint in samples of its octave.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Extremum {
    /// Column; integers are the centres of samples.
    pub x: f32,
    /// Row.
    pub y: f32,
    /// Scale in levels of the octave.
    pub scale: f32,
    /// The level nearest to it.
    pub level: usize,
    /// Contrast of the peak, in grey.
    pub strength: f32,
}

/// Maximum number of moves to a neighbouring sample before a fit is given up.
pub(super) const MOST_MOVES: usize = 5;
/// The fit moves to the next sample if the peak is farther away than this, in samples.
const MOVE_BEYOND: f32 = 0.6;
/// Maximum distance of a peak from the last sample tried.
pub(super) const FARTHEST: f32 = 1.5;

/// Fits a quadratic to the differences around a candidate.
///
/// Returns `None` if it has no clear peak, is too weak or lies on an edge.
///
/// Brown and Lowe, "Invariant Features from Interest Point Groups", BMVC 2002; the edge test is
/// Lowe 2004, section 4.1.
pub(super) fn refine(
    levels: &[Rows],
    candidate: Candidate,
    options: &SiftOptions,
) -> Option<Extremum> {
    let mut at = candidate;
    for move_on in (0..MOST_MOVES).rev() {
        let fit = TaylorExpansion::at(levels, at);
        let offset = fit.peak()?;
        let next = moved(levels, at, offset);
        if next != at && move_on > 0 {
            at = next;
            continue;
        }
        let height = fit.value + 0.5 * fit.slope.dot(offset);
        let keep = offset.abs().max_element() < FARTHEST
            && height.abs() > options.peak_threshold
            && !fit.is_edge(options.edge_threshold);
        let offset = slice_peak(levels, at, offset.z)
            .unwrap_or(offset.truncate())
            .extend(offset.z);
        return if keep {
            extremum(levels, at, offset, height.abs())
        } else {
            None
        };
    }
    None
}

/// Returns the extremum of a quadratic through the nine samples at the peak's own scale, from the middle sample.
///
/// The shape of the surroundings changes with the scale, which the fit in all three dimensions
/// leaves out.
fn slice_peak(levels: &[Rows], at: Candidate, scale: f32) -> Option<Vec2> {
    let scale = scale.clamp(-1.0, 1.0);
    let sample = |dx: isize, dy: isize| {
        let (x, y) = (at.x.wrapping_add_signed(dx), at.y.wrapping_add_signed(dy));
        let difference = |level: usize| levels[level + 1].row(y)[x] - levels[level].row(y)[x];
        let [finer, here, coarser] = [at.level - 1, at.level, at.level + 1].map(difference);
        here + 0.5 * scale * (coarser - finer + scale * (coarser + finer - 2.0 * here))
    };
    let (here, right, left, below, above) = (
        sample(0, 0),
        sample(1, 0),
        sample(-1, 0),
        sample(0, 1),
        sample(0, -1),
    );
    let xy = 0.25 * (sample(1, 1) + sample(-1, -1) - sample(1, -1) - sample(-1, 1));
    let curvature = Mat2::from_cols_array(&[
        right + left - 2.0 * here,
        xy,
        xy,
        below + above - 2.0 * here,
    ]);
    let offset = curvature.as_dmat2().inverse()
        * (-0.5 * DVec2::new((right - left).into(), (below - above).into()));
    (offset.abs().max_element() < f64::from(FARTHEST)).then(|| offset.as_vec2())
}

fn extremum(levels: &[Rows], at: Candidate, offset: Vec3, strength: f32) -> Option<Extremum> {
    let [x, y, scale] = [
        at.x as f32 + offset.x,
        at.y as f32 + offset.y,
        at.level as f32 + offset.z,
    ];
    let inside = x >= 0.0
        && y >= 0.0
        && x <= (levels[0].width - 1) as f32
        && y <= (levels[0].height - 1) as f32
        && scale >= 0.0
        && scale <= (levels.len() - 1) as f32;
    inside.then_some(Extremum {
        x,
        y,
        scale,
        level: at.level,
        strength,
    })
}

/// Returns the neighbouring sample that is nearer to the peak, if it has neighbours on all sides.
fn moved(levels: &[Rows], at: Candidate, offset: Vec3) -> Candidate {
    let step = |position: usize, offset: f32, last: usize| match offset {
        _ if offset > MOVE_BEYOND && position < last => position + 1,
        _ if offset < -MOVE_BEYOND && position > 1 => position - 1,
        _ => position,
    };
    Candidate {
        x: step(at.x, offset.x, levels[0].width - 2),
        y: step(at.y, offset.y, levels[0].height - 2),
        level: at.level,
    }
}

/// Value and derivatives of the differences at a sample, in x, y and scale.
struct TaylorExpansion {
    value: f32,
    slope: Vec3,
    curvature: Mat3,
}

impl TaylorExpansion {
    fn at(levels: &[Rows], at: Candidate) -> Self {
        let sample = |dx: isize, dy: isize, ds: isize| {
            let level = at.level.wrapping_add_signed(ds);
            let (x, y) = (at.x.wrapping_add_signed(dx), at.y.wrapping_add_signed(dy));
            levels[level + 1].row(y)[x] - levels[level].row(y)[x]
        };
        let value = sample(0, 0, 0);
        let along = |dx: isize, dy: isize, ds: isize| (sample(dx, dy, ds), sample(-dx, -dy, -ds));
        let [(right, left), (below, above), (coarser, finer)] =
            [along(1, 0, 0), along(0, 1, 0), along(0, 0, 1)];
        let mixed = |a: (f32, f32), b: (f32, f32)| 0.25 * (a.0 + a.1 - b.0 - b.1);
        let xy = mixed(along(1, 1, 0), along(1, -1, 0));
        let xs = mixed(along(1, 0, 1), along(1, 0, -1));
        let ys = mixed(along(0, 1, 1), along(0, 1, -1));
        let second = |after: f32, before: f32| after + before - 2.0 * value;
        Self {
            value,
            slope: 0.5 * Vec3::new(right - left, below - above, coarser - finer),
            curvature: Mat3::from_cols(
                Vec3::new(second(right, left), xy, xs),
                Vec3::new(xy, second(below, above), ys),
                Vec3::new(xs, ys, second(coarser, finer)),
            ),
        }
    }

    /// Returns the extremum of the quadratic, from the sample; `None` if it is flat.
    fn peak(&self) -> Option<Vec3> {
        let offset = self.curvature.as_dmat3().inverse() * -self.slope.as_dvec3();
        offset.is_finite().then(|| offset.as_vec3())
    }

    /// Returns whether the ratio of the principal curvatures in the image plane is above `most`.
    fn is_edge(&self, most: f32) -> bool {
        let [x, y] = [self.curvature.x_axis, self.curvature.y_axis];
        let (trace, determinant) = (x.x + y.y, x.x * y.y - x.y * x.y);
        determinant <= 0.0 || trace * trace * most >= (most + 1.0).powi(2) * determinant
    }
}
