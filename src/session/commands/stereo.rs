use ostra_project::{DeviceId, FeatureId, MatcherId, ResultEngine};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use anyhow::{Result, ensure};
use sha2::{Digest, Sha256};

use super::found_cameras::left_out;
use crate::Session;
use crate::engines::{identity, matcher};
use crate::jobs::JobContext;
use crate::live_preview::WatchedDepths;
use ostra_cloud::fuse::naming;
use ostra_compute::gpu::{Device, GpuError, Software};
use ostra_core::job::Progress;
use ostra_frames::cameras::{ModelEncoding, SparsePoints, read_sparse_model, write_colmap_model};
use ostra_frames::{DepthSource, Frame, FrameStore};
use ostra_geometry::Camera;
use ostra_masks::LabelId;
use ostra_project::store::{
    DepthFolder, DepthRunRecord, depth_map_path, depth_versions, feature_cache_path, load_sparse,
};
use ostra_project::{Edit, Project, ReconstructRequest, ResultKind, ResultRecord, StepSeconds};
use ostra_reconstruct::sfm::{
    CachedExtractor, CachedMatcher, FeatureCache, FeatureExtractor, Sift, undistort_mask,
};
use ostra_reconstruct::stereo::{
    DepthStore, SparseOptions, SparseRequest, StereoEngine, StereoError, StereoOptions,
    StereoRequest, ViewOutcome, estimate_depths, sparse_from_cameras,
};

/// Inputs of stereo.
pub(super) struct StereoWork {
    pub project: Arc<Project>,
    pub root: std::path::PathBuf,
    pub store: Arc<FrameStore>,
    pub request: ReconstructRequest,
    /// Number of a new folder, used if no earlier run can be resumed.
    pub version: u64,
}

/// Makes depth maps by stereo for the chosen frames.
///
/// If the run is stopped or killed, its results so far stay on disk, and a run with the same inputs
/// resumes from them. The previous depths are kept until the run has finished.
///
/// # Errors
///
/// Returns an error if no frame can get depth, a result cannot be saved, or the run was stopped.
pub(super) fn make_depths(work: StereoWork, context: &JobContext<Session>) -> Result<()> {
    let (begun, stages_before) = (Instant::now(), context.progress.stages_begun());
    let StereoWork {
        project,
        root,
        store,
        request,
        version,
    } = work;
    let views = chosen(&project.frames, &request)?;
    let options = depth_options(&request);
    let key = key(&project, &views, &options, &request)?;
    let version = unfinished(&root, &project, &key).unwrap_or(version);
    let folder = DepthFolder::new(&root, version, &project.frames);
    let mut account = DepthRunRecord {
        key,
        max_side: options.max_side,
        outcomes: None,
    };
    folder.save_account(&account)?;
    let run = StereoRun {
        project: &project,
        root: &root,
        store: &store,
        request: &request,
        options: &options,
        views: &views,
        folder: &folder,
        warnings: Mutex::default(),
    };
    let frames = &project.frames;
    let shown = WatchedDepths {
        depths: &folder,
        frames,
        images: &store,
        max_side: options.max_side,
        sink: context,
    };
    let estimate = |engine: &StereoEngine| estimate(&run, &shown, engine, &context.progress);
    let mut of_device = Vec::new();
    let (engine, outcomes) = on_device(request.device, &mut of_device, estimate)?;
    let mut warnings = views_without_depth(&project.frames, &outcomes);
    warnings.extend(of_device);
    warnings.append(&mut lock(&run.warnings));
    account.outcomes = Some(outcomes);
    folder.save_account(&account)?;
    folder.finish();
    let made: Vec<bool> = (0..project.frames.len())
        .map(|frame| folder.is_complete(frame))
        .collect();
    let record = ResultRecord {
        engine: ResultEngine::Stereo,
        frames: made.iter().filter(|&&made| made).count(),
        seconds: begun.elapsed().as_secs_f64(),
        steps: StepSeconds::of(&context.progress, stages_before),
        stale: false,
        settings: settings(&views, &made, &options, &engine),
        version,
        ..ResultRecord::default()
    };
    ensure!(
        record.frames > 0,
        "no frame got depth: {}",
        warnings.first().map_or("", String::as_str)
    );
    Ok(context.send(move |session: &mut Session| {
        session.take_depths(&project, &made, record, warnings)
    })?)
}

