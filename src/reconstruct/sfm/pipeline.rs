use std::collections::BTreeMap;

use super::extract::ImageFeatures;
use super::locate::{Located, Locator, SeenPoint};
use super::pair_selection::match_images;
use super::registration_report::{RegistrationReport, RegistrationStatus, why_no_start};
use super::request::{SfmModel, SfmRequest, error_px, frame_cameras, sparse_points};
use super::retry_unregistered::{Attempt, retry_unregistered};
use super::sequences::sequences;
use super::{
    CameraGroups, Features, KeypointId, MapImage, MapProblem, Mapped, MatchedImages, ModelStart,
    PairOptions, SfmError, SfmResult, SparseModel, TriedPair, join_models, map, metric_scale,
};
use ostra_core::job::{PlannedStage, Progress};
use ostra_core::statistics::upper_median;
use ostra_frames::cameras::SparseKeypoint;
use ostra_frames::{Frame, FrameStore};

/// Returns the stages of [`structure_from_motion`] for so many images in the model and between.
///
/// Weights are rough seconds on a desktop processor. The pace of the machine, and the time of other
/// engines, are measured while the stages run.
#[must_use]
pub fn planned_stages(mapped: usize, located: usize, has_depth: bool) -> Vec<PlannedStage> {
    let stage = PlannedStage::new;
    let pairs = PairOptions::default().expected_pairs(mapped);
    let (images, located, pairs) = (mapped as f64, located as f64, pairs as f64);
    let mut stages = vec![
        stage("find features", "Find features", images),
        stage("match", "Match images", 0.06 * pairs),
        stage("map", "Compute cameras", 0.4 * images),
    ];
    if located > 0.0 {
        stages.push(stage(
            "place the frames between",
            "Place the frames between",
            1.2 * located,
        ));
    }
    if has_depth {
        stages.push(stage("scale", "Compute cameras", 0.1 * images));
    }
    stages
}

/// Estimates cameras and sparse points from images.
///
/// The steps are features, matches and incremental mapping. Frames between the mapped ones are then
/// located in the map. The scale is taken from depth if there is any and no pose was given. When
/// stopped during mapping or later, it returns what it has by then.
///
/// # Errors
/// [`SfmError::NoStart`] with the reason if nothing can be placed; other [`SfmError`]s if the
/// extractor or the matcher fails, or the run is stopped before anything was placed.
pub fn structure_from_motion(
    request: &SfmRequest<'_>,
    store: &FrameStore,
    progress: &Progress,
) -> Result<SfmResult, SfmError> {
    progress.stage("find features")?;
    let frames = request.frames;
    let mut images = request
        .frame_extractor(store)
        .of_frames(request.mapped, progress)?;
    progress.stage("match")?;
    let chosen: Vec<&Frame> = request
        .mapped
        .iter()
        .map(|&number| &frames[number])
        .collect();
    let groups = CameraGroups::new(&chosen);
    let (problem, tried) = problem(request, &chosen, &groups, &images, progress)?;
    release(&mut images, request);
    progress.stage("map")?;
    let models = map(&problem, &request.mapper, progress)?;
    let models = join_models(&problem, models, &request.mapper, progress);
    let first = Attempt {
        problem,
        images,
        tried,
        models,
    };
    let mut attempt = retry_unregistered(first, request, store, progress)?;
    attempt.models = join_models(&attempt.problem, attempt.models, &request.mapper, progress);
    let Some(kept) = attempt.models.first() else {
        progress.check()?;
        let names: Vec<&str> = chosen.iter().map(|frame| frame.name.as_str()).collect();
        return Err(SfmError::NoStart(why_no_start(
            &names,
            &found(&attempt.images),
            &attempt.tried,
        )));
    };
    let (start, contradiction, stopped) = (kept.start, kept.contradiction, kept.stopped);
    drop_small(&mut attempt.models);
    let mut models: Vec<SfmModel> = (0..attempt.models.len())
        .map(|index| sfm_model(request, &attempt, index))
        .collect();
    if !request.located.is_empty() {
        request
            .frame_extractor(store)
            .restore_descriptors(&mut attempt.images, request.mapped)?;
    }
    match finish(request, &attempt, store, &mut models, progress) {
        // A partial result is scaled all the same: its scale could not be determined later.
        Err(SfmError::Stopped(_)) => {
            scale_to_metres(request, &attempt, store, &mut models, &Progress::default())?;
        }
        finished => finished?,
    }
    let kept = models.remove(0);
    Ok(SfmResult {
        cameras: kept.cameras,
        sparse: kept.sparse,
        outcomes: kept.outcomes,
        start,
        others: models,
        scale: kept.scale,
        contradiction,
        warnings: kept.warnings,
        methods: [request.extractor.name(), request.matcher.name()],
        stopped: stopped || progress.check().is_err(),
    })
}

