use std::collections::BTreeMap;

use super::look_again::{Gained, LookAgain};
use crate::sfm::account::FEW_FEATURES;
use crate::sfm::extract::tilted_picture;
use crate::sfm::pipeline::SfmRequest;
use crate::sfm::{MapProblem, Mapped, PictureFeatures, SfmError, TriedPair, map};
use ostra_core::job::Progress;
use ostra_frames::FrameStore;

/// Pictures that get a second chance at most, those first that have most matches with one other.
const MOST: usize = 8;

/// What the mapper was given, and what it made of it.
pub(crate) struct Attempt {
    /// What was mapped.
    pub problem: MapProblem,
    /// Features by image.
    pub pictures: Vec<PictureFeatures>,
    /// All pairs that were matched.
    pub tried: Vec<TriedPair>,
    /// The models, the one kept first.
    pub models: Vec<Mapped>,
}

/// Looks for more matches of pictures that no model holds, and maps again where there are any: taken at a grazing angle,
/// a picture shows what others show so foreshortened that its features are not recognised, until it is tilted back.
/// Gives the first attempt back where that places no more pictures, and when stopped.
///
/// # Errors
/// [`SfmError`] where the extractor or the matcher fails.
pub(crate) fn second_chance(
    mut first: Attempt,
    request: &SfmRequest<'_>,
    store: &FrameStore,
    progress: &Progress,
) -> Result<Attempt, SfmError> {
    let gained = match look_again(&first, request, store, progress) {
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
        first.pictures[image] = found.picture;
    }
    Ok(Attempt {
        problem,
        tried,
        models,
        ..first
    })
}

/// By image that was left out, more matches, where they were found.
fn look_again(
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
    progress.stage("look again at what was left out")?;
    for (done, &image) in images.iter().enumerate() {
        progress.step(done, images.len())?;
        let (frame, allowed) = (
            request.mapped[image],
            (request.allowed)(request.mapped[image]),
        );
        let views = tilted_picture(
            &request.frames[frame],
            store,
            request.extractor,
            allowed.as_deref(),
            progress,
        )?;
        let look = LookAgain {
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

/// Images that no model holds although there is something to recognise in them.
fn left_out(attempt: &Attempt) -> Vec<usize> {
    let is_placed = |image: usize| {
        attempt
            .models
            .iter()
            .any(|mapped| mapped.model.is_placed(image as u32))
    };
    let is_rich = |image: usize| attempt.pictures[image].features.keypoints.len() >= FEW_FEATURES;
    let mut images: Vec<usize> = (0..attempt.pictures.len())
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

/// The problem and its pairs with what was gained.
fn with_gains(first: &Attempt, gained: &BTreeMap<usize, Gained>) -> (MapProblem, Vec<TriedPair>) {
    let (mut problem, mut tried) = (first.problem.clone(), first.tried.clone());
    for (&image, found) in gained {
        problem.images[image]
            .keypoints
            .clone_from(&found.picture.features.keypoints);
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

/// Images of the model that is kept.
fn placed(models: &[Mapped]) -> usize {
    models.first().map_or(0, |kept| kept.model.placed().count())
}
