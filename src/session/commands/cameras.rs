use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Result, ensure};

use super::camera_models::{save_models, several_models};
use super::found_cameras::{Cameras, Poses, calibrated, edits, is_posed, record, unplaced};
use super::match_again::with_better_matches;
use crate::Event;
use crate::Session;
use crate::engines::{extractor, identity, matcher, registration, second_matcher};
use crate::jobs::JobContext;
use crate::live_preview::PlacedFrames;
use ostra_core::job::{Progress, Stopped};
use ostra_frames::{DepthSource, Frame, FrameStore};
use ostra_masks::LabelId;
use ostra_project::store::{feature_cache_path, sync_folder};
use ostra_project::{Coordinates, Edit, Project, ReconstructRequest, ResultRecord, StepSeconds};
use ostra_reconstruct::rgbd::{RgbdOptions, RgbdRequest, calibrate, register_rgbd};
use ostra_reconstruct::sfm::{
    CachedExtractor, CachedMatcher, FeatureCache, FeatureExtractor, FeatureMatcher, MapperOptions,
    PairOptions, SfmRequest, planned_stages, structure_from_motion,
};

/// Method that finds cameras.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Finder {
    /// Structure from motion.
    Sfm(Poses),
    /// Registration by depth and images, which estimates all poses again.
    Rgbd,
}

/// Inputs of the search for cameras.
pub struct CameraWork {
    pub project: Arc<Project>,
    pub root: PathBuf,
    pub store: Arc<FrameStore>,
    pub request: ReconstructRequest,
    pub finder: Finder,
    pub version: u64,
    extractor: Box<dyn FeatureExtractor>,
    matcher: Box<dyn FeatureMatcher>,
}

/// Cameras that were found; their files are already written.
pub(super) struct ComputedCameras {
    made_from: Arc<Project>,
    edits: Vec<Edit>,
    notices: Vec<String>,
    warnings: Vec<String>,
    /// Whether the search was stopped, so that the result is partial.
    pub stopped: bool,
}

impl CameraWork {
    /// Checks a request and loads the engines that it needs.
    ///
    /// # Errors
    ///
    /// Returns an error if a pair contains an unknown frame, or an engine is not installed.
    pub fn new(
        project: Arc<Project>,
        request: &ReconstructRequest,
        finder: Finder,
        session: &mut Session,
    ) -> Result<Self> {
        let frames = project.frames.len();
        let unknown = request
            .pairs
            .iter()
            .flatten()
            .find(|&&frame| frame >= frames);
        ensure!(
            unknown.is_none(),
            "there is no frame {}; the project has {frames}",
            unknown.unwrap_or(&0)
        );
        let extractor = extractor(request.features, request.max_side)?;
        let matcher = matcher(request.matcher, request.features)?;
        let version = session.opened()?.next_version()?;
        let (root, store) = (
            session.opened()?.root().to_owned(),
            Arc::clone(&session.store),
        );
        Ok(Self {
            project,
            root,
            store,
            request: request.clone(),
            finder,
            version,
            extractor,
            matcher,
        })
    }

    /// Finds the cameras.
    ///
    /// If stopped, returns the cameras found so far, if they are more than the project already has.
    ///
    /// # Errors
    ///
    /// Returns an error if no camera can be found, a file cannot be written, or the search was
    /// stopped too early.
    pub fn find(self, context: &JobContext<Session>) -> Result<ComputedCameras> {
        let begun = Instant::now();
        let poses = self.poses();
        let limit_bytes = self.request.cache_limit_bytes();
        let cache = FeatureCache::open(feature_cache_path(&self.root), limit_bytes);
        let result: Cameras = match self.finder {
            Finder::Sfm(_) => self.by_motion(poses, &cache, &context.progress)?,
            Finder::Rgbd => self.by_depth(context)?,
        };
        let of_cache = cache.save();
        let frames = &self.project.frames;
        if result.stopped
            && result.cameras.len() <= frames.iter().filter(|frame| is_posed(frame)).count()
        {
            return Err(Stopped.into());
        }
        let coordinates = match result.has_given_poses && poses == Poses::Kept {
            true => self.project.coordinates(),
            false => Coordinates::chosen_with(self.version, result.is_metric),
        };
        let record = ResultRecord {
            version: self.version,
            coordinates: Some(coordinates),
            steps: StepSeconds::of(&context.progress, 0),
            ..record(&result, begun.elapsed())
        };
        let record = save_models(&self.root, &self.project, &result, poses, record)?;
        sync_folder(&self.root.join("versions"))?;
        Ok(ComputedCameras {
            notices: cache
                .report()
                .into_iter()
                .chain([format!("cameras: {}", record.settings)])
                .collect(),
            warnings: several_models(&record.models)
                .into_iter()
                .chain(unplaced(frames, &result))
                .chain(result.warnings.clone())
                .chain(of_cache)
                .collect(),
            edits: edits(&self.project, &result, poses, record),
            stopped: result.stopped,
            made_from: self.project,
        })
    }

    fn poses(&self) -> Poses {
        match self.finder {
            Finder::Sfm(poses) => poses,
            Finder::Rgbd => Poses::FromScratch,
        }
    }

