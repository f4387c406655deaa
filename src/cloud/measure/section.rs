use glam::{DVec2, DVec3};

use super::medial::MedialCurve;
use super::point_sets::PointGrid;
use ostra_core::statistics::upper_median;

/// Shape of a cross-section of a body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum CrossSection {
    /// Round, with its diameter.
    Round(f64),
    /// A sheet cut across, with its width along the sheet.
    Sheet(f64),
    /// Neither, or too few points to decide.
    Other,
}

/// Returns the cross-sections along a body's medial curve, one every `step`.
///
/// A cross-section consists of the points within half a step of its cutting plane. They are also
/// within `widest`, or one step if that is larger, of the curve point.
pub(super) fn sections(
    points: &[DVec3],
    curve: &MedialCurve,
    step: f64,
    widest: f64,
) -> Vec<CrossSection> {
    let radius = widest.max(step);
    let grid = PointGrid::new(points, radius);
    let cut = |&(x, along): &(DVec3, DVec3)| {
        let (u, v) = along.any_orthonormal_pair();
        let slab: Vec<DVec2> = grid
            .within(x, radius)
            .map(|k| points[k] - x)
            .filter(|offset| offset.dot(along).abs() <= 0.5 * step)
            .map(|offset| DVec2::new(offset.dot(u), offset.dot(v)))
            .collect();
        section(&slab)
    };
    curve.stations(step).iter().map(cut).collect()
}

/// Minimum number of points of a cross-section.
const LEAST_POINTS: usize = 8;
/// Minimum visible arc of a round section, in radians.
const LEAST_ARC: f64 = 2.0;
/// Maximum RMS distance of the points from a round section, as a share of its radius.
const ROUNDNESS: f64 = 0.15;

fn section(points: &[DVec2]) -> CrossSection {
    if points.len() < LEAST_POINTS {
        return CrossSection::Other;
    }
    let round = robust_circle(points).filter(|circle| circle.arc(points) >= LEAST_ARC);
    let round = round.filter(|circle| circle.deviation(points) <= ROUNDNESS * circle.radius);
    round
        .map(|circle| CrossSection::Round(2.0 * circle.radius))
        .or_else(|| sheet_width(points).map(CrossSection::Sheet))
        .unwrap_or(CrossSection::Other)
}

/// Maximum RMS distance of a sheet's points from a parabola, as a share of the sheet's width.
const FLATNESS: f64 = 0.12;

/// Returns the arc length of the parabola fitted to the points in their principal axes.
///
/// The arc is that between the outermost points. Returns `None` if the points are too far off the
/// parabola for a sheet.
fn sheet_width(points: &[DVec2]) -> Option<f64> {
    let mean = points.iter().sum::<DVec2>() / points.len() as f64;
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for offset in points.iter().map(|&x| x - mean) {
        xx += offset.x * offset.x;
        xy += offset.x * offset.y;
        yy += offset.y * offset.y;
    }
    let axis = DVec2::from_angle(0.5 * (2.0 * xy).atan2(xx - yy));
    let local: Vec<DVec2> = points
        .iter()
        .map(|&x| DVec2::new((x - mean).dot(axis), (x - mean).perp_dot(axis)))
        .collect();
    let [height, slope, bend] = parabola(&local)?;
    let residual = |x: &DVec2| (x.y - height - x.x * (slope + x.x * bend)).powi(2);
    let deviation = (local.iter().map(residual).sum::<f64>() / local.len() as f64).sqrt();
    let (low, high) = local
        .iter()
        .fold((f64::MAX, f64::MIN), |(l, h), x| (l.min(x.x), h.max(x.x)));
    if deviation > FLATNESS * (high - low) {
        return None;
    }
    let steps = 32;
    let width = (high - low) / f64::from(steps);
    let piece = |k: i32| {
        let x = low + (f64::from(k) + 0.5) * width;
        width * (slope + 2.0 * bend * x).hypot(1.0)
    };
    Some((0..steps).map(piece).sum())
}

/// Fits `y = c0 + c1 x + c2 x²` by least squares; returns `None` if it is not determined.
pub(super) fn parabola(points: &[DVec2]) -> Option<[f64; 3]> {
    let mut normal = nalgebra::Matrix3::<f64>::zeros();
    let mut right = nalgebra::Vector3::<f64>::zeros();
    for x in points {
        let row = nalgebra::Vector3::new(1.0, x.x, x.x * x.x);
        normal += row * row.transpose();
        right += row * x.y;
    }
    let solution = normal.cholesky()?.solve(&right);
    solution
        .iter()
        .all(|v| v.is_finite())
        .then_some([solution[0], solution[1], solution[2]])
}

#[derive(Debug, Clone, Copy)]
struct Circle {
    centre: DVec2,
    radius: f64,
}

impl Circle {
    fn residual(&self, x: DVec2) -> f64 {
        (x.distance(self.centre) - self.radius).abs()
    }

