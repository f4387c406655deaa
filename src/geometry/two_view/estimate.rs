use glam::{DMat3, DVec2, DVec3};

use super::matched::Matched;
use super::models::{Agreement, Essential, Fundamental, Homography, Rotation};
use super::refine::refine_fundamental;
use crate::epipolar::{fundamental_in_pixels, poses_from_essential};
use crate::pose::nearest_rotation;
use crate::ransac::{Consensus, Estimator, RansacOptions, consensus};
use crate::{Camera, Pose};
use ostra_core::statistics::upper_median;

/// Options of [`estimate_two_view`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TwoViewOptions {
    /// Maximum error of an inlier, pixels.
    pub max_error_px: f64,
    /// Required probability of having drawn a sample without outliers.
    pub confidence: f64,
    /// Minimum number of inliers.
    pub min_inliers: usize,
    /// Maximum number of samples per model.
    pub max_iterations: usize,
    /// Seed of the samples.
    pub seed: u64,
}

impl Default for TwoViewOptions {
    fn default() -> Self {
        Self {
            max_error_px: 4.0,
            confidence: 0.999,
            min_inliers: 15,
            max_iterations: 2000,
            seed: 0,
        }
    }
}

/// Kind of the geometry between two views.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TwoViewKind {
    /// The intrinsics are correct.
    ///
    /// An essential matrix explains the inliers as well as a fundamental matrix.
    Calibrated,
    /// A fundamental matrix explains the inliers.
    ///
    /// The intrinsics are guesses, or it explains clearly more than an essential matrix.
    Uncalibrated,
    /// A homography explains nearly all inliers, and the camera moved.
    Planar,
    /// A rotation of the camera explains nearly all inliers.
    Panoramic,
}

/// Geometry and motion between two views.
#[derive(Debug, Clone, PartialEq)]
pub struct TwoView {
    /// Model that explains the inliers.
    pub kind: TwoViewKind,
    /// Motion of the camera with unit translation.
    ///
    /// `None` without parallax, and if no motion puts most points in front of both cameras.
    pub second_from_first: Option<Pose>,
    /// Indices of the inliers, ascending.
    pub inliers: Vec<u32>,
    /// Median angle between the rays of inliers, radians; 0 without a motion.
    ///
    /// Only inliers in front of both cameras count.
    pub parallax: f64,
    /// `F` with `x2ᵀ F x1 = 0` between pixels, Frobenius norm 1; `None` for panoramic views.
    ///
    /// Pixels are without lens distortion.
    pub fundamental: Option<DMat3>,
}

/// Share of a fundamental matrix's inliers with which an essential matrix is preferred.
const CALIBRATED_SHARE: f64 = 0.95;
/// Share of the inliers above which a homography or rotation alone explains them.
const SIMPLE_SHARE: f64 = 0.8;
/// Maximum number of samples without success.
///
/// [`VAIN_SIMPLE`] is for models with fewer degrees of freedom.
const VAIN: usize = 300;
const VAIN_SIMPLE: usize = 300;
/// Threshold factor for fundamental matrices near an essential matrix.
///
/// A wrong focal length causes errors of a few times the threshold, and these matches must be
/// included.
const WIDE: f64 = 3.0;
/// Ratio of neighbouring focal lengths that are tried around the guess.
///
/// Exponents go from −[`FOCAL_STEPS`] to [`FOCAL_STEPS`].
const FOCAL_RATIO: f64 = 1.03;
const FOCAL_STEPS: i32 = 40;
/// Number of samples among matches that are inliers of another model already.
const AMONG_INLIERS: usize = 100;

/// Estimates the motion between two images, its kind, and the matches that agree with it.
///
/// Returns `None` if fewer than `min_inliers` agree, or no more than by chance.
///
/// `matches_px` are positions in the first and second image. `calibrated` means that the intrinsics
/// of both cameras are known. Otherwise, a fundamental matrix or a homography determines the
/// inliers, and the motion is the best under the intrinsics given. The kinds are distinguished as
/// by J. Schönberger, J.-M. Frahm, *Structure-from-Motion Revisited*, CVPR 2016.
#[must_use]
pub fn estimate_two_view(
    cameras: [&Camera; 2],
    calibrated: bool,
    matches_px: &[[DVec2; 2]],
    options: &TwoViewOptions,
) -> Option<TwoView> {
    if matches_px.len() < options.min_inliers {
        return None;
    }
    let matched = Matched::new(cameras, matches_px, options.max_error_px);
    let search = TwoViewEstimation {
        cameras,
        matched: &matched,
        options,
    };
    if calibrated {
        search.calibrated()
    } else {
        search.uncalibrated()
    }
}

