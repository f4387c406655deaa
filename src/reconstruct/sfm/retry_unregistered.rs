//! Second attempt at images that no model contains: they are matched with the images that see the
//! same place, then under simulated tilts, and placed in the standing model.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::asift::{Merged, one_to_one};
use super::matching::NearestMatcher;
use super::nearby_pairs::nearby_pairs;
use super::pairs::{MatchedImage, match_pairs, verify};
use super::registration_report::FEW_FEATURES;
use super::request::SfmRequest;
use super::{
    CachedExtractor, CachedMatcher, FeatureMatcher, Features, ImageFeatures, MapCamera, MapProblem,
    Mapped, MatchedImages, SfmError, SparseModel, TriedPair, extend,
};
use ostra_core::job::{PlannedStage, Progress};
use ostra_frames::FrameStore;

/// Maximum number of images matched under tilts; those with most matches with one other come first.
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

/// Searches for more matches of images that no model contains, and places these images in the
/// standing model.
///
/// First come matches with images that see the same place, then those under simulated tilts: an
/// image taken at a grazing angle shows its content so foreshortened that its features are not
/// recognised until the tilt is simulated away. If every image was placed, nothing of this runs.
///
/// When stopped, returns what was reached before.
///
/// # Errors
/// [`SfmError`] if the extractor or the matcher fails.
pub(super) fn retry_unregistered(
    mut attempt: Attempt,
    request: &SfmRequest<'_>,
    store: &FrameStore,
    progress: &Progress,
) -> Result<Attempt, SfmError> {
    if attempt.models.is_empty() || left_out(&attempt).is_empty() {
        return Ok(attempt);
    }
    request
        .frame_extractor(store)
        .restore_descriptors(&mut attempt.images, request.mapped)?;
    for search in [nearby, under_tilts] {
        let found = search(&attempt, request, store, progress)
            .and_then(|gains| extended(&attempt, gains, request, progress));
        match found {
            Ok(Some(extended)) => attempt.take(extended),
            Ok(None) => {}
            Err(SfmError::Stopped(_)) => break,
            Err(error) => return Err(error),
        }
    }
    Ok(attempt)
}

/// A model with more images, and the matches that led to them.
struct Extended {
    model: Mapped,
    problem: MapProblem,
    gains: Gains,
}

/// Additional matches of images that were left out.
#[derive(Default)]
struct Gains {
    /// Features of images that have more of them now, the known ones first.
    images: BTreeMap<usize, ImageFeatures>,
    /// Pairs that are new, or for which more matches agree than before.
    pairs: Vec<TriedPair>,
}

impl Attempt {
    /// Returns all matched pairs, with the additional ones.
    fn tried_with(&self, gains: &Gains) -> Vec<TriedPair> {
        let mut tried = self.tried.clone();
        for pair in &gains.pairs {
            match tried.iter_mut().find(|known| known.images == pair.images) {
                Some(known) => known.clone_from(pair),
                None => tried.push(pair.clone()),
            }
        }
        tried
    }

    /// Returns the problem, extended by the additional matches.
    fn problem_with(&self, gains: &Gains) -> MapProblem {
        let mut problem = self.problem.clone();
        for (&image, found) in &gains.images {
            problem.images[image]
                .keypoints
                .clone_from(&found.features.keypoints);
        }
        let tried = self.tried_with(gains);
        problem.pairs = tried.into_iter().filter_map(|pair| pair.verified).collect();
        problem
    }

    /// Takes over a model with more images.
    fn take(&mut self, extended: Extended) {
        self.tried = self.tried_with(&extended.gains);
        self.problem = extended.problem;
        self.images_take(extended.gains.images);
        self.models[0] = extended.model;
    }

    fn images_take(&mut self, images: BTreeMap<usize, ImageFeatures>) {
        for (image, found) in images {
            self.images[image] = found;
        }
    }
}

/// Returns the first model with more images, if the additional matches lead to any.
fn extended(
    attempt: &Attempt,
    gains: Gains,
    request: &SfmRequest<'_>,
    progress: &Progress,
) -> Result<Option<Extended>, SfmError> {
    if gains.pairs.iter().all(|pair| pair.verified.is_none()) {
        return Ok(None);
    }
    progress.stage("place unregistered images")?;
    let before = placed(&attempt.models);
    let problem = attempt.problem_with(&gains);
    let model = extend(&problem, &attempt.models, &request.mapper, progress)?;
    let grown = model.filter(|mapped| mapped.model.placed().count() > before);
    Ok(grown.map(|model| Extended {
        model,
        problem,
        gains,
    }))
}