/// Models besides the first one are returned if they have at least this many images.
const LEAST_OTHER_IMAGES: usize = 3;

/// Removes models with too few images to be of use, but never the first one.
fn drop_small(models: &mut Vec<Mapped>) {
    let mut is_first = true;
    models.retain(|mapped| {
        std::mem::take(&mut is_first) || mapped.model.placed().count() >= LEAST_OTHER_IMAGES
    });
}

/// Returns a model with its cameras and points by frame.
fn sfm_model(request: &SfmRequest<'_>, attempt: &Attempt, index: usize) -> SfmModel {
    let Attempt {
        problem, images, ..
    } = attempt;
    let mapped = &attempt.models[index];
    SfmModel {
        cameras: frame_cameras(problem, &mapped.model, request.mapped),
        sparse: sparse_points(problem, &mapped.model, images, request.mapped),
        outcomes: registration_statuses(request, attempt, index),
        scale: None,
        warnings: contradicted(mapped).into_iter().collect(),
    }
}

/// Contradiction above which cameras may be wrong.
///
/// Cameras of eight sets that are right as far as is known had 0.003–0.082, wrong ones of a shelf 0.20.
pub const CONTRADICTORY: f64 = 0.15;

/// Returns a warning if the matches contradict the cameras.
fn contradicted(mapped: &Mapped) -> Option<String> {
    (mapped.contradiction > CONTRADICTORY).then(|| {
        format!(
            "the cameras may be wrong, as the matches between the images contradict them \
             ({:.2}; usually below 0.1): compare the sparse points with the images; take images \
             with more overlap from more viewpoints, or give the cameras",
            mapped.contradiction
        )
    })
}

/// Frees what the mapper does not need and the cache has.
fn release(images: &mut [ImageFeatures], request: &SfmRequest<'_>) {
    images
        .iter_mut()
        .for_each(ImageFeatures::release_descriptors);
    if let Some(cache) = request.cache() {
        cache.release_entries();
    }
}

fn finish(
    request: &SfmRequest<'_>,
    attempt: &Attempt,
    store: &FrameStore,
    models: &mut [SfmModel],
    progress: &Progress,
) -> Result<(), SfmError> {
    for model in &mut *models {
        let open = request
            .located
            .iter()
            .map(|&number| (number, RegistrationStatus::NotReached));
        model.outcomes.extend(open);
    }
    locate_rest(request, attempt, store, models, progress)?;
    scale_to_metres(request, attempt, store, models, progress)
}

fn problem(
    request: &SfmRequest<'_>,
    chosen: &[&Frame],
    groups: &CameraGroups,
    images: &[ImageFeatures],
    progress: &Progress,
) -> Result<(MapProblem, Vec<TriedPair>), SfmError> {
    let features: Vec<&Features> = images.iter().map(|image| &image.features).collect();
    let cameras: Vec<_> = groups
        .camera_of
        .iter()
        .map(|&camera| groups.cameras[camera])
        .collect();
    let matched = MatchedImages {
        features: &features,
        cameras: &cameras,
        cache: request.cache(),
    };
    let tried = match_images(
        matched,
        &sequences(chosen),
        &request.pairs,
        request.matcher,
        request.mapper.seed,
        progress,
    )?;
    let images =
        chosen
            .iter()
            .zip(images)
            .zip(&groups.camera_of)
            .map(|((frame, image), &camera)| MapImage {
                camera,
                keypoints: image.features.keypoints.clone(),
                given: frame
                    .posed_camera()
                    .filter(|_| request.keep_poses)
                    .map(|(_, pose)| *pose),
            });
    let pairs = tried
        .iter()
        .filter_map(|pair| pair.verified.clone())
        .collect();
    Ok((
        MapProblem {
            cameras: groups.cameras.clone(),
            images: images.collect(),
            pairs,
        },
        tried,
    ))
}

/// Returns the status of each frame for the cameras of one of the models.
fn registration_statuses(
    request: &SfmRequest<'_>,
    attempt: &Attempt,
    kept: usize,
) -> BTreeMap<usize, RegistrationStatus> {
    let placed = |image: usize| residual(&attempt.problem, &attempt.models[kept].model, image);
    let report = RegistrationReport {
        frame_of: request.mapped,
        tried: &attempt.tried,
        models: &attempt.models,
        kept,
        options: &request.mapper,
    };
    let outcomes = report.outcomes(&found(&attempt.images), &placed);
    request.mapped.iter().copied().zip(outcomes).collect()
}

