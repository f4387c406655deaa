//! Links between two frames: their relative pose, and whether depth and image agree on it.

use serde::{Deserialize, Serialize};

use super::align::{Aligned, align};
use super::pyramid::{LEVELS, Pyramid, PyramidLevel};
use super::scan::Scan;
use ostra_geometry::{
    AbsolutePoseOptions, Isometry, Pose, PoseEdge, estimate_absolute_pose, is_same_depth,
};

/// Minimum share of one view that the other sees.
const LEAST_OVERLAP: f64 = 0.15;
/// Minimum share of what is seen that agrees; see [`ViewAgreement::consistent`].
const LEAST_CONSISTENT: f64 = 0.9;
/// Minimum similarity of the images where the surfaces agree.
const LEAST_LIKENESS: f64 = 0.5;
/// Minimum number of features that must agree on a pose to make it an initial guess.
const LEAST_FEATURES: usize = 12;

/// Reason why two frames were compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LinkKind {
    /// One follows the other.
    Odometry,
    /// Their appearance is similar, or the user named them.
    Loop,
    /// Poses known by then showed that they see the same.
    Overlap,
    /// The shapes of their fragments fit.
    Shape,
}

/// Two frames that agree in depth and image.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FrameLink {
    /// Numbers of the two frames.
    pub frames: [usize; 2],
    /// Reason why they were compared.
    pub kind: LinkKind,
    /// Share of the jointly visible pixels that agrees, 0–1.
    pub consistent: f64,
    /// Whether it is used: the other links do not contradict it.
    pub holds: bool,
}

/// Two scans whose views were aligned and agree.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Link {
    /// Indices of the two scans, the source's first.
    pub scans: [usize; 2],
    /// Reason why they were compared.
    pub kind: LinkKind,
    /// Alignment of the target with the source.
    pub aligned: Aligned,
    /// How well they agree.
    pub agreement: ViewAgreement,
}

impl Link {
    /// Returns the edge of a pose graph.
    #[must_use]
    pub fn edge(&self) -> PoseEdge {
        let [source, target] = self.scans;
        let Aligned {
            target_from_source,
            information,
            ..
        } = self.aligned;
        PoseEdge {
            source,
            target,
            target_from_source,
            information,
            weight: self.agreement.overlap,
            switchable: true,
        }
    }
}

/// Aligns two views from the first initial pose that leads to agreement.
///
/// # Errors
/// The best agreement, if none is sufficient.
pub fn align_and_check(
    [source, target]: [&Pyramid; 2],
    guesses: &[(Pose, PoseGuess)],
) -> Result<(Aligned, ViewAgreement), Option<ViewAgreement>> {
    let mut best: Option<ViewAgreement> = None;
    for (guess, start) in guesses {
        let Some(aligned) = align(source, target, guess, start.coarsest()) else {
            continue;
        };
        let agreement = ViewAgreement::of(source, target, &aligned.target_from_source);
        if is_enough(&agreement) {
            return Ok((aligned, agreement));
        }
        if best.is_none_or(|best| {
            best.consistent * best.overlap < agreement.consistent * agreement.overlap
        }) {
            best = Some(agreement);
        }
    }
    Err(best)
}

/// Returns whether an agreement is sufficient for two views of the same place.
#[must_use]
fn is_enough(agreement: &ViewAgreement) -> bool {
    agreement.overlap >= LEAST_OVERLAP
        && agreement.consistent >= LEAST_CONSISTENT
        && agreement.likeness >= LEAST_LIKENESS
}

/// How far off an initial pose may be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PoseGuess {
    /// As large as the camera motion between two frames.
    Far,
    /// About as large as for poses from features.
    Near,
}

impl PoseGuess {
    fn coarsest(self) -> usize {
        match self {
            Self::Far => LEVELS - 1,
            Self::Near => LEVELS - 2,
        }
    }
}

