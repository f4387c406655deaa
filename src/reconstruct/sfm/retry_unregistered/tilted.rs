//! Matching of left-out images under simulated tilts.

use rayon::prelude::*;

use super::attempt::{Attempt, Gains, begin, left_out};
use crate::sfm::asift::{Merged, Tilt, one_to_one};
use crate::sfm::matching::NearestMatcher;
use crate::sfm::pairs::{MatchedImage, verify};
use crate::sfm::{
    CachedExtractor, CachedMatcher, FeatureMatcher, Features, ImageFeatures, SfmError, SfmRequest,
    SparseModel, TriedPair,
};
use ostra_core::job::{PlannedStage, Progress};
use ostra_frames::FrameStore;

/// Maximum number of images matched under tilts; those with most matches with one other come first.
const MOST: usize = 8;
/// Longest side of the images that are tilted, in pixels: there are many views.
const FULL_SIDE: usize = 1600;
/// Longest side of the small copies from which the promising tilts are chosen, in pixels: a third of
/// [`FULL_SIDE`], as in the paper, or a little more.
const COARSE_SIDE: usize = 600;
/// Number of promising tilts, as in the paper.
const PROMISING: usize = 5;

/// Matches images that were left out under the simulated tilts that are promising for each.
pub(super) fn under_promising_tilts(
    attempt: &Attempt,
    request: &SfmRequest<'_>,
    store: &FrameStore,
    progress: &Progress,
) -> Result<Gains, SfmError> {
    let promising = |retry: &Retry<'_>, views: Views<'_>| {
        let mut tilts = retry.ranked_tilts(views)?;
        tilts.truncate(PROMISING);
        Ok(tilts)
    };
    let stage = PlannedStage::new(
        "match unregistered images again",
        "Match left-over images again",
        2.5,
    );
    let mut images = left_out(attempt);
    images.truncate(MOST);
    under_tilts(
        attempt, &images, &promising, &stage, request, store, progress,
    )
}

/// Matches images under all simulated tilts.
pub(super) fn under_all_tilts(
    attempt: &Attempt,
    images: &[usize],
    request: &SfmRequest<'_>,
    store: &FrameStore,
    progress: &Progress,
) -> Result<Gains, SfmError> {
    let all = |_: &Retry<'_>, _: Views<'_>| Ok(Tilt::all());
    let stage = PlannedStage::new(
        "match unregistered images under all tilts",
        "Match left-over images under all tilts",
        4.5,
    );
    under_tilts(attempt, images, &all, &stage, request, store, progress)
}

/// Selects tilts for an image.
type TiltChoice<'a> = &'a dyn Fn(&Retry<'_>, Views<'_>) -> Result<Vec<Tilt>, SfmError>;

/// Matches images under the chosen tilts; the weight of `stage` is that of one image.
fn under_tilts(
    attempt: &Attempt,
    images: &[usize],
    choose: TiltChoice<'_>,
    stage: &PlannedStage,
    request: &SfmRequest<'_>,
    store: &FrameStore,
    progress: &Progress,
) -> Result<Gains, SfmError> {
    let mut gains = Gains::default();
    let Some(kept) = attempt.models.first() else {
        return Ok(gains);
    };
    if images.is_empty() {
        return Ok(gains);
    }
    let count = images.len();
    let weight = stage.weight * count as f64;
    begin(progress, PlannedStage::new(stage.name, stage.step, weight))?;
    for (done, &image) in images.iter().enumerate() {
        progress.step(done, count)?;
        let retry = Retry {
            attempt,
            model: &kept.model,
            image,
            seed: request.mapper.seed,
            enough: request.mapper.pose_inliers,
            cached: request.cached,
            progress,
        };
        let frame = request.mapped[image];
        let views = |tilts: &[Tilt], max_side| {
            let extractor = request.frame_extractor(store);
            extractor.tilted(frame, tilts, max_side, progress)
        };
        let tilts = choose(&retry, &views)?;
        if let Some(found) = retry.gains(&views(&tilts, FULL_SIDE)?)? {
            gains.images.insert(image, found.image);
            gains.pairs.extend(found.pairs);
        }
    }
    Ok(gains)
}

