//! Second attempt at images that no model contains: they are matched with the images that see the
//! same place, then under simulated tilts, and placed in the standing model.

mod tilted;

use std::collections::BTreeMap;

use super::nearby_pairs::nearby_pairs;
use super::pairs::match_pairs;
use super::registration_report::FEW_FEATURES;
use super::request::SfmRequest;
use super::{
    Features, ImageFeatures, MapCamera, MapProblem, Mapped, MatchedImages, SfmError, TriedPair,
    extend,
};
use ostra_core::job::{PlannedStage, Progress};
use ostra_frames::FrameStore;
use tilted::{under_all_tilts, under_promising_tilts};

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
/// recognised until the tilt is simulated away. All tilts are tried only for images that the
/// promising ones do not place. If every image was placed, nothing of this runs.
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
    for search in [nearby, under_promising_tilts, under_all_tilts] {
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

#[cfg(test)]
mod tests;
