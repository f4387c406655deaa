//! Refinement of the pose between two clouds on their surfaces, and measures of its quality.

use glam::DVec3;
use nalgebra::{Matrix6, Vector6};
use serde::{Deserialize, Serialize};

use super::icp::{PartnerExtent, iterate};
use super::levels::{IcpLevel, Partner};
use super::oriented::{OrientedCloud, check_voxel};
use ostra_cloud::SceneError;
use ostra_core::job::{Progress, Stopped};
use ostra_geometry::Pose;

/// Options of refinement.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct RefineOptions {
    /// Edge of the coarsest voxels in world units, above 0; the initial pose may be off by about
    /// this much. The finest voxels are a quarter of it.
    pub voxel: f32,
    /// Weight of the surfaces' distance, 0–1; the rest is brightness. 1 = brightness is not used.
    pub lambda_geometric: f64,
}

impl Default for RefineOptions {
    fn default() -> Self {
        Self {
            voxel: 0.05,
            lambda_geometric: 0.968,
        }
    }
}

/// Voxels of each level (as a share of the coarsest), and number of iterations.
const LEVELS: [(f32, usize); 3] = [(1.0, 50), (0.5, 30), (0.25, 14)];
/// Minimum share of the partners found by surfaces alone that must remain after brightness is used.
const KEPT: f64 = 0.97;

/// A refined pose and measures of its quality.
///
/// They are measured on the finest voxels. Partners are source and target points within 0.35 of the
/// coarsest voxels with normals within 45°.
///
/// None of the numbers proves a pose right: in a room with walls at right angles a wrong one can
/// have a quarter of its points next to a partner, with a small error and similar brightness. The
/// reliable measure is `agreeing` of the [`super::GlobalAlignment`] that it started from. The
/// numbers do show some errors. A refined pose more than a few voxels from its start has left what
/// the matches agree on. A low `fitness` is little overlap, a low `firmness` a surface that slides,
/// and a low `correlation` two surfaces of different appearance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refined {
    /// Pose that brings the source onto the target.
    pub target_from_source: Pose,
    /// Share of the source's points that have a partner, 0–1.
    pub fitness: f64,
    /// Root mean square of the partners' point-to-plane distances, in world units.
    ///
    /// It is never above 0.35 voxels, so it shows the noise of the clouds and not whether the pose
    /// is right.
    pub rmse: f64,
    /// How strongly the surfaces constrain the least constrained motion, 0 to 1/6.
    ///
    /// It is the mean squared cosine between that motion and the one that each partner constrains
    /// most. Rotations are counted as shifts at the partners' typical distance from their middle. 0
    /// = the surfaces slide freely, as on one wall; rooms with furniture have more than 0.015.
    pub observability: f64,
    /// Pearson's correlation of the partners' intensities, −1 to 1; `None` if one side has a single intensity.
    pub correlation: Option<f64>,
    /// Sum over partners of JᵀJ, a symmetric matrix.
    ///
    /// J is the derivative of the source point, transformed to the target's space, by `delta` in
    /// `target_from_source ← exp(delta) · target_from_source`: rotation about x, y, z (radians),
    /// then shift. It counts partners as points that coincide, so it grows with the overlap and
    /// does not show a surface that slides; `firmness` does.
    pub information: [[f64; 6]; 6],
}

/// Refines a pose that is accurate to about a voxel.
///
/// The voxels have the edge in the options, a half and a quarter of it (as J. Park et al. 2017 do,
/// see `icp`). Surfaces come first: brightness then moves the pose only if that leaves the surfaces
/// as near to each other, so colours that are not aligned with their depths do no harm. The same
/// input gives the same bytes, whatever the number of threads. `None` if no source point finds a
/// partner.
///
/// # Errors
/// [`SceneError::Request`] for lists of unequal length or options out of range;
/// [`SceneError::Stopped`].
pub fn refine_registration(
    source: &OrientedCloud,
    target: &OrientedCloud,
    start: &Pose,
    options: &RefineOptions,
    progress: &Progress,
) -> Result<Option<Refined>, SceneError> {
    check(source, target, options)?;
    let with_brightness = options.lambda_geometric < 1.0;
    let mut levels = Vec::new();
    for (share, iterations) in LEVELS {
        let level = IcpLevel::new(
            [source, target],
            share * options.voxel,
            with_brightness,
            progress,
        )?;
        levels.extend(level.map(|level| (level, iterations)));
    }
    let mut best = refined(&levels, *start, 1.0, progress)?;
    if let Some(surfaces) = best.filter(|_| with_brightness) {
        let both = refined(
            &levels,
            surfaces.target_from_source,
            options.lambda_geometric,
            progress,
        )?;
        best = both
            .filter(|both| both.fitness >= KEPT * surfaces.fitness)
            .or(best);
    }
    Ok(best)
}

