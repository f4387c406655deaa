//! The searches, from what is found first to what takes longest.

use std::collections::BTreeMap;

use super::attempt::{Attempt, Extended, Gains, begin, left_out, placed};
use super::tilted::{under_all_tilts, under_promising_tilts};
use crate::sfm::nearby_pairs::nearby_pairs;
use crate::sfm::pairs::match_pairs;
use crate::sfm::{Features, MapCamera, MatchedImages, SfmError, SfmRequest, extend};
use ostra_core::job::{PlannedStage, Progress};
use ostra_frames::FrameStore;

/// Searches for more matches of images that no model contains, and places these images in the
/// standing model.
///
/// First come matches with images that see the same place, then those under simulated tilts: an
/// image taken at a grazing angle shows its content so foreshortened that its features are not
/// recognised until the tilt is simulated away. All tilts are tried only for images that agree with
/// others under the promising ones and still cannot be placed. If every image was placed, nothing of
/// this runs.
///
/// When stopped, returns what was reached before.
///
/// # Errors
/// [`SfmError`] if the extractor or the matcher fails.
pub(in crate::sfm) fn retry_unregistered(
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
    match search(&mut attempt, request, store, progress) {
        Ok(()) | Err(SfmError::Stopped(_)) => Ok(attempt),
        Err(error) => Err(error),
    }
}

/// Runs one search after the other, and takes over what each one places.
fn search(
    attempt: &mut Attempt,
    request: &SfmRequest<'_>,
    store: &FrameStore,
    progress: &Progress,
) -> Result<(), SfmError> {
    let place = |attempt: &mut Attempt, gains| {
        if let Some(extended) = extended(attempt, gains, request, progress)? {
            attempt.take(extended);
        }
        Ok::<_, SfmError>(())
    };
    let gains = nearby(attempt, request, progress)?;
    place(attempt, gains)?;
    let gains = under_promising_tilts(attempt, request, store, progress)?;
    let agreeing: Vec<usize> = gains.images.keys().copied().collect();
    place(attempt, gains)?;
    let mut images = left_out(attempt);
    images.retain(|image| agreeing.contains(image));
    let gains = under_all_tilts(attempt, &images, request, store, progress)?;
    place(attempt, gains)
}

/// Returns the first model with more images, if the additional matches lead to any.
pub(super) fn extended(
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

/// Matches images that were left out with those that see the same place, and were not matched yet.
fn nearby(
    attempt: &Attempt,
    request: &SfmRequest<'_>,
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
    let search = PlannedStage::new(
        "match unregistered images",
        "Match left-over images",
        0.06 * pairs.len() as f64,
    );
    begin(progress, search)?;
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
