use std::collections::BTreeMap;

use super::extract::ImageFeatures;
use super::locate::{Located, Locator, SeenPoint};
use super::pair_selection::match_images;
use super::registration_report::{RegistrationReport, RegistrationStatus, why_no_start};
use super::request::{SfmRequest, error_px, frame_cameras, sparse_points};
use super::retry_unregistered::{Attempt, retry_unregistered};
use super::sequences::sequences;
use super::{
    CameraGroups, Features, KeypointId, MapImage, MapProblem, Mapped, MatchedImages, PairOptions,
    SfmError, SfmResult, SparseModel, TriedPair, map, metric_scale,
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
    let images = request
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
    progress.stage("map")?;
    let models = map(&problem, &request.mapper, progress)?;
    let first = Attempt {
        problem,
        images,
        tried,
        models,
    };
    let Attempt {
        problem,
        images,
        tried,
        models,
    } = retry_unregistered(first, request, store, progress)?;
    let Some(kept) = models.first() else {
        progress.check()?;
        let names: Vec<&str> = chosen.iter().map(|frame| frame.name.as_str()).collect();
        return Err(SfmError::NoStart(why_no_start(
            &names,
            &found(&images),
            &tried,
        )));
    };
    let mut result = SfmResult {
        cameras: frame_cameras(&problem, &kept.model, request.mapped),
        sparse: sparse_points(&problem, &kept.model, &images, request.mapped),
        outcomes: registration_statuses(request, &problem, &images, &tried, &models),
        start: kept.start,
        models: models
            .iter()
            .map(|mapped| mapped.model.placed().count())
            .collect(),
        scale: None,
        contradiction: kept.contradiction,
        warnings: contradicted(kept).into_iter().collect(),
        methods: [request.extractor.name(), request.matcher.name()],
        stopped: kept.stopped,
    };
    let locator = Locator {
        request,
        problem: &problem,
        model: &kept.model,
        images: &images,
    };
    match finish(&locator, store, &mut result, progress) {
        // A partial result is scaled all the same: its scale could not be determined later.
        Err(SfmError::Stopped(_)) => {
            scale_to_metres(request, store, &mut result, &Progress::default())?;
        }
        finished => finished?,
    }
    result.stopped |= progress.check().is_err();
    Ok(result)
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

fn finish(
    locator: &Locator<'_>,
    store: &FrameStore,
    result: &mut SfmResult,
    progress: &Progress,
) -> Result<(), SfmError> {
    let open = locator
        .request
        .located
        .iter()
        .map(|&number| (number, RegistrationStatus::NotReached));
    result.outcomes.extend(open);
    locate_rest(locator, store, result, progress)?;
    scale_to_metres(locator.request, store, result, progress)
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

fn registration_statuses(
    request: &SfmRequest<'_>,
    problem: &MapProblem,
    images: &[ImageFeatures],
    tried: &[TriedPair],
    models: &[Mapped],
) -> BTreeMap<usize, RegistrationStatus> {
    let placed = |image: usize| residual(problem, &models.first()?.model, image);
    let report = RegistrationReport {
        frame_of: request.mapped,
        tried,
        models,
        options: &request.mapper,
    };
    let outcomes = report.outcomes(&found(images), &placed);
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

fn locate_rest(
    locator: &Locator<'_>,
    store: &FrameStore,
    result: &mut SfmResult,
    progress: &Progress,
) -> Result<(), SfmError> {
    let (frames, located) = (locator.request.frames, locator.request.located);
    if located.is_empty() {
        return Ok(());
    }
    progress.stage("place the frames between")?;
    // Numbers in the result by numbers in the model, where points have been removed.
    let points = locator.model.points().map(|(point, _)| point);
    let numbers: BTreeMap<u32, u32> = points.zip(0..).collect();
    for (done, &number) in located.iter().enumerate() {
        progress.step(done, located.len())?;
        let ahead: Vec<Frame> = located[done + 1..]
            .iter()
            .take(2)
            .map(|&next| frames[next].clone())
            .collect();
        store.prefetch(&ahead);
        let Located {
            camera,
            outcome,
            seen,
        } = locator.locate(number, store)?;
        result.cameras.extend(camera.map(|camera| (number, camera)));
        result.outcomes.insert(number, outcome);
        if !seen.is_empty() {
            let keypoint = |seen: SeenPoint| SparseKeypoint {
                at_px: seen.at_px,
                point: numbers.get(&seen.point).copied(),
            };
            let keypoints = seen.into_iter().map(keypoint).collect();
            result.sparse.keypoints.insert(number, keypoints);
        }
    }
    Ok(())
}

/// Scales the model to the unit of the depth maps, unless given poses fix the unit.
fn scale_to_metres(
    request: &SfmRequest<'_>,
    store: &FrameStore,
    result: &mut SfmResult,
    progress: &Progress,
) -> Result<(), SfmError> {
    let has_unit = request.keep_poses && result.start == super::ModelStart::Given;
    if has_unit || !request.frames.iter().any(Frame::has_sensor_depth) {
        return Ok(());
    }
    progress.stage("scale")?;
    let (scale, warning) = metric_scale(
        request.frames,
        &result.cameras,
        &result.sparse,
        store,
        progress,
    )?;
    result.warnings.extend(warning);
    result.scale = scale;
    if let Some(scale) = result.scale {
        result.scale_by(scale.factor);
    }
    Ok(())
}