impl Session {
    fn take_depths(
        &mut self,
        made_from: &Project,
        made: &[bool],
        mut record: ResultRecord,
        warnings: Vec<String>,
    ) -> Result<()> {
        record.stale = made_from.frames != self.snapshot()?.frames;
        let version = record.version;
        let mut edits = Vec::new();
        for (frame, known) in made_from.frames.iter().enumerate() {
            let path = || depth_map_path(version, &known.name);
            let depth = made[frame].then(|| DepthSource::Estimated {
                made: path(),
                scale: 1.0,
            });
            if !known.has_sensor_depth() {
                edits.push(Edit::SetDepth { frame, depth });
            }
        }
        let notice = format!("depths: {}", record.settings);
        edits.push(Edit::SetResult {
            kind: ResultKind::Depths,
            record: Some(record),
        });
        self.commit("Reconstruct", edits)?;
        self.events.push(crate::Event::Notice(notice));
        self.warn_all(warnings);
        Ok(())
    }
}

/// Runs the work on the requested device.
///
/// If `auto` selected a GPU that fails during the work, the rest is done on the CPU, with a
/// warning.
fn on_device(
    device: DeviceId,
    warnings: &mut Vec<String>,
    estimate: impl Fn(&StereoEngine) -> Result<BTreeMap<usize, ViewOutcome>>,
) -> Result<(StereoEngine, BTreeMap<usize, ViewOutcome>)> {
    let engine = engine(device, warnings)?;
    let outcomes = estimate(&engine);
    let failure = outcomes
        .as_ref()
        .err()
        .filter(|_| device == DeviceId::Auto)
        .and_then(card_failed);
    match failure {
        Some(why) => {
            warnings.push(format!("what was left was done on the processor: {why}"));
            Ok((StereoEngine::Cpu, estimate(&StereoEngine::Cpu)?))
        }
        None => Ok((engine, outcomes?)),
    }
}

/// Returns the engine that PatchMatch runs on.
///
/// # Errors
///
/// Returns an error if the device is `gpu` and there is neither a GPU nor a software substitute.
fn engine(device: DeviceId, warnings: &mut Vec<String>) -> Result<StereoEngine> {
    match device {
        DeviceId::Cpu => Ok(StereoEngine::Cpu),
        DeviceId::Gpu => Ok(StereoEngine::on(Device::open(Software::Allowed)?.into())?),
        DeviceId::Auto => Ok(Device::open(Software::Refused)
            .and_then(|device| StereoEngine::on(device.into()))
            .unwrap_or_else(|error| {
                if !matches!(error, GpuError::NoAdapter | GpuError::SoftwareOnly { .. }) {
                    warnings.push(format!("depths were made on the processor: {error}"));
                }
                StereoEngine::Cpu
            })),
    }
}

/// Returns the error message of a GPU that failed during the work.
fn card_failed(error: &anyhow::Error) -> Option<String> {
    match error.downcast_ref() {
        Some(StereoError::Gpu(error)) => Some(error.to_string()),
        _ => None,
    }
}

/// Returns every n-th frame, without those that have sensor depth.
fn chosen(frames: &[Frame], request: &ReconstructRequest) -> Result<Vec<usize>> {
    let open = |&frame: &usize| !frames[frame].has_sensor_depth();
    let views: Vec<usize> = (0..frames.len())
        .step_by(request.every)
        .filter(open)
        .collect();
    ensure!(
        !views.is_empty(),
        "all frames have depth of a sensor; stereo makes it for frames without"
    );
    Ok(views)
}

/// Returns the options of stereo that a request asks for.
pub(super) fn depth_options(request: &ReconstructRequest) -> StereoOptions {
    let options = StereoOptions::default();
    StereoOptions {
        max_side: request.max_side.unwrap_or(options.max_side),
        ..options
    }
}

/// Returns a digest of the inputs of the depths.
///
/// These are the cameras, images, views and options, and the labelled pixels if only these are
/// used.
fn key(
    project: &Project,
    views: &[usize],
    options: &StereoOptions,
    request: &ReconstructRequest,
) -> Result<String> {
    let mut digest = Sha256::new();
    let stamp = |frame: &Frame| {
        let file = std::fs::metadata(frame.image.path()).ok()?;
        Some((file.len(), file.modified().ok()?))
    };
    let frames: Vec<_> = project
        .frames
        .iter()
        .map(|frame| (&frame.name, &frame.image, &frame.camera, stamp(frame)))
        .collect();
    digest.update(serde_json::to_vec(&(frames, views, options))?);
    if request.only_labelled {
        for &view in views {
            digest.update(serde_json::to_vec(
                &project.mask_in_play(view).map(|mask| mask.runs.clone()),
            )?);
        }
    }
    Ok(digest
        .finalize()
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect())
}

/// Returns the newest unfinished version with the same inputs.
fn unfinished(root: &Path, project: &Project, key: &str) -> Option<u64> {
    let is_begun = |version: &u64| {
        let account = DepthFolder::new(root, *version, &project.frames).load_account();
        account.is_ok_and(|account| account.key == key && account.outcomes.is_none())
    };
    depth_versions(root).find(is_begun)
}

