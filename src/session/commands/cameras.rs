use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Result, ensure};

use super::reconstruct::given;
use crate::engine::job::Progress;
use crate::frames::cameras::{ModelEncoding, write_colmap_model};
use crate::frames::{Frame, FrameCamera, FrameStore};
use crate::masks::LabelId;
use crate::scene::sfm::{
    FeatureExtractor, FeatureMatcher, MapperOptions, Outcome, PairOptions, SfmRequest, SfmResult, structure_from_motion,
};
use crate::session::engines::{extractor, matcher};
use crate::session::jobs::{Kind, Landing};
use crate::session::store::{save_outcomes, sparse_path, sync_folder};
use crate::session::{Edit, Event, JobId, Project, ReconstructRequest, ResultKind, ResultRecord, Session};

/// What becomes of poses that frames have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Poses {
    /// All are found anew.
    Anew,
    /// They stay, and the other frames are placed beside them.
    Kept,
}

/// Warnings about frames left out that are told one by one.
const TOLD: usize = 20;

impl Session {
    /// Cameras by structure from motion.
    pub(super) fn find_cameras(
        &mut self,
        project: Arc<Project>,
        request: &ReconstructRequest,
        poses: Poses,
    ) -> Result<JobId> {
        let frames = project.frames.len();
        let unknown = request.pairs.iter().flatten().find(|&&frame| frame >= frames);
        ensure!(unknown.is_none(), "there is no frame {}; the project has {frames}", unknown.unwrap_or(&0));
        let extractor = extractor(&request.features, request.max_side)?;
        let matcher = matcher(&request.matcher, extractor.name())?;
        let version = self.opened()?.next_version()?;
        let root = self.opened()?.root().to_owned();
        let (store, request) = (Arc::clone(&self.store), request.clone());
        Ok(self.start("Reconstruct", Kind::Long, move |link| {
            let begun = Instant::now();
            let engines = (extractor.as_ref(), matcher.as_ref());
            let result = make(&project, &request, poses, engines, &store, &link.progress)?;
            link.progress.stage("save")?;
            save(&sparse_path(&root, version), &project.frames, &result)?;
            sync_folder(&root.join("versions"))?;
            let record = ResultRecord {
                engine: "sfm".into(),
                frames: result.cameras.len(),
                seconds: begun.elapsed().as_secs_f64(),
                stale: false,
                settings: settings(&result),
                version,
            };
            Ok(Box::new(move |session: &mut Self| session.take_cameras(&project, &result, poses, record)) as Landing)
        }))
    }

    fn take_cameras(
        &mut self,
        made_from: &Project,
        result: &SfmResult,
        poses: Poses,
        mut record: ResultRecord,
    ) -> Result<()> {
        record.stale = made_from.frames != self.snapshot()?.frames;
        let notice = format!("cameras: {}", record.settings);
        let mut edits: Vec<Edit> = made_from
            .frames
            .iter()
            .enumerate()
            .map(|(frame, known)| Edit::SetCamera { frame, camera: camera(known, result.cameras.get(&frame), poses) })
            .collect();
        edits.push(Edit::SetResult { kind: ResultKind::Cameras, record: Some(record) });
        let with_depth = made_from.frames.iter().filter(|frame| frame.depth.is_some()).count();
        if with_depth > 0 {
            edits.push(given(ResultKind::Depths, with_depth, ""));
        }
        self.commit("Reconstruct", edits)?;
        self.events.push(Event::Notice(notice));
        self.warn_all(left_out(&made_from.frames, result));
        Ok(())
    }
}