/// Returns the number of features of each image, or why it cannot be read.
fn found(images: &[ImageFeatures]) -> Vec<Result<usize, String>> {
    let one = |image: &ImageFeatures| {
        image
            .unreadable
            .clone()
            .map_or(Ok(image.features.keypoints.len()), Err)
    };
    images.iter().map(one).collect()
}

/// Returns how many points an image sees and the median of their reprojection errors in pixels;
/// `None` if it is not placed.
fn residual(problem: &MapProblem, model: &SparseModel, image: usize) -> Option<(usize, f64)> {
    model.poses[image]?;
    let keypoints = (0..problem.images[image].keypoints.len() as u32).map(|index| KeypointId {
        image: image as u32,
        index,
    });
    let mut errors: Vec<f64> = keypoints
        .filter_map(|keypoint| {
            let point = model.point(model.point_of(keypoint)?)?;
            Some(error_px(problem, model, keypoint, point.position))
        })
        .collect();
    Some((errors.len(), upper_median(&mut errors).unwrap_or(0.0)))
}

/// Locates the frames between the mapped ones, each in the first model in which that succeeds.
fn locate_rest(
    request: &SfmRequest<'_>,
    attempt: &Attempt,
    store: &FrameStore,
    models: &mut [SfmModel],
    progress: &Progress,
) -> Result<(), SfmError> {
    let (frames, located) = (request.frames, request.located);
    if located.is_empty() {
        return Ok(());
    }
    progress.stage("place the frames between")?;
    for (done, &number) in located.iter().enumerate() {
        progress.step(done, located.len())?;
        let ahead: Vec<Frame> = located[done + 1..]
            .iter()
            .take(2)
            .map(|&next| frames[next].clone())
            .collect();
        store.prefetch(&ahead);
        for (index, mapped) in attempt.models.iter().enumerate() {
            let locator = Locator {
                request,
                problem: &attempt.problem,
                model: &mapped.model,
                images: &attempt.images,
            };
            let found = locator.locate(number, store)?;
            if found.camera.is_some() {
                note_other_model(models, number, index, mapped);
                models[index].take_located(number, found, &mapped.model);
                break;
            }
            models[index].outcomes.insert(number, found.outcome);
        }
    }
    Ok(())
}

/// Notes in all models that a frame belongs to the one with this index.
fn note_other_model(models: &mut [SfmModel], frame: usize, index: usize, mapped: &Mapped) {
    for model in models {
        let status = RegistrationStatus::OtherModel {
            model: index + 1,
            images: mapped.model.placed().count(),
        };
        model.outcomes.insert(frame, status);
    }
}

impl SfmModel {
    /// Takes over a frame that was located in the model.
    fn take_located(&mut self, frame: usize, located: Located, model: &SparseModel) {
        let Located {
            camera,
            outcome,
            seen,
        } = located;
        self.cameras.extend(camera.map(|camera| (frame, camera)));
        self.outcomes.insert(frame, outcome);
        if seen.is_empty() {
            return;
        }
        // Numbers in the result by numbers in the model, where points have been removed.
        let points = model.points().map(|(point, _)| point);
        let numbers: BTreeMap<u32, u32> = points.zip(0..).collect();
        let keypoint = |seen: SeenPoint| SparseKeypoint {
            at_px: seen.at_px,
            point: numbers.get(&seen.point).copied(),
        };
        let keypoints = seen.into_iter().map(keypoint).collect();
        self.sparse.keypoints.insert(frame, keypoints);
    }
}

/// Scales the models to the unit of the depth maps, except one whose unit given poses fix.
fn scale_to_metres(
    request: &SfmRequest<'_>,
    attempt: &Attempt,
    store: &FrameStore,
    models: &mut [SfmModel],
    progress: &Progress,
) -> Result<(), SfmError> {
    if !request.frames.iter().any(Frame::has_sensor_depth) {
        return Ok(());
    }
    let has_unit =
        |mapped: &Mapped| request.keep_poses && matches!(mapped.start, ModelStart::Given);
    // When stopped, this is called again for the models that were not reached.
    let unscaled = models
        .iter_mut()
        .zip(&attempt.models)
        .filter(|(model, mapped)| model.scale.is_none() && !has_unit(mapped));
    for (step, (model, _)) in unscaled.enumerate() {
        if step == 0 {
            progress.stage("scale")?;
        }
        let (scale, warning) = metric_scale(
            request.frames,
            &model.cameras,
            &model.sparse,
            store,
            progress,
        )?;
        let warning = warning.filter(|text| !model.warnings.contains(text));
        model.warnings.extend(warning);
        model.scale = scale;
        if let Some(scale) = scale {
            model.scale_by(scale.factor);
        }
    }
    Ok(())
}