/// Returns whether a homography between rays is that of a rotating camera, for any focal length.
///
/// It is `K R K⁻¹` with `K = diag(f, f, 1)` for some f relative to the guess, and with the nearest
/// rotation it still explains nearly all matches.
fn is_turn(homography: &DMat3, matched: &Matched) -> bool {
    let enough = SIMPLE_SHARE * matched.pairs.len() as f64;
    (-FOCAL_STEPS..=FOCAL_STEPS).any(|step| {
        let focal = DVec3::new(1.0, 1.0, FOCAL_RATIO.powi(-step));
        let (scaled, back) = (
            DMat3::from_diagonal(focal),
            DMat3::from_diagonal(focal.recip()),
        );
        let turn = back * *homography * scaled;
        let turn = turn * turn.determinant().signum()
            / turn.determinant().abs().cbrt().max(f64::MIN_POSITIVE);
        let turned = scaled * nearest_rotation(turn) * back;
        Agreement(matched, Homography).inliers(&turned).len() as f64 > enough
    })
}

struct TwoViewEstimation<'a> {
    cameras: [&'a Camera; 2],
    matched: &'a Matched,
    options: &'a TwoViewOptions,
}

impl TwoViewEstimation<'_> {
    fn calibrated(&self) -> Option<TwoView> {
        let Some(essential) = self.seek(
            &Agreement(self.matched, Essential),
            VAIN,
            self.chance_of_band(),
        ) else {
            return Some(
                self.panoramic(
                    &self
                        .seek_simple(&Agreement(self.matched, Rotation))?
                        .inliers,
                ),
            );
        };
        let inside = self.matched.chosen(&essential.inliers);
        if let Some(turn) = self.most(&Agreement(&inside, Rotation)) {
            return Some(self.panoramic(&Agreement(self.matched, Rotation).inliers(&turn)));
        }
        let kind = if self.most(&Agreement(&inside, Homography)).is_some() {
            TwoViewKind::Planar
        } else if CALIBRATED_SHARE * self.freed(essential.model) > inside.pairs.len() as f64 {
            return self.uncalibrated();
        } else {
            TwoViewKind::Calibrated
        };
        Some(self.reported(
            kind,
            &essential.inliers,
            Some(essential.model),
            Some(essential.model),
        ))
    }

    fn uncalibrated(&self) -> Option<TwoView> {
        let any = self.seek(
            &Agreement(self.matched, Fundamental),
            VAIN,
            self.chance_of_band(),
        );
        let plane = match &any {
            // A homography that explains most inliers of the fundamental matrix is found among
            // them.
            Some(any) => self.among(&Agreement(&self.matched.chosen(&any.inliers), Homography)),
            None => self.seek_simple(&Agreement(self.matched, Homography)),
        };
        let on_plane = plane.as_ref().map_or_else(Vec::new, |plane| {
            Agreement(self.matched, Homography).inliers(&plane.model)
        });
        let flat = on_plane.len() as f64
            > SIMPLE_SHARE * any.as_ref().map_or(0.0, |any| any.inliers.len() as f64);
        let agreed = match &any {
            Some(any) if any.inliers.len() >= on_plane.len() => &any.inliers,
            _ => &on_plane,
        };
        if agreed.is_empty() {
            return None;
        }
        let inside = self.matched.chosen(agreed);
        if flat && plane.is_some_and(|plane| is_turn(&plane.model, &inside)) {
            return Some(self.panoramic(agreed));
        }
        let essential = self
            .among(&Agreement(&inside, Essential))
            .map(|found| found.model);
        let (kind, fundamental) = match &any {
            Some(any) if !flat => (TwoViewKind::Uncalibrated, Some(any.model)),
            _ => (TwoViewKind::Planar, essential),
        };
        Some(self.reported(kind, agreed, fundamental, essential))
    }

    fn seek<E: Estimator>(
        &self,
        estimator: &E,
        max_vain: usize,
        chance: f64,
    ) -> Option<Consensus<E::Model>> {
        let by_chance = chance * self.matched.pairs.len() as f64;
        // Number of inliers of random matches: the sample's own, those in the band, and a margin
        // for many samples.
        let lucky = (E::SAMPLE as f64 + by_chance + 4.0 * by_chance.sqrt()).ceil() as usize;
        let found = consensus(
            estimator,
            &self.ransac(max_vain, self.options.min_inliers.max(lucky)),
        )?;
        self.spread_out(&found.inliers).then_some(found)
    }

    /// Searches for a plane or rotation if no motion was found.
    fn seek_simple<E: Estimator>(&self, estimator: &E) -> Option<Consensus<E::Model>> {
        self.seek(estimator, VAIN_SIMPLE, 0.0)
    }

    /// Searches for a model among matches that are inliers of another model already.
    fn among<E: Estimator>(&self, estimator: &E) -> Option<Consensus<E::Model>> {
        let options = RansacOptions {
            max_iterations: AMONG_INLIERS,
            ..self.ransac(AMONG_INLIERS, E::SAMPLE)
        };
        consensus(estimator, &options)
    }

    /// Returns the model of [`Self::among`] if it explains nearly all matches.
    fn most<E: Estimator>(&self, estimator: &E) -> Option<E::Model> {
        let found = self.among(estimator)?;
        (found.inliers.len() as f64 > SIMPLE_SHARE * estimator.count() as f64)
            .then_some(found.model)
    }

    /// Returns the number of inliers of the best fundamental matrix near an essential matrix.
    ///
    /// Two are subtracted for its two additional degrees of freedom.
    fn freed(&self, essential: DMat3) -> f64 {
        let wide = refine_fundamental(self.matched, essential, WIDE);
        let near = wide.and_then(|wide| refine_fundamental(self.matched, wide, 1.0));
        near.map_or(0.0, |f| {
            Agreement(self.matched, Fundamental).inliers(&f).len() as f64 - 2.0
        })
    }

    fn ransac(&self, max_vain: usize, min_inliers: usize) -> RansacOptions {
        let TwoViewOptions {
            confidence,
            max_iterations,
            seed,
            ..
        } = *self.options;
        RansacOptions {
            confidence,
            max_iterations,
            max_vain,
            min_inliers,
            seed,
        }
    }

    /// Returns the share of the second image within the threshold of a line across it.
    fn chance_of_band(&self) -> f64 {
        let [w, h] =
            [self.cameras[1].width, self.cameras[1].height].map(|side| f64::from(side.max(1)));
        (2.0 * self.options.max_error_px * w.hypot(h) / (w * h)).min(1.0)
    }

    /// Returns whether inliers are neither in one place nor collinear in either image.
    ///
    /// Otherwise, they do not determine a motion.
    fn spread_out(&self, places: &[u32]) -> bool {
        [0, 1].into_iter().all(|side| {
            let at = || {
                places
                    .iter()
                    .map(|&place| self.matched.pairs[place as usize][side])
            };
            let count = places.len() as f64;
            let mean = at().sum::<DVec2>() / count;
            let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
            for d in at().map(|x| (x - mean) * self.cameras[side].focal_px) {
                (xx, xy, yy) = (xx + d.x * d.x, xy + d.x * d.y, yy + d.y * d.y);
            }
            let width_squared = (0.5 * (xx + yy) - (0.5 * (xx - yy)).hypot(xy)) / count;
            width_squared > 0.25 * self.options.max_error_px * self.options.max_error_px
        })
    }

    fn panoramic(&self, places: &[u32]) -> TwoView {
        self.reported(TwoViewKind::Panoramic, places, None, None)
    }

    fn reported(
        &self,
        kind: TwoViewKind,
        places: &[u32],
        fundamental: Option<DMat3>,
        essential: Option<DMat3>,
    ) -> TwoView {
        let pairs: Vec<[DVec2; 2]> = places
            .iter()
            .map(|&place| self.matched.pairs[place as usize])
            .collect();
        let motion = essential.and_then(|essential| motion_in_front(essential, &pairs));
        TwoView {
            kind,
            second_from_first: motion.as_ref().map(|m| m.second_from_first),
            inliers: self.given(places),
            parallax: motion.map_or(0.0, |m| m.parallax),
            fundamental: fundamental.map(|f| fundamental_in_pixels(f, self.cameras)),
        }
    }

    /// Returns the indices in the caller's list, ascending.
    fn given(&self, places: &[u32]) -> Vec<u32> {
        let mut given: Vec<u32> = places
            .iter()
            .map(|&place| self.matched.given[place as usize])
            .collect();
        given.sort_unstable();
        given
    }
}

