//! Second attempt at images that no model contains: simulated tilts of them are matched, and all is
//! mapped again.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::asift::{Merged, one_to_one};
use super::matching::NearestMatcher;
use super::pairs::{MatchedImage, verify};
use super::registration_report::FEW_FEATURES;
use super::request::SfmRequest;
use super::{
    FeatureMatcher, Features, ImageFeatures, MapProblem, Mapped, SfmError, SparseModel, TriedPair,
    map,
};
use ostra_core::job::{PlannedStage, Progress};
use ostra_frames::FrameStore;

/// Maximum number of images in the second attempt; those with most matches with one other come first.
const MOST: usize = 8;

/// Input of the mapper, and its result.
pub(super) struct Attempt {
    /// The mapping problem.
    pub problem: MapProblem,
    /// Features by image.
    pub images: Vec<ImageFeatures>,
    /// All pairs that were matched.
    pub tried: Vec<TriedPair>,
    /// The models, the kept one first.
    pub models: Vec<Mapped>,
}

/// Searches for more matches of images that no model contains, and maps again if there are any.
///
/// An image taken at a grazing angle shows its content so foreshortened that its features are not
/// recognised until the tilt is simulated away. If every image was placed, nothing of this runs.
///
/// Returns the first attempt if the second places no more images, or when stopped.
///
/// # Errors
/// [`SfmError`] if the extractor or the matcher fails.
pub(super) fn retry_unregistered(
    mut first: Attempt,
    request: &SfmRequest<'_>,
    store: &FrameStore,
    progress: &Progress,
) -> Result<Attempt, SfmError> {
    let gained = match retry(&first, request, store, progress) {
        Ok(gained) if gained.is_empty() => return Ok(first),
        Err(SfmError::Stopped(_)) => return Ok(first),
        gained => gained?,
    };
    let (problem, tried) = with_gains(&first, &gained);
    let again = progress
        .stage("map")
        .and_then(|()| map(&problem, &request.mapper, progress));
    let Ok(models) = again else { return Ok(first) };
    if placed(&models) <= placed(&first.models) {
        return Ok(first);
    }
    for (image, found) in gained {
        first.images[image] = found.image;
    }
    Ok(Attempt {
        problem,
        tried,
        models,
        ..first
    })
}

/// Returns additional matches by image that was left out, where any were found.
fn retry(
    first: &Attempt,
    request: &SfmRequest<'_>,
    store: &FrameStore,
    progress: &Progress,
) -> Result<BTreeMap<usize, Gained>, SfmError> {
    let mut gained = BTreeMap::new();
    let (Some(kept), images) = (first.models.first(), left_out(first)) else {
        return Ok(gained);
    };
    if images.is_empty() {
        return Ok(gained);
    }
    progress.plan_next(&[
        PlannedStage::new(
            "match unregistered images again",
            "Match left-over images again",
            2.0 * images.len() as f64,
        ),
        PlannedStage::new(
            "map",
            "Compute cameras again",
            0.4 * first.images.len() as f64,
        ),
    ]);
    progress.stage("match unregistered images again")?;
    for (done, &image) in images.iter().enumerate() {
        progress.step(done, images.len())?;
        let frame = request.mapped[image];
        let views = request.frame_extractor(store).tilted(frame, progress)?;
        let look = Retry {
            attempt: first,
            model: &kept.model,
            image,
            seed: request.mapper.seed,
        };
        if let Some(found) = look.gains(&views, request.mapper.pose_inliers, progress)? {
            gained.insert(image, found);
        }
    }
    Ok(gained)
}

/// Returns the images that no model contains although they have enough features.
fn left_out(attempt: &Attempt) -> Vec<usize> {
    let is_placed = |image: usize| {
        attempt
            .models
            .iter()
            .any(|mapped| mapped.model.is_placed(image as u32))
    };
    let is_rich = |image: usize| attempt.images[image].features.keypoints.len() >= FEW_FEATURES;
    let mut images: Vec<usize> = (0..attempt.images.len())
        .filter(|&image| is_rich(image) && !is_placed(image))
        .collect();
    let most_matches = |image: usize| {
        let own = attempt
            .tried
            .iter()
            .filter(|pair| pair.images.contains(&(image as u32)));
        own.map(|pair| pair.matches).max()
    };
    images.sort_by_cached_key(|&image| (std::cmp::Reverse(most_matches(image)), image));
    images.truncate(MOST);
    images
}