fn refined(
    levels: &[(IcpLevel, usize)],
    start: Pose,
    lambda: f64,
    progress: &Progress,
) -> Result<Option<Refined>, Stopped> {
    let mut pose = start;
    for (level, iterations) in levels {
        pose = iterate(level, pose, *iterations, lambda, progress)?;
    }
    let Some((finest, _)) = levels.last() else {
        return Ok(None);
    };
    let partners = finest.partners(&pose, &mut Vec::new(), progress)?;
    Ok((!partners.is_empty()).then(|| Refined {
        target_from_source: pose,
        fitness: partners.len() as f64 / finest.source.len() as f64,
        rmse: rmse(finest, &partners),
        observability: observability(finest, &partners),
        correlation: correlation(finest, &partners),
        information: information(&partners),
    }))
}

fn check(
    source: &OrientedCloud,
    target: &OrientedCloud,
    options: &RefineOptions,
) -> Result<(), SceneError> {
    source.check()?;
    target.check()?;
    check_voxel(options.voxel)?;
    if (0.0..=1.0).contains(&options.lambda_geometric) {
        return Ok(());
    }
    Err(SceneError::Request(
        "the weight of the surfaces' distance must be from 0 to 1".into(),
    ))
}

/// Returns the sum over partners of JᵀJ, J = the derivative of the moved point by a motion
/// `exp(delta)`, rotation first.
pub fn information(partners: &[Partner]) -> [[f64; 6]; 6] {
    let mut sum = Matrix6::zeros();
    for partner in partners {
        for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
            let turn = partner.moved.cross(axis);
            let row = Vector6::new(turn.x, turn.y, turn.z, axis.x, axis.y, axis.z);
            sum.ger(1.0, &row, &row, 1.0);
        }
    }
    sum.into()
}

/// Returns how strongly the surfaces constrain the least constrained motion, 0 to 1/6.
///
/// It is the mean over partners of the squared cosine between that motion and the one that changes
/// their point-to-plane distance most, in the units of their extent.
pub fn observability(level: &IcpLevel, partners: &[Partner]) -> f64 {
    let extent = PartnerExtent::new(partners);
    let mut sum: Matrix6<f64> = Matrix6::zeros();
    for partner in partners {
        let row = extent
            .along(
                partner.moved,
                level.target.normals[partner.target].as_dvec3(),
            )
            .normalize();
        sum.ger(1.0, &row, &row, 1.0);
    }
    (sum.symmetric_eigenvalues().min() / partners.len() as f64).max(0.0)
}

/// Returns the root mean square of the partners' point-to-plane distances.
pub fn rmse(level: &IcpLevel, partners: &[Partner]) -> f64 {
    let squares: f64 = partners
        .iter()
        .map(|partner| level.distance(partner).powi(2))
        .sum();
    (squares / partners.len().max(1) as f64).sqrt()
}

/// Returns Pearson's correlation of the partners' intensities; `None` if those of one cloud are all equal.
pub fn correlation(level: &IcpLevel, partners: &[Partner]) -> Option<f64> {
    let pairs = || {
        let intensity = |partner: &Partner| {
            [
                level.source.intensities[partner.source],
                level.target.intensities[partner.target],
            ]
            .map(f64::from)
        };
        partners.iter().map(intensity)
    };
    let count = partners.len().max(1) as f64;
    let mean = pairs().fold([0.0; 2], |sum, pair| {
        [sum[0] + pair[0] / count, sum[1] + pair[1] / count]
    });
    let [mut source, mut target, mut both] = [0.0; 3];
    for pair in pairs() {
        let [a, b] = [pair[0] - mean[0], pair[1] - mean[1]];
        source += a * a;
        target += b * b;
        both += a * b;
    }
    let scale = (source * target).sqrt();
    (scale > 1e-9 * count).then(|| both / scale)
}
