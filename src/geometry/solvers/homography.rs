use glam::{DMat3, DVec2};
use nalgebra::SMatrix;

use super::eight_point::{Centring, least_eigenvector};
use super::null_space::from_rows;

/// Determinant of three points, relative to their lengths, below which they are collinear.
const LINE: f64 = 1e-10;

/// Returns the homography with `x2 ~ H x1` for four pairs of points `[x1, x2]`.
///
/// No three points may be collinear. The determinant is ±1 (R. Hartley, A. Zisserman, *Multiple
/// View Geometry in Computer Vision*, 2004, 2.3, via the projective basis). Returns `None` for
/// three collinear points. Also returns `None` if points change sides of a line through two of
/// them, which no view of a plane does.
#[must_use]
pub fn homography4(pairs: &[[DVec2; 2]; 4]) -> Option<DMat3> {
    let [from, to] = [0, 1].map(|side| projective_basis(pairs.map(|pair| pair[side])));
    let ((from, from_shares), (to, to_shares)) = (from?, to?);
    // A plane in front of both cameras keeps the orientation of its points: all factors have the
    // same sign.
    let ratio = from_shares * to_shares;
    if ratio.min_element() < 0.0 && ratio.max_element() > 0.0 {
        return None;
    }
    unit_determinant(to * from.inverse())
}

/// Returns the matrix of the projective basis of four points.
///
/// It maps the three axes to the first three points, and (1, 1, 1) to the fourth. Also returns the
/// fourth point's coordinates in terms of the first three.
fn projective_basis(points: [DVec2; 4]) -> Option<(DMat3, glam::DVec3)> {
    let [a, b, c, d] = points.map(|x| x.extend(1.0));
    let corners = DMat3::from_cols(a, b, c);
    let size = a.length() * b.length() * c.length();
    let det = corners.determinant();
    if det.is_nan() || det.abs() <= LINE * size {
        return None;
    }
    let shares = corners.inverse() * d;
    if shares.is_nan() || shares.abs().min_element() <= LINE {
        return None;
    }
    Some((
        DMat3::from_cols(a * shares.x, b * shares.y, c * shares.z),
        shares,
    ))
}

/// Returns the homography with the least weighted algebraic error over four or more pairs.
///
/// Direct linear transform on normalised points (R. Hartley, A. Zisserman, 2004, algorithm 4.2);
/// the determinant is ±1. Returns `None` for degenerate points.
#[must_use]
pub fn homography(pairs: &[[DVec2; 2]], weights: &[f64]) -> Option<DMat3> {
    if weights.iter().filter(|&&w| w > 0.0).count() < 4 {
        return None;
    }
    let to_first = Centring::of(pairs, weights, 0)?;
    let to_second = Centring::of(pairs, weights, 1)?;
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    for (pair, weight) in pairs.iter().zip(weights) {
        let (x1, x2) = (to_first.apply(pair[0]), to_second.apply(pair[1]));
        let rows = [
            [
                x1.x,
                x1.y,
                1.0,
                0.0,
                0.0,
                0.0,
                -x2.x * x1.x,
                -x2.x * x1.y,
                -x2.x,
            ],
            [
                0.0,
                0.0,
                0.0,
                x1.x,
                x1.y,
                1.0,
                -x2.y * x1.x,
                -x2.y * x1.y,
                -x2.y,
            ],
        ];
        for i in 0..9 {
            let [u, v] = [weight * rows[0][i], weight * rows[1][i]];
            (0..9).for_each(|j| normal[(j, i)] += u * rows[0][j] + v * rows[1][j]);
        }
    }
    let centred = from_rows(&least_eigenvector(normal)?);
    unit_determinant(to_second.matrix().inverse() * centred * to_first.matrix())
}

fn unit_determinant(h: DMat3) -> Option<DMat3> {
    let scaled = h * (1.0 / h.determinant().abs().cbrt());
    scaled.is_finite().then_some(scaled)
}