/// Number of model images that an image is compared with; those with most matches come first.
const NEIGHBOURS: usize = 24;
/// Number of these that are compared before it is checked whether more are needed.
const TOGETHER: usize = 8;
/// Number of images that agree with enough matches each, with which no more are needed.
const SUFFICIENT: usize = 4;

/// Additional matches of one image.
struct Gained {
    /// Its features, followed by those of tilted views.
    image: ImageFeatures,
    /// Pairs for which more matches agree than before.
    pairs: Vec<TriedPair>,
}

/// Searches for matches between an image that no model contains and the images of a model.
pub(super) struct Retry<'a> {
    pub attempt: &'a Attempt,
    pub model: &'a SparseModel,
    pub image: usize,
    pub seed: u64,
    /// Minimum number of agreeing matches with one image for a pose.
    pub enough: usize,
    pub cached: Option<&'a CachedExtractor<'a>>,
    pub progress: &'a Progress,
}

/// Extracts features of tilted views of an image, first shrunk to the given longest side; none if it
/// cannot be read.
pub(super) type Views<'a> = &'a dyn Fn(&[Tilt], usize) -> Result<Vec<ImageFeatures>, SfmError>;

/// Matches of one view: number of the view, keypoints of view and neighbour.
type OfView = (usize, Vec<(u32, u32)>);

