use glam::{DMat3, DVec2};
use nalgebra::Matrix3;

use super::matched::{MatchLanes, Matched, epipolar_errors, transfer_errors};
use super::refine::{refine_essential, refine_fundamental};
use crate::ransac::{Estimator, LANES};
use crate::solvers::{five_point, homography, homography4, seven_point};

/// A kind of matrix between rays.
pub(super) trait Relation {
    /// Number of matches that determine a matrix.
    const SAMPLE: usize;

    /// Appends all matrices that satisfy the matches of a sample.
    fn fit(matched: &Matched, sample: &[usize], found: &mut Vec<DMat3>);
    /// Returns squared errors in pixels.
    fn errors(m: &DMat3, block: &MatchLanes) -> [f64; LANES];
    /// Returns a matrix near `start` that fits its inliers better.
    fn refine(matched: &Matched, start: &DMat3) -> Option<DMat3>;
}

/// `x2ᵀ E x1 = 0` with an essential matrix.
pub(super) struct Essential;
/// `x2ᵀ F x1 = 0` with any singular matrix.
pub(super) struct Fundamental;
/// `x2 ~ H x1`.
pub(super) struct Homography;
/// `x2 ~ R x1` with a rotation.
pub(super) struct Rotation;

/// RANSAC estimator for one kind of matrix.
pub(super) struct Agreement<'a, R>(pub &'a Matched, pub R);

impl<R: Relation> Estimator for Agreement<'_, R> {
    type Model = DMat3;
    const SAMPLE: usize = R::SAMPLE;

    fn count(&self) -> usize {
        self.0.pairs.len()
    }

    fn fit(&self, sample: &[usize], found: &mut Vec<DMat3>) {
        R::fit(self.0, sample, found);
    }

    fn cost(&self, model: &DMat3, enough: f64) -> f64 {
        self.0.cost(
            enough,
            #[inline(always)]
            |block| R::errors(model, block),
        )
    }

    fn inliers(&self, model: &DMat3) -> Vec<u32> {
        agreeing::<R>(self.0, model)
    }

    fn refine(&self, model: &DMat3) -> Option<DMat3> {
        R::refine(self.0, model)
    }
}

/// Returns the indices of the matches that agree with a matrix.
fn agreeing<R: Relation>(matched: &Matched, m: &DMat3) -> Vec<u32> {
    matched.within(|block| R::errors(m, block))
}

fn sample_of<const N: usize>(matched: &Matched, sample: &[usize]) -> [[DVec2; 2]; N] {
    std::array::from_fn(|i| matched.pairs[sample[i]])
}

/// Returns whether all points of a sample can lie in front of both cameras.
///
/// `e2 × x2` and `m x1` then have the same direction for all points, or the opposite one for all
/// (O. Chum, T. Werner, J. Matas, *Epipolar Geometry Estimation via RANSAC Benefits from the
/// Oriented Epipolar Constraint*, ICPR 2004).
fn in_front(m: &DMat3, pairs: &[[DVec2; 2]]) -> bool {
    let crosses = [
        m.x_axis.cross(m.y_axis),
        m.y_axis.cross(m.z_axis),
        m.z_axis.cross(m.x_axis),
    ];
    let epipole = crosses.into_iter().fold(crosses[0], |a, b| {
        if b.length_squared() > a.length_squared() {
            b
        } else {
            a
        }
    });
    let same_way =
        |[x1, x2]: &[DVec2; 2]| epipole.cross(x2.extend(1.0)).dot(*m * x1.extend(1.0)) > 0.0;
    let first = same_way(&pairs[0]);
    pairs[1..].iter().all(|pair| same_way(pair) == first)
}

impl Relation for Essential {
    const SAMPLE: usize = 5;

    fn fit(matched: &Matched, sample: &[usize], found: &mut Vec<DMat3>) {
        let pairs = sample_of(matched, sample);
        found.extend(
            five_point(&pairs)
                .into_iter()
                .filter(|e| in_front(e, &pairs)),
        );
    }

    #[inline(always)]
    fn errors(m: &DMat3, block: &MatchLanes) -> [f64; LANES] {
        epipolar_errors(m, block)
    }

    fn refine(matched: &Matched, start: &DMat3) -> Option<DMat3> {
        refine_essential(matched, *start)
    }
}

impl Relation for Fundamental {
    const SAMPLE: usize = 7;

    fn fit(matched: &Matched, sample: &[usize], found: &mut Vec<DMat3>) {
        let pairs = sample_of(matched, sample);
        found.extend(
            seven_point(&pairs)
                .into_iter()
                .filter(|f| in_front(f, &pairs)),
        );
    }

    #[inline(always)]
    fn errors(m: &DMat3, block: &MatchLanes) -> [f64; LANES] {
        epipolar_errors(m, block)
    }

    fn refine(matched: &Matched, start: &DMat3) -> Option<DMat3> {
        refine_fundamental(matched, *start, 1.0)
    }
}

impl Relation for Homography {
    const SAMPLE: usize = 4;

    fn fit(matched: &Matched, sample: &[usize], found: &mut Vec<DMat3>) {
        found.extend(homography4(&sample_of(matched, sample)));
    }

    #[inline(always)]
    fn errors(m: &DMat3, block: &MatchLanes) -> [f64; LANES] {
        transfer_errors(m, block)
    }

    fn refine(matched: &Matched, start: &DMat3) -> Option<DMat3> {
        let chosen = agreeing::<Self>(matched, start);
        let pairs: Vec<[DVec2; 2]> = chosen
            .iter()
            .map(|&place| matched.pairs[place as usize])
            .collect();
        homography(&pairs, &vec![1.0; pairs.len()])
    }
}

impl Relation for Rotation {
    const SAMPLE: usize = 2;

    fn fit(matched: &Matched, sample: &[usize], found: &mut Vec<DMat3>) {
        let [[a1, a2], [b1, b2]] = sample_of(matched, sample);
        let frame = |a: DVec2, b: DVec2| {
            let (a, b) = (a.extend(1.0).normalize(), b.extend(1.0).normalize());
            let across = a.cross(b).try_normalize()?;
            let middle = (a + b).normalize();
            Some(DMat3::from_cols(middle, across, middle.cross(across)))
        };
        found.extend(
            frame(a1, b1)
                .zip(frame(a2, b2))
                .map(|(from, to)| to * from.transpose()),
        );
    }

    #[inline(always)]
    fn errors(m: &DMat3, block: &MatchLanes) -> [f64; LANES] {
        transfer_errors(m, block)
    }

    fn refine(matched: &Matched, start: &DMat3) -> Option<DMat3> {
        // W. Kabsch, *A solution for the best rotation to relate two sets of vectors*, Acta Cryst.
        // A 1976.
        let mut covariance = DMat3::ZERO;
        for place in agreeing::<Self>(matched, start) {
            let [a, b] = matched.pairs[place as usize].map(|ray| ray.extend(1.0).normalize());
            covariance += DMat3::from_cols(b * a.x, b * a.y, b * a.z);
        }
        let svd = Matrix3::from_column_slice(&covariance.to_cols_array()).svd(true, true);
        let (mut u, vt) = (svd.u?, svd.v_t?);
        if (u * vt).determinant() < 0.0 {
            u.column_mut(svd.singular_values.imin()).neg_mut();
        }
        Some(DMat3::from_cols_slice((u * vt).as_slice()))
    }
}