/// A motion and its parallax.
pub(super) struct Motion {
    pub second_from_first: Pose,
    /// Median angle between the rays of matches in front of both cameras, in radians.
    pub parallax: f64,
}

/// Returns the motion of an essential matrix that puts most points in front of both cameras.
///
/// Returns `None` if these are less than half of the points.
pub(super) fn motion_in_front(essential: DMat3, pairs: &[[DVec2; 2]]) -> Option<Motion> {
    let mut best: Option<(Pose, Vec<f64>)> = None;
    for pose in poses_from_essential(essential)? {
        let angles = angles_in_front(&pose, pairs);
        if best
            .as_ref()
            .is_none_or(|(_, most)| angles.len() > most.len())
        {
            best = Some((pose, angles));
        }
    }
    let (second_from_first, mut angles) = best?;
    if 2 * angles.len() < pairs.len() || angles.is_empty() {
        return None;
    }
    Some(Motion {
        second_from_first,
        parallax: upper_median(&mut angles)?,
    })
}

/// Returns the angles between the rays of all matches that intersect in front of both cameras.
fn angles_in_front(pose: &Pose, pairs: &[[DVec2; 2]]) -> Vec<f64> {
    let (r, t) = (DMat3::from_quat(pose.rotation), pose.translation);
    let angle = |[x1, x2]: &[DVec2; 2]| {
        let (a, b) = (r * x1.extend(1.0), x2.extend(1.0));
        let (aa, ab, bb, at, bt) = (a.dot(a), a.dot(b), b.dot(b), a.dot(t), b.dot(t));
        // Both depths, times (aa · bb − ab²), which is never negative.
        let [first, second] = [ab * bt - bb * at, aa * bt - ab * at];
        (first > 0.0 && second > 0.0).then(|| a.cross(b).length().atan2(ab))
    };
    pairs.iter().filter_map(angle).collect()
}