fn make(
    project: &Project,
    request: &ReconstructRequest,
    poses: Poses,
    (extractor, matcher): (&dyn FeatureExtractor, &dyn FeatureMatcher),
    store: &FrameStore,
    progress: &Progress,
) -> Result<SfmResult> {
    let frames = &project.frames;
    let kept = |frame: usize| poses == Poses::Kept && frames[frame].posed_camera().is_some();
    let (mapped, located): (Vec<usize>, Vec<usize>) =
        (0..frames.len()).partition(|&frame| frame % request.every == 0 || kept(frame));
    let place = |frame: usize| mapped.binary_search(&frame).ok();
    let pairs = request.pairs.iter().filter_map(|&[a, b]| Some((place(a)?, place(b)?))).collect();
    let allowed = |frame: usize| {
        let labelled = || project.mask_in_play(frame).map(|runs| runs.decode());
        let pixels = request.only_labelled.then(labelled)?;
        let none = || vec![false; frames[frame].width as usize * frames[frame].height as usize];
        Some(pixels.map_or_else(none, |mask| mask.ids.iter().map(|&id| id != LabelId::NONE).collect()))
    };
    let wish = SfmRequest {
        frames,
        mapped: &mapped,
        located: &located,
        keep_poses: poses == Poses::Kept,
        allowed: &allowed,
        extractor,
        matcher,
        pairs: PairOptions { given: pairs, ..PairOptions::default() },
        mapper: MapperOptions::default(),
    };
    structure_from_motion(&wish, store, progress).map_err(|error| anyhow::anyhow!(error))
}

/// The camera that a frame has after it: where none was found, a pose found anew leaves only given intrinsics.
fn camera(known: &Frame, found: Option<&FrameCamera>, poses: Poses) -> Option<FrameCamera> {
    match (found, poses) {
        (Some(found), _) => Some(*found),
        (None, Poses::Kept) => known.camera,
        (None, Poses::Anew) => known
            .camera
            .filter(|camera| !camera.estimated)
            .map(|camera| FrameCamera { camera_from_world: None, ..camera }),
    }
}

fn settings(result: &SfmResult) -> String {
    let [features, matcher] = result.methods;
    let of = result.outcomes.len();
    let mut text = format!(
        "{} of {of} frames by {features} + {matcher}, {} points",
        result.cameras.len(),
        result.sparse.points.len()
    );
    let mut errors: Vec<f64> = result.sparse.points.iter().filter_map(|point| point.error_px).collect();
    errors.sort_unstable_by(f64::total_cmp);
    if let Some(median) = errors.get(errors.len() / 2) {
        text += &format!(", median error {median:.2} px");
    }
    if result.models.len() > 1 {
        let others: Vec<String> = result.models[1..].iter().map(ToString::to_string).collect();
        text += &format!(", left out another model of {} frames", others.join(" and one of "));
    }
    match &result.scale {
        Some(scale) => text + &format!(", scale from {} depths ± {:.1} %", scale.samples, 100.0 * scale.spread),
        None => text,
    }
}

/// One line per frame without a camera, up to a number.
fn left_out(frames: &[Frame], result: &SfmResult) -> Vec<String> {
    let placed = |outcome: &Outcome| matches!(outcome, Outcome::Placed { .. });
    let out: Vec<_> = result.outcomes.iter().filter(|(_, outcome)| !placed(outcome)).collect();
    let name = |frame: usize| frames[frame].name.as_str();
    let told = out.iter().take(TOLD).map(|(frame, why)| format!("{} has no camera: {}", name(**frame), why.text(name)));
    let mut lines: Vec<String> = told.collect();
    if out.len() > TOLD {
        lines.push(format!("{} more frames have no camera; the window tells why for each", out.len() - TOLD));
    }
    lines
}

/// Points, keypoints and what became of each frame, under the version's number.
fn save(folder: &Path, frames: &[Frame], result: &SfmResult) -> Result<()> {
    let mut placed = frames.to_vec();
    for (number, frame) in placed.iter_mut().enumerate() {
        frame.camera = result.cameras.get(&number).copied();
    }
    write_colmap_model(folder, &placed, &result.sparse, ModelEncoding::Text)?;
    save_outcomes(folder, &result.outcomes)
}