    fn by_depth(&self, context: &JobContext<Session>) -> Result<Cameras> {
        context.progress.stage("compare images with depth maps")?;
        let calibrations = calibrate(&self.project.frames, &self.store, &context.progress)?;
        let frames = calibrated(&self.project.frames, &calibrations);
        let (chosen, between): (Vec<usize>, Vec<usize>) =
            (0..self.project.frames.len()).partition(|&frame| frame % self.request.every == 0);
        let placed = PlacedFrames {
            frames: &frames,
            images: &self.store,
            sink: context,
        };
        let rgbd_request = RgbdRequest {
            on_pose: &|frame, pose| placed.show(frame, pose),
            frames: &frames,
            chosen: &chosen,
            between: &between,
            pairs: &self.request.pairs,
            extractor: self.extractor.as_ref(),
            matcher: self.matcher.as_ref(),
            options: RgbdOptions {
                registration: registration(self.request.registration),
                ..RgbdOptions::default()
            },
        };
        let result = register_rgbd(&rgbd_request, &self.store, &context.progress)
            .map_err(|error| anyhow::anyhow!(error))?;
        Ok(Cameras::from_depth(result, calibrations))
    }

    fn by_motion(
        &self,
        poses: Poses,
        cache: &FeatureCache,
        progress: &Progress,
    ) -> Result<Cameras> {
        let (project, request) = (&self.project, &self.request);
        let by = identity(self.extractor.name(), &format!("{:?}", request.max_side));
        let extractor = CachedExtractor {
            extractor: self.extractor.as_ref(),
            identity: &by,
            cache,
        };
        let by = identity(self.matcher.name(), "");
        let matcher = CachedMatcher {
            matcher: self.matcher.as_ref(),
            identity: &by,
            cache,
        };
        let frames = &project.frames;
        let kept = |frame: usize| poses == Poses::Kept && frames[frame].posed_camera().is_some();
        let (mapped, located): (Vec<usize>, Vec<usize>) =
            (0..frames.len()).partition(|&frame| builds_model(request, frame) || kept(frame));
        let place = |frame: usize| mapped.binary_search(&frame).ok();
        let pairs = request
            .pairs
            .iter()
            .filter_map(|&[a, b]| Some((place(a)?, place(b)?)))
            .collect();
        let allowed = |frame: usize| {
            let labelled = || project.mask_in_play(frame).map(|runs| runs.decode());
            let pixels = request.only_labelled.then(labelled)?;
            let none = || vec![false; frames[frame].width as usize * frames[frame].height as usize];
            Some(pixels.map_or_else(none, |mask| {
                mask.ids.iter().map(|&id| id != LabelId::NONE).collect()
            }))
        };
        let sfm_request = SfmRequest {
            frames,
            mapped: &mapped,
            located: &located,
            keep_poses: poses == Poses::Kept,
            allowed: &allowed,
            extractor: &extractor,
            cached: Some(&extractor),
            matcher: &matcher,
            pairs: PairOptions {
                given: pairs,
                ..PairOptions::default()
            },
            mapper: MapperOptions::default(),
        };
        let first = structure_from_motion(&sfm_request, &self.store, progress);
        let second = || second_matcher(request.matcher, request.features);
        let best = with_better_matches(first, second, |network| {
            let has_depth = frames.iter().any(Frame::has_sensor_depth);
            progress.plan_next(&planned_stages(mapped.len(), located.len(), has_depth));
            let by = identity(network.name(), "");
            let matcher = CachedMatcher {
                matcher: network,
                identity: &by,
                cache,
            };
            let sfm_request = SfmRequest {
                matcher: &matcher,
                ..sfm_request
            };
            structure_from_motion(&sfm_request, &self.store, progress)
        })?;
        Ok(best.into())
    }
}

impl ComputedCameras {
    /// Returns the project that the cameras were found for, with the cameras applied.
    ///
    /// # Errors
    ///
    /// Returns an error if an edit does not fit the project.
    pub fn applied(&self) -> Result<Project> {
        let mut project = Project::clone(&self.made_from);
        for edit in &self.edits {
            project.apply(edit.clone())?;
        }
        Ok(project)
    }

    /// Commits the cameras to the session.
    ///
    /// # Errors
    ///
    /// Returns an error if the step cannot be saved.
    pub fn land(mut self, session: &mut Session) -> Result<()> {
        let now = session.snapshot()?;
        let changed = self.made_from.frames != now.frames;
        for edit in &mut self.edits {
            // The file may have been moved in the meantime.
            if let Edit::SetDepth {
                frame,
                depth: Some(DepthSource::Sensor { path, .. }),
            } = edit
                && let Some(DepthSource::Sensor { path: place, .. }) = &now.frames[*frame].depth
            {
                path.clone_from(place);
            }
            if let Edit::SetResult {
                record: Some(record),
                ..
            } = edit
            {
                record.stale = changed && record.version > 0;
            }
        }
        session.commit("Reconstruct", self.edits)?;
        session
            .events
            .extend(self.notices.into_iter().map(Event::Notice));
        session.warn_all(self.warnings);
        Ok(())
    }
}

/// Returns whether a frame takes part in building the model: every Nth one, and those of pairs that
/// the user picked. The others are placed in the finished model.
fn builds_model(request: &ReconstructRequest, frame: usize) -> bool {
    frame.is_multiple_of(request.every) || request.pairs.iter().flatten().any(|&of| of == frame)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_of_picked_pairs_build_the_model() {
        let request = ReconstructRequest {
            every: 4,
            pairs: vec![[1, 8], [2, 3]],
            ..ReconstructRequest::default()
        };
        let frames = (0..10).filter(|&frame| builds_model(&request, frame));
        assert_eq!(frames.collect::<Vec<_>>(), [0, 1, 2, 3, 4, 8]);
    }
}