/// Stereo of some views into a folder.
struct StereoRun<'a> {
    project: &'a Project,
    root: &'a Path,
    store: &'a FrameStore,
    request: &'a ReconstructRequest,
    options: &'a StereoOptions,
    /// Frames that get depth.
    views: &'a [usize],
    folder: &'a DepthFolder,
    /// Warnings about the cache of features.
    warnings: Mutex<Vec<String>>,
}

fn lock(warnings: &Mutex<Vec<String>>) -> MutexGuard<'_, Vec<String>> {
    warnings.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Computes the depth maps of the views that `depths` does not hold yet.
fn estimate(
    run: &StereoRun<'_>,
    depths: &dyn DepthStore,
    engine: &StereoEngine,
    progress: &Progress,
) -> Result<BTreeMap<usize, ViewOutcome>> {
    let project = run.project;
    let frames = &project.frames;
    let sparse = sparse_points(run, progress)?;
    let mask = |frame: usize, raster: &Camera| {
        let none = || vec![false; raster.width as usize * raster.height as usize];
        let seen = || {
            let (mask, (lens, _)) = (
                project.mask_in_play(frame)?.decode(),
                frames[frame].posed_camera()?,
            );
            Some(labelled(&undistort_mask(&mask, lens, raster).ids))
        };
        run.request
            .only_labelled
            .then(|| seen().unwrap_or_else(none))
    };
    let stereo_request = StereoRequest {
        frames,
        views: run.views,
        sparse: &sparse,
        mask: &mask,
        engine,
    };
    Ok(estimate_depths(
        &stereo_request,
        run.store,
        depths,
        run.options,
        progress,
    )?)
}

fn labelled(ids: &[LabelId]) -> Vec<bool> {
    ids.iter().map(|&id| id != LabelId::NONE).collect()
}

/// Returns the sparse points for stereo.
///
/// These are the points that cameras were found with. If some views have none (given cameras,
/// frames registered later), points are triangulated from features, and saved for a resumed run.
fn sparse_points(run: &StereoRun<'_>, progress: &Progress) -> Result<SparsePoints> {
    let StereoRun {
        project,
        root,
        store,
        views,
        folder,
        ..
    } = *run;
    let sparse = load_sparse(root, project);
    let is_posed = |view: &&usize| project.frames[**view].posed_camera().is_some();
    if views
        .iter()
        .filter(is_posed)
        .all(|view| sparse.keypoints.contains_key(view))
    {
        return Ok(sparse);
    }
    if let Ok(sparse) = read_sparse_model(&folder.sparse(), &project.frames) {
        return Ok(sparse);
    }
    let limit_bytes = run.request.cache_limit_bytes();
    let cache = FeatureCache::open(feature_cache_path(root), limit_bytes);
    let (sift, nearest) = (Sift::default(), matcher(MatcherId::Auto, FeatureId::Sift)?);
    let [of_sift, of_nearest] = [identity(sift.name(), ""), identity(nearest.name(), "")];
    let extractor = CachedExtractor {
        extractor: &sift,
        identity: &of_sift,
        cache: &cache,
    };
    let matcher = CachedMatcher {
        matcher: nearest.as_ref(),
        identity: &of_nearest,
        cache: &cache,
    };
    let request = SparseRequest {
        frames: &project.frames,
        views,
        extractor: &extractor,
        matcher: &matcher,
    };
    let sparse = sparse_from_cameras(&request, store, &SparseOptions::default(), progress)?;
    lock(&run.warnings).extend(cache.save());
    write_colmap_model(
        &folder.sparse(),
        &project.frames,
        &sparse,
        ModelEncoding::Text,
    )?;
    Ok(sparse)
}

fn settings(
    views: &[usize],
    made: &[bool],
    options: &StereoOptions,
    engine: &StereoEngine,
) -> String {
    let done = made.iter().filter(|&&made| made).count();
    let side = options.max_side;
    format!(
        "{done} of {} views, at most {side} px wide or high, on {}",
        views.len(),
        engine.name()
    )
}

/// Returns one line per view without depth, up to a maximum number, and one for all that have no
/// camera.
fn views_without_depth(frames: &[Frame], outcomes: &BTreeMap<usize, ViewOutcome>) -> Vec<String> {
    let (mut lines, mut no_camera) = (Vec::new(), Vec::new());
    for (&frame, outcome) in outcomes {
        let name = frames[frame].name.as_str();
        match outcome {
            ViewOutcome::Done { .. } => {}
            ViewOutcome::NoCamera => no_camera.push(name),
            why => lines.push(format!("{name} has no depth: {why}")),
        }
    }
    let mut lines = left_out(lines, "depth");
    if let [name] = no_camera[..] {
        lines.push(format!("{name} has no depth: {}", ViewOutcome::NoCamera));
    } else {
        let what = [
            "has no camera and gets no depth",
            "have no camera and get no depth",
        ];
        lines.extend(naming(what, &no_camera));
    }
    lines
}