/// Announces the stages of one search.
fn announce(progress: &Progress, name: &'static str, step: &'static str, seconds: f64) {
    progress.plan_next(&[
        PlannedStage::new(name, step, seconds),
        PlannedStage::new(
            "place unregistered images",
            "Place left-over images",
            0.2 * seconds,
        ),
    ]);
}

/// Matches images that were left out with those that see the same place, and were not matched yet.
fn nearby(
    attempt: &Attempt,
    request: &SfmRequest<'_>,
    _: &FrameStore,
    progress: &Progress,
) -> Result<Gains, SfmError> {
    let (Some(kept), images) = (attempt.models.first(), left_out(attempt)) else {
        return Ok(Gains::default());
    };
    let features: Vec<&Features> = attempt.images.iter().map(|image| &image.features).collect();
    let seed = request.pairs.seed;
    let pairs = nearby_pairs(&images, &features, &kept.model, &attempt.tried, seed);
    if pairs.is_empty() {
        return Ok(Gains::default());
    }
    let name = "match unregistered images";
    announce(
        progress,
        name,
        "Match left-over images",
        0.06 * pairs.len() as f64,
    );
    progress.stage(name)?;
    let cameras: Vec<MapCamera> = attempt
        .problem
        .images
        .iter()
        .map(|image| attempt.problem.cameras[image.camera])
        .collect();
    let matched = MatchedImages {
        features: &features,
        cameras: &cameras,
        cache: request.cache(),
    };
    let seed = request.mapper.seed;
    Ok(Gains {
        images: BTreeMap::new(),
        pairs: match_pairs(matched, &pairs, request.matcher, seed, progress)?,
    })
}

/// Matches images that were left out under simulated tilts.
fn under_tilts(
    attempt: &Attempt,
    request: &SfmRequest<'_>,
    store: &FrameStore,
    progress: &Progress,
) -> Result<Gains, SfmError> {
    let mut gains = Gains::default();
    let Some(kept) = attempt.models.first() else {
        return Ok(gains);
    };
    let mut images = left_out(attempt);
    images.truncate(MOST);
    if images.is_empty() {
        return Ok(gains);
    }
    let (name, count) = ("match unregistered images again", images.len());
    announce(
        progress,
        name,
        "Match left-over images again",
        2.0 * count as f64,
    );
    progress.stage(name)?;
    for (done, &image) in images.iter().enumerate() {
        progress.step(done, count)?;
        let frame = request.mapped[image];
        let views = request.frame_extractor(store).tilted(frame, progress)?;
        let look = Retry {
            attempt,
            model: &kept.model,
            image,
            seed: request.mapper.seed,
            cached: request.cached,
        };
        if let Some(found) = look.gains(&views, request.mapper.pose_inliers, progress)? {
            gains.images.insert(image, found.image);
            gains.pairs.extend(found.pairs);
        }
    }
    Ok(gains)
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
    images
}

/// Returns how many images the kept model contains.
fn placed(models: &[Mapped]) -> usize {
    models.first().map_or(0, |kept| kept.model.placed().count())
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
    pub cached: Option<&'a CachedExtractor<'a>>,
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
        let mut merged = Merged::new(own);
        let mut pairs: Vec<TriedPair> = Vec::new();
        for neighbours in self.neighbours().chunks(TOGETHER) {
            let mut found = Vec::with_capacity(neighbours.len());
            for by_view in self.matches(&all, neighbours, progress)? {
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
            let good = pairs.iter().filter(|pair| agreeing(pair) >= enough);
            if good.count() >= SUFFICIENT {
                break;
            }
        }
        let image = merged.into_image();
        Ok(pairs
            .iter()
            .any(|pair| agreeing(pair) >= enough)
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
        progress: &Progress,
    ) -> Result<Vec<Vec<OfView>>, SfmError> {
        let others = neighbours.iter().map(|&other| &self.attempt.images[other]);
        let set: Vec<&Features> = views
            .iter()
            .copied()
            .chain(others)
            .map(|image| &image.features)
            .collect();
        let nearest = match set[0].descriptors.as_bytes() {
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

#[cfg(test)]
mod tests;