impl Retry<'_> {
    /// Returns all tilts, those first under which a small copy of the image has most matches.
    ///
    /// J.-M. Morel, G. Yu, *ASIFT: A New Framework for Fully Affine Invariant Image Comparison*,
    /// SIAM J. Imaging Sciences 2009, section 5 (two resolutions).
    pub fn ranked_tilts(&self, views: Views<'_>) -> Result<Vec<Tilt>, SfmError> {
        let tilts = Tilt::all();
        let views = views(&tilts, COARSE_SIDE)?;
        let mut matches = vec![0; tilts.len()];
        let mut neighbours = self.neighbours();
        neighbours.truncate(TOGETHER);
        let views: Vec<&ImageFeatures> = views.iter().collect();
        for (view, found) in self.matches(&views, &neighbours)?.into_iter().flatten() {
            matches[view] += found.len();
        }
        let mut ranked: Vec<(usize, Tilt)> = matches.into_iter().zip(tilts).collect();
        ranked.sort_by_key(|&(matches, _)| std::cmp::Reverse(matches));
        Ok(ranked.into_iter().map(|(_, tilt)| tilt).collect())
    }

    /// Matches the image and its tilted `views`.
    ///
    /// Returns `None` if no more matches agree than before, or too few for a pose with every image.
    fn gains(&self, views: &[ImageFeatures]) -> Result<Option<Gained>, SfmError> {
        let own = &self.attempt.images[self.image];
        let all: Vec<&ImageFeatures> = std::iter::once(own).chain(views).collect();
        let mut merged = Merged::new(own);
        let mut pairs: Vec<TriedPair> = Vec::new();
        for neighbours in self.neighbours().chunks(TOGETHER) {
            let mut found = Vec::with_capacity(neighbours.len());
            for by_view in self.matches(&all, neighbours)? {
                let numbered = by_view.into_iter().flat_map(|(view, matches)| {
                    let numbers: Vec<_> = matches
                        .into_iter()
                        .map(|(index, other)| (merged.number(all[view], index), other))
                        .collect();
                    numbers
                });
                found.push(one_to_one(numbered));
            }
            let tried = neighbours
                .par_iter()
                .zip(&found)
                .map(|(&other, found)| self.verified(merged.image(), other, found));
            let tried: Vec<TriedPair> = tried.collect();
            let gained = |pair: &TriedPair| agreeing(pair) > self.agreed(pair.images);
            pairs.extend(tried.into_iter().filter(gained));
            let good = pairs.iter().filter(|pair| agreeing(pair) >= self.enough);
            if good.count() >= SUFFICIENT {
                break;
            }
        }
        let image = merged.into_image();
        Ok(pairs
            .iter()
            .any(|pair| agreeing(pair) >= self.enough)
            .then_some(Gained { image, pairs }))
    }

    /// Returns images of the model, those with most matches first.
    fn neighbours(&self) -> Vec<usize> {
        let matches = |other: u32| {
            let pair = ordered(self.image as u32, other);
            self.attempt
                .tried
                .iter()
                .find(|tried| tried.images == pair)
                .map_or(0, |tried| tried.matches)
        };
        let mut ranked: Vec<(usize, u32)> = self
            .model
            .placed()
            .map(|other| (matches(other), other))
            .collect();
        ranked.sort_unstable_by_key(|&(matches, other)| (std::cmp::Reverse(matches), other));
        ranked.truncate(NEIGHBOURS);
        let others = ranked.into_iter().map(|(_, other)| other as usize);
        others.collect()
    }

    /// Returns the matches of each view by neighbour.
    ///
    /// Nearest neighbours are used whatever the chosen matcher, because there are many views.
    fn matches(
        &self,
        views: &[&ImageFeatures],
        neighbours: &[usize],
    ) -> Result<Vec<Vec<OfView>>, SfmError> {
        let others = neighbours.iter().map(|&other| &self.attempt.images[other]);
        let set: Vec<&Features> = views
            .iter()
            .copied()
            .chain(others)
            .map(|image| &image.features)
            .collect();
        let Some(first) = set.first() else {
            return Ok(Vec::new());
        };
        let nearest = match first.descriptors.as_bytes() {
            Some(_) => NearestMatcher::for_bytes(),
            None => NearestMatcher::for_floats(),
        };
        let cached = self.cached.map(|cached| CachedMatcher {
            matcher: &nearest,
            identity: cached.identity,
            cache: cached.cache,
        });
        let matcher: &dyn FeatureMatcher = match &cached {
            Some(cached) => cached,
            None => &nearest,
        };
        let matcher = matcher.of_set(&set)?;
        let of_neighbour = |other: usize| {
            let of_view = |view: usize| {
                self.progress.check()?;
                Ok((view, matcher(view, views.len() + other)?))
            };
            (0..views.len()).map(of_view).collect()
        };
        (0..neighbours.len())
            .into_par_iter()
            .map(of_neighbour)
            .collect()
    }

    /// Verifies the matches of this image with another one.
    fn verified(&self, image: &ImageFeatures, other: usize, matches: &[(u32, u32)]) -> TriedPair {
        let Attempt {
            problem, images, ..
        } = self.attempt;
        let numbered = |image: usize, features| MatchedImage {
            image,
            features,
            camera: problem.cameras[problem.images[image].camera],
            cache: self.cached.map(|cached| cached.cache),
        };
        let own = numbered(self.image, &image.features);
        let other = numbered(other, &images[other].features);
        if own.image < other.image {
            return verify([own, other], matches, self.seed);
        }
        let turned: Vec<(u32, u32)> = matches.iter().map(|&(a, b)| (b, a)).collect();
        verify([other, own], &turned, self.seed)
    }

    /// Returns how many matches of a pair agreed in the first attempt.
    fn agreed(&self, images: [u32; 2]) -> usize {
        self.attempt
            .tried
            .iter()
            .find(|pair| pair.images == images)
            .map_or(0, agreeing)
    }
}

fn agreeing(pair: &TriedPair) -> usize {
    pair.verified.as_ref().map_or(0, |pair| pair.matches.len())
}

fn ordered(a: u32, b: u32) -> [u32; 2] {
    [a.min(b), a.max(b)]
}