/// Estimates the pose that most matches of features agree on: source points, seen in the target's image.
#[must_use]
pub fn pose_from_features(
    source: &Scan,
    target: &Scan,
    matches: &[(u32, u32)],
    seed: u64,
) -> Option<Pose> {
    let seen = matches.iter().filter_map(|&(a, b)| {
        Some((
            source.places[a as usize]?,
            target.features.keypoints[b as usize],
        ))
    });
    let (points, at_px): (Vec<_>, Vec<_>) = seen.unzip();
    let options = AbsolutePoseOptions {
        max_error_px: 4.0,
        min_inliers: LEAST_FEATURES,
        seed,
        ..Default::default()
    };
    let found = estimate_absolute_pose(&target.camera, &at_px, &points, &options)?;
    Some(found.camera_from_world)
}

/// The level on which agreement is measured.
const LEVEL: usize = 1;
/// Surfaces that differ by at most this share of the depth are the same.
const TOLERANCE: f32 = 0.03;
/// Below this standard deviation of luma, similarity of the images is not informative.
const LEAST_TEXTURE: f64 = 0.02;

/// How well the content of two views fits together under a pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewAgreement {
    /// Share of the source's pixels with known depth that lie on surfaces of the target, 0–1.
    pub overlap: f64,
    /// Share of the pixels on or in front of the target's surfaces that lie on them, 0–1.
    ///
    /// A surface in front would hide what the target sees behind it.
    pub consistent: f64,
    /// Correlation of the two images where they show the same, −1 to 1; 1 where there is no texture.
    pub likeness: f64,
}

impl ViewAgreement {
    /// Measures both directions and returns the smaller value of each.
    #[must_use]
    pub fn of(source: &Pyramid, target: &Pyramid, target_from_source: &Pose) -> Self {
        let one = seen_by(
            &source.levels[LEVEL],
            &target.levels[LEVEL],
            target_from_source,
        );
        let other = seen_by(
            &target.levels[LEVEL],
            &source.levels[LEVEL],
            &target_from_source.inverse(),
        );
        Self {
            overlap: one.overlap.max(other.overlap),
            consistent: one.consistent.min(other.consistent),
            likeness: one.likeness.min(other.likeness),
        }
    }
}

fn seen_by(source: &PyramidLevel, target: &PyramidLevel, pose: &Pose) -> ViewAgreement {
    let target_from_source = Isometry::from(pose);
    let (mut known, mut same, mut before) = (0u32, 0u32, 0u32);
    let mut moments = Moments::default();
    for y in 0..source.height {
        for x in 0..source.width {
            let pixel = y * source.width + x;
            let depth = source.depths[pixel];
            if depth <= 0.0 {
                continue;
            }
            known += 1;
            let point = target_from_source.transform(source.ray(x, y) * depth);
            let Some(at_px) = target.project(point) else {
                continue;
            };
            let there = target.depths[at_px.y as usize * target.width + at_px.x as usize];
            if there <= 0.0 {
                continue;
            }
            if is_same_depth(point.z, there, TOLERANCE) {
                same += 1;
                if let Some((seen, _)) = target.grey_at(at_px) {
                    moments.add(f64::from(source.grey[pixel]), f64::from(seen));
                }
            } else if point.z < there {
                before += 1;
            }
        }
    }
    ViewAgreement {
        overlap: f64::from(same) / f64::from(known.max(1)),
        consistent: f64::from(same) / f64::from((same + before).max(1)),
        likeness: moments.correlation(),
    }
}

/// Sums for a correlation.
#[derive(Default)]
struct Moments {
    count: f64,
    sums: [f64; 2],
    products: [f64; 3],
}

impl Moments {
    fn add(&mut self, a: f64, b: f64) {
        self.count += 1.0;
        self.sums = [self.sums[0] + a, self.sums[1] + b];
        self.products = [
            self.products[0] + a * a,
            self.products[1] + a * b,
            self.products[2] + b * b,
        ];
    }

    fn correlation(&self) -> f64 {
        let count = self.count.max(1.0);
        let [a, b] = self.sums.map(|sum| sum / count);
        let [aa, ab, bb] = self.products.map(|sum| sum / count);
        let (spread_a, spread_b) = ((aa - a * a).max(0.0).sqrt(), (bb - b * b).max(0.0).sqrt());
        if spread_a.max(spread_b) < LEAST_TEXTURE {
            return 1.0;
        }
        (ab - a * b) / (spread_a * spread_b).max(1e-9)
    }
}