    fn deviation(&self, points: &[DVec2]) -> f64 {
        (points
            .iter()
            .map(|&x| self.residual(x).powi(2))
            .sum::<f64>()
            / points.len() as f64)
            .sqrt()
    }

    /// Returns the arc in radians that the points cover as seen from the centre.
    ///
    /// This is the full circle less the widest gap.
    fn arc(&self, points: &[DVec2]) -> f64 {
        let mut angles: Vec<f64> = points
            .iter()
            .map(|&x| (x - self.centre).to_angle())
            .collect();
        angles.sort_by(f64::total_cmp);
        let across = angles[0] + std::f64::consts::TAU - angles[angles.len() - 1];
        let gap = angles
            .windows(2)
            .map(|pair| pair[1] - pair[0])
            .fold(across, f64::max);
        std::f64::consts::TAU - gap
    }
}

/// Fits a circle to all points, then to those within 2.5 median residuals of the first fit.
fn robust_circle(points: &[DVec2]) -> Option<Circle> {
    let first = taubin_circle(points)?;
    let mut residuals: Vec<f64> = points.iter().map(|&x| first.residual(x)).collect();
    let limit = 2.5 * upper_median(&mut residuals)? + 1e-12;
    let near: Vec<DVec2> = points
        .iter()
        .copied()
        .filter(|&x| first.residual(x) <= limit)
        .collect();
    if near.len() < LEAST_POINTS {
        Some(first)
    } else {
        taubin_circle(&near)
    }
}

/// Fits a circle algebraically, without the bias of short arcs.
///
/// The method is that of Taubin, "Estimation of planar curves, surfaces and nonplanar space curves
/// defined by implicit equations", IEEE PAMI 1991. It is solved by Newton's method as in Chernov,
/// "Circular and Linear Regression", 2010.
fn taubin_circle(points: &[DVec2]) -> Option<Circle> {
    let count = points.len() as f64;
    let mean = points.iter().sum::<DVec2>() / count;
    let (mut xx, mut yy, mut xy, mut xz, mut yz, mut zz) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for offset in points.iter().map(|&x| x - mean) {
        let z = offset.length_squared();
        xx += offset.x * offset.x / count;
        yy += offset.y * offset.y / count;
        xy += offset.x * offset.y / count;
        xz += offset.x * z / count;
        yz += offset.y * z / count;
        zz += z * z / count;
    }
    let z = xx + yy;
    let covariance = xx * yy - xy * xy;
    let variance = zz - z * z;
    let a3 = 4.0 * z;
    let a2 = -3.0 * z * z - zz;
    let a1 = variance * z + 4.0 * covariance * z - xz * xz - yz * yz;
    let a0 = xz * (xz * yy - yz * xy) + yz * (yz * xx - xz * xy) - variance * covariance;
    let mut root = 0.0;
    for _ in 0..50 {
        let value = a0 + root * (a1 + root * (a2 + root * a3));
        let slope = a1 + root * (2.0 * a2 + root * 3.0 * a3);
        let next = root - value / slope;
        if !next.is_finite() || (next - root).abs() <= 1e-14 * next.abs() {
            break;
        }
        root = next;
    }
    let determinant = root * root - root * z + covariance;
    let shift =
        DVec2::new(xz * (yy - root) - yz * xy, yz * (xx - root) - xz * xy) / determinant / 2.0;
    let circle = Circle {
        centre: mean + shift,
        radius: (shift.length_squared() + z).sqrt(),
    };
    (circle.radius.is_finite() && circle.radius > 0.0).then_some(circle)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn circle_is_recovered_from_an_arc() {
        let arc: Vec<DVec2> = (0..40)
            .map(|k| DVec2::new(3.0, -1.0) + 2.5 * DVec2::from_angle(0.07 * f64::from(k)))
            .collect();
        let circle = robust_circle(&arc).unwrap();
        assert!(
            (circle.radius - 2.5).abs() < 1e-6
                && circle.centre.distance(DVec2::new(3.0, -1.0)) < 1e-6
        );
        assert!((circle.arc(&arc) - 39.0 * 0.07).abs() < 1e-6);
        assert_eq!(section(&arc), CrossSection::Round(2.0 * circle.radius));
    }

    #[test]
    fn outliers_do_not_move_the_circle() {
        let mut points: Vec<DVec2> = (0..60)
            .map(|k| DVec2::from_angle(0.1 * f64::from(k)))
            .collect();
        points.extend([DVec2::new(3.0, 0.0), DVec2::new(0.2, 0.1)]);
        assert!((robust_circle(&points).unwrap().radius - 1.0).abs() < 0.02);
    }

    #[test]
    fn width_of_a_bent_sheet_is_its_arc_length() {
        let sheet: Vec<DVec2> = (0..=50)
            .map(|k| 16.0 * DVec2::from_angle(0.01 * f64::from(k)))
            .collect();
        let CrossSection::Sheet(width) = section(&sheet) else {
            panic!("a short arc is a sheet")
        };
        assert!((width / 8.0 - 1.0).abs() < 0.005, "{width}");
    }
}
