//! Matches as pairs of points, and the pose that aligns them.

use glam::{DMat3, DQuat, DVec3};
use nalgebra::{Matrix3, Vector3};
use pulp::Arch;

use super::fpfh::DescribedCloud;
use super::matching::DescriptorMatch;
use ostra_geometry::Pose;
use ostra_geometry::ransac::{Cutoff, LANES, within};

/// Below this ratio of singular values, points count as lying on one line.
const LINE_RATIO: f64 = 1e-9;

/// Returns the rigid motion that brings sources nearest to targets, by weighted least squares.
///
/// Pairs are (source, target, weight): W. Kabsch, *A solution for the best rotation to relate two
/// sets of vectors*, Acta Cryst. A 1976. `None` for pairs in one position or line, or without
/// weight.
pub fn align(pairs: impl Iterator<Item = (DVec3, DVec3, f64)> + Clone) -> Option<Pose> {
    let (mut source_mean, mut target_mean, mut total) = (DVec3::ZERO, DVec3::ZERO, 0.0);
    for (source, target, weight) in pairs.clone() {
        source_mean += weight * source;
        target_mean += weight * target;
        total += weight;
    }
    (source_mean, target_mean) = (source_mean / total, target_mean / total);
    let mut covariance = DMat3::ZERO;
    for (source, target, weight) in pairs {
        let (source, target) = (source - source_mean, weight * (target - target_mean));
        covariance += DMat3::from_cols(target * source.x, target * source.y, target * source.z);
    }
    if !covariance.is_finite() {
        return None;
    }
    let svd = Matrix3::from_column_slice(&covariance.to_cols_array()).svd(true, true);
    let (u, vt, sigma) = (svd.u?, svd.v_t?, svd.singular_values);
    if sigma[0] <= 0.0 || sigma[1] <= LINE_RATIO * sigma[0] {
        return None;
    }
    let flip = if (u * vt).determinant() < 0.0 {
        -1.0
    } else {
        1.0
    };
    let matrix = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, flip)) * vt;
    let rotation = DQuat::from_mat3(&DMat3::from_cols_slice(matrix.as_slice())).normalize();
    Some(Pose {
        rotation,
        translation: target_mean - rotation * source_mean,
    })
}

/// Minimum cosine of the angle between the normals of two points that are the same.
pub const SAME_NORMAL: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// Maximum difference of the cosine of the angle between two normals in both clouds.
const NORMAL_TOLERANCE: f64 = 0.35;

/// Matched points of two clouds, most similar first.
pub struct PointPairs {
    /// Source and target point.
    pub points: Vec<[DVec3; 2]>,
    normals: Vec<[DVec3; 2]>,
    blocks: Vec<PairLanes>,
    limit: f64,
    arch: Arch,
}

/// Coordinates of source, then target; NaN where there is none.
type PairLanes = [[f64; LANES]; 6];

impl PointPairs {
    /// Creates pairs of matched descriptors; pairs agree with a pose within `distance`.
    pub fn new(
        source: &DescribedCloud,
        target: &DescribedCloud,
        matches: &[DescriptorMatch],
        distance: f64,
    ) -> Self {
        let ends = |one: &DescriptorMatch| [(source, one.source), (target, one.target)];
        let of = |(cloud, place): (&DescribedCloud, u32)| cloud.places[place as usize] as usize;
        let point = |end: (&DescribedCloud, u32)| end.0.cloud.positions[of(end)].as_dvec3();
        let normal = |end: (&DescribedCloud, u32)| end.0.cloud.normals[of(end)].as_dvec3();
        let points: Vec<[DVec3; 2]> = matches.iter().map(|one| ends(one).map(point)).collect();
        let normals = matches.iter().map(|one| ends(one).map(normal)).collect();
        let blocks = points.chunks(LANES).map(block).collect();
        Self {
            points,
            normals,
            blocks,
            limit: distance * distance,
            arch: Arch::new(),
        }
    }

    /// Returns whether two pairs can belong to one rigid motion.
    ///
    /// The distances between the points must be equal up to the ratio `edge_ratio`, and the angles
    /// between the normals similar.
    pub fn fit_together(&self, one: usize, other: usize, edge_ratio: f64) -> bool {
        let [here, there] =
            [0, 1].map(|end| self.points[one][end].distance(self.points[other][end]));
        let [here_turn, there_turn] =
            [0, 1].map(|end| self.normals[one][end].dot(self.normals[other][end]));
        // Two pairs that share a point are at distance 0 and do not constrain a motion.
        here > edge_ratio * there
            && there > edge_ratio * here
            && (here_turn - there_turn).abs() < NORMAL_TOLERANCE
    }

    /// Returns whether the pose rotates a pair's normals onto each other.
    pub fn same_normal(&self, pose: &Pose, pair: usize) -> bool {
        (pose.rotation * self.normals[pair][0]).dot(self.normals[pair][1]) > SAME_NORMAL
    }

    /// Returns the sum of squared distances, truncated at the limit; may end early above `enough`.
    pub fn cost(&self, pose: &Pose, enough: f64) -> f64 {
        let rotation = DMat3::from_quat(pose.rotation);
        self.arch.dispatch(Cutoff::new(
            &self.blocks,
            self.points.len(),
            [self.limit, enough],
            #[inline(always)]
            |block| errors(&rotation, pose.translation, block),
        ))
    }

    /// Returns the pairs within the distance, ascending.
    pub fn within(&self, pose: &Pose) -> Vec<u32> {
        let rotation = DMat3::from_quat(pose.rotation);
        within(&self.blocks, self.limit, |block| {
            errors(&rotation, pose.translation, block)
        })
    }

    /// Returns how many pairs agree with a pose, in distance and normals.
    pub fn agreeing(&self, pose: &Pose) -> usize {
        self.within(pose)
            .into_iter()
            .filter(|&pair| self.same_normal(pose, pair as usize))
            .count()
    }

    /// Returns the pose that fits best to the pairs that agree with a pose.
    pub fn refined(&self, pose: &Pose) -> Option<Pose> {
        let near = self.within(pose);
        align(near.iter().map(|&pair| {
            (
                self.points[pair as usize][0],
                self.points[pair as usize][1],
                1.0,
            )
        }))
    }
}

fn block(chunk: &[[DVec3; 2]]) -> PairLanes {
    let mut block = [[f64::NAN; LANES]; 6];
    for (lane, [source, target]) in chunk.iter().enumerate() {
        for (row, value) in block
            .iter_mut()
            .zip(source.to_array().into_iter().chain(target.to_array()))
        {
            row[lane] = value;
        }
    }
    block
}

#[inline(always)]
fn errors(rotation: &DMat3, translation: DVec3, block: &PairLanes) -> [f64; LANES] {
    let [columns, shift] = [rotation.to_cols_array_2d(), [translation.to_array(); 3]];
    let mut errors = [0.0; LANES];
    for axis in 0..3 {
        for lane in 0..LANES {
            let moved = columns[0][axis] * block[0][lane] + columns[1][axis] * block[1][lane];
            let miss =
                moved + columns[2][axis] * block[2][lane] + shift[0][axis] - block[3 + axis][lane];
            errors[lane] += miss * miss;
        }
    }
    errors
}