/// Returns the problem and its pairs, extended by the additional matches.
fn with_gains(first: &Attempt, gained: &BTreeMap<usize, Gained>) -> (MapProblem, Vec<TriedPair>) {
    let (mut problem, mut tried) = (first.problem.clone(), first.tried.clone());
    for (&image, found) in gained {
        problem.images[image]
            .keypoints
            .clone_from(&found.image.features.keypoints);
        for pair in &found.pairs {
            match tried.iter_mut().find(|known| known.images == pair.images) {
                Some(known) => known.clone_from(pair),
                None => tried.push(pair.clone()),
            }
        }
    }
    problem.pairs = tried
        .iter()
        .filter_map(|pair| pair.verified.clone())
        .collect();
    (problem, tried)
}

/// Returns how many images the kept model contains.
fn placed(models: &[Mapped]) -> usize {
    models.first().map_or(0, |kept| kept.model.placed().count())
}

/// Number of model images that an image is compared with; those with most matches come first.
const NEIGHBOURS: usize = 24;

/// Additional matches of one image.
struct Gained {
    /// Its features, followed by those of tilted views.
    pub image: ImageFeatures,
    /// Pairs for which more matches agree than before.
    pub pairs: Vec<TriedPair>,
}

/// Searches for matches between an image that no model contains and the images of a model.
struct Retry<'a> {
    pub attempt: &'a Attempt,
    pub model: &'a SparseModel,
    pub image: usize,
    pub seed: u64,
}

/// Matches of one view: number of the view, keypoints of view and neighbour.
type OfView = (usize, Vec<(u32, u32)>);

impl Retry<'_> {
    /// Matches the image and its tilted `views`; `None` without a sufficient gain.
    ///
    /// There is none if no more matches agree than before, or fewer than `enough` with any one
    /// image, which is too few for a pose.
    pub fn gains(
        &self,
        views: &[ImageFeatures],
        enough: usize,
        progress: &Progress,
    ) -> Result<Option<Gained>, SfmError> {
        let own = &self.attempt.images[self.image];
        let all: Vec<&ImageFeatures> = std::iter::once(own).chain(views).collect();
        let neighbours = self.neighbours();
        let mut merged = Merged::new(own);
        let mut found = Vec::with_capacity(neighbours.len());
        for by_view in self.matches(&all, &neighbours, progress)? {
            let numbered = by_view.into_iter().flat_map(|(view, matches)| {
                let numbers: Vec<_> = matches
                    .into_iter()
                    .map(|(index, other)| (merged.number(all[view], index), other))
                    .collect();
                numbers
            });
            found.push(one_to_one(numbered));
        }
        let image = merged.into_image();
        let tried = neighbours
            .par_iter()
            .zip(&found)
            .map(|(&other, found)| self.verified(&image, other, found));
        let pairs: Vec<TriedPair> = tried
            .filter(|pair| agreeing(pair) > self.agreed(pair.images))
            .collect();
        Ok(pairs
            .iter()
            .any(|pair| agreeing(pair) >= enough)
            .then_some(Gained { image, pairs }))
    }

    /// Returns images of the model, ascending.
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
        let mut neighbours: Vec<usize> = ranked
            .into_iter()
            .map(|(_, other)| other as usize)
            .collect();
        neighbours.sort_unstable();
        neighbours
    }

    /// Returns the matches of each view by neighbour.
    ///
    /// Nearest neighbours are used whatever the chosen matcher, because there are many views.
    fn matches(
        &self,
        views: &[&ImageFeatures],
        neighbours: &[usize],
        progress: &Progress,
    ) -> Result<Vec<Vec<OfView>>, SfmError> {
        let others = neighbours.iter().map(|&other| &self.attempt.images[other]);
        let set: Vec<&Features> = views
            .iter()
            .copied()
            .chain(others)
            .map(|image| &image.features)
            .collect();
        let matcher = match set[0].descriptors.as_bytes() {
            Some(_) => NearestMatcher::for_bytes(),
            None => NearestMatcher::for_floats(),
        };
        let matcher = matcher.of_set(&set)?;
        let of_neighbour = |other: usize| {
            let of_view = |view: usize| {
                progress.check()?;
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

#[cfg(test)]
mod tests;
