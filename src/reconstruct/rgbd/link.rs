use serde::{Deserialize, Serialize};

use super::agreement::Agreement;
use super::align::{Aligned, align};
use super::pyramid::{LEVELS, Pyramid};
use super::scan::Scan;
use ostra_geometry::{AbsolutePoseOptions, Pose, PoseEdge, estimate_absolute_pose};

/// Least share of one view that the other sees.
const LEAST_OVERLAP: f64 = 0.15;
/// Least share of what is seen that agrees; see [`Agreement::consistent`].
const LEAST_CONSISTENT: f64 = 0.9;
/// Least likeness of the pictures where the surfaces agree.
const LEAST_LIKENESS: f64 = 0.5;
/// Features that must agree on a pose for it to be a guess.
const LEAST_FEATURES: usize = 12;

/// How two frames came to be compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LinkKind {
    /// One follows the other.
    Odometry,
    /// They look alike, or were named by hand.
    Loop,
    /// Poses known by then showed that they see the same.
    Overlap,
    /// The shapes of the pieces that they belong to fit.
    Shape,
}

/// Two frames that agree in depth and picture.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FrameLink {
    /// Numbers of the two frames.
    pub frames: [usize; 2],
    /// How they came to be compared.
    pub kind: LinkKind,
    /// Share of what both see that agrees, 0–1.
    pub consistent: f64,
    /// Whether it counts: the other links do not contradict it.
    pub holds: bool,
}

/// Two scans whose views were aligned and agree.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Link {
    /// Places of the two scans, the source's first.
    pub scans: [usize; 2],
    /// How they came to be compared.
    pub kind: LinkKind,
    /// How the target stands to the source.
    pub aligned: Aligned,
    /// How well they agree.
    pub agreement: Agreement,
}

impl Link {
    /// The edge of a pose graph.
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

/// Aligns two views from the first guess that leads to agreement.
///
/// # Errors
/// The best agreement, where none is enough.
pub fn align_and_check(
    [source, target]: [&Pyramid; 2],
    guesses: &[(Pose, Start)],
) -> Result<(Aligned, Agreement), Option<Agreement>> {
    let mut best: Option<Agreement> = None;
    for (guess, start) in guesses {
        let Some(aligned) = align(source, target, guess, start.coarsest()) else {
            continue;
        };
        let agreement = Agreement::of(source, target, &aligned.target_from_source);
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

/// Whether two views that agree so much show the same place.
#[must_use]
fn is_enough(agreement: &Agreement) -> bool {
    agreement.overlap >= LEAST_OVERLAP
        && agreement.consistent >= LEAST_CONSISTENT
        && agreement.likeness >= LEAST_LIKENESS
}

/// How far off a guess may be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Start {
    /// As far as the camera may move between two frames.
    Far,
    /// About as much as poses from features are.
    Near,
}

impl Start {
    fn coarsest(self) -> usize {
        match self {
            Self::Far => LEVELS - 1,
            Self::Near => LEVELS - 2,
        }
    }
}

/// The pose that most matches of features agree on: places of the source's, seen in the target's picture.
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
