use crate::job_task::JobTask;
use ostra_project::ResultEngine;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Result, ensure};

use super::surface::{FusionInputs, Made, stereo_version};
use crate::Event;
use crate::Session;
use crate::{JobCompletion, JobKind};
use ostra_cloud::fuse::{
    ChosenVoxel, Dropped, FuseOptions, Fused, MaskVote, OntoOptions, ProjectViews, fuse, vote_onto,
    vote_seen,
};
use ostra_cloud::ply::{SavedColors, read_ply, save_ply};
use ostra_core::job::{JobId, PlannedStage, Progress};
use ostra_frames::{DepthSource, Frame};
use ostra_masks::Label;
use ostra_project::reusable_votes::{ReusableVotes, geometry_digest};
use ostra_project::store::{DepthFolder, cloud_path, sync_folder, votes_path};
use ostra_project::voted_cloud::save_votes;
use ostra_project::{
    Coordinates, Edit, FuseRequest, Project, ResultKind, ResultRecord, StepSeconds,
};
use ostra_reconstruct::stereo::{
    DenseCloud, FusionOptions, FusionRequest, ViewOutcome, fuse_depths,
};

/// Maximum number of points from stereo depths if no voxel size is given.
const STEREO_POINTS: usize = 4_000_000;

impl Session {
    pub(crate) fn fuse(&mut self, request: &FuseRequest) -> Result<JobId> {
        self.check_no_long_job()?;
        let edits = self.snapshot()?.move_origin_near_cameras();
        if !edits.is_empty() {
            self.commit("Move the origin to the cameras", edits)?;
        }
        let (project, request) = (self.snapshot()?, request.clone());
        let version = self.opened()?.next_version()?;
        let root = self.opened()?.root().to_owned();
        let store = Arc::clone(&self.store);
        let loaded = self
            .cloud_version()
            .and_then(|version| self.background.cloud.voted(version));
        Ok(self.start(JobTask::Fuse, JobKind::Long, move |context| {
            context.progress.plan(&planned_stages());
            let begun = Instant::now();
            let geometry = geometry_digest(&project, &request)?;
            let before = ReusableVotes::find(&project, &root, &request, &geometry, loaded);
            let onto = OntoScale::of(&project, &request)?;
            let scaled = before
                .as_ref()
                .map_or(onto.factor, |before| before.record.scaled);
            // The surface comes first. Made while the points and their votes are in memory, it
            // would need more memory.
            let inputs = FusionInputs {
                store: &store,
                root: &root,
                project: &project,
                request: &request,
            };
            let (voxel, no_surface) =
                match inputs.make_surface(version, before.as_ref(), &context.progress)? {
                    Made::Surface { voxel } => (Some(voxel), None),
                    Made::Nothing(why) => (None, why),
                };
            let (mut fused, settings) = make(&inputs, before.as_ref(), &onto, &context.progress)?;
            fused.report.warnings.extend(no_surface);
            context.progress.stage("save")?;
            save_ply(
                &cloud_path(&root, version),
                &fused.cloud,
                SavedColors::Image,
                &context.progress,
            )?;
            save_votes(&votes_path(&root, version), &fused.votes)?;
            sync_folder(&root.join("versions"))?;
            let summary = summary(&request, &fused, voxel);
            let record = ResultRecord {
                engine: if request.onto.is_some() {
                    ResultEngine::Onto
                } else {
                    ResultEngine::Fuse
                },
                frames: fused.report.frames_voted,
                seconds: begun.elapsed().as_secs_f64(),
                steps: StepSeconds::of(&context.progress, 0),
                stale: false,
                settings,
                version,
                voxel,
                geometry: Some(geometry),
                scaled,
                coordinates: Some(coordinates(&project, version)),
                models: Vec::new(),
                request: Some(request),
            };
            Ok(Box::new(move |session: &mut Self| {
                session.take_cloud(&project, fused, record, summary)
            }) as JobCompletion)
        }))
    }

    fn take_cloud(
        &mut self,
        made_from: &Project,
        fused: Fused,
        mut record: ResultRecord,
        summary: String,
    ) -> Result<()> {
        let version = record.version;
        record.stale = has_changed(made_from, &*self.snapshot()?) || has_stale_depths(made_from);
        self.commit(
            "Fuse",
            vec![Edit::SetResult {
                kind: ResultKind::Cloud,
                record: Some(record),
            }],
        )?;
        self.background
            .cloud
            .put(Some(version), fused.cloud, Some(fused.votes));
        self.events.push(Event::CloudChanged);
        self.events.push(Event::Notice(summary));
        self.warn_all(fused.report.warnings);
        Ok(())
    }
}

/// Returns the stages of a fusion. Those that a request needs not are left out when later ones begin.
fn planned_stages() -> [PlannedStage; 7] {
    let stage = PlannedStage::new;
    // Per frame with depth, the grid of points and the surface take about as long; a vote takes less.
    [
        stage("surface", "Make the surface", 1.0),
        stage("surface", "Make the surface", 3.0),
        stage("vote", "Label the surface", 1.0),
        stage("fuse", "Fuse points", 3.0),
        stage("outliers", "Fuse points", 0.5),
        stage("vote", "Label the points", 2.0),
        stage("save", "Save results", 0.5),
    ]
}

/// Returns the labelled points, and a text that describes how they were made.
fn make(
    inputs: &FusionInputs<'_>,
    before: Option<&ReusableVotes>,
    onto: &OntoScale,
    progress: &Progress,
) -> Result<(Fused, String)> {
    let project = inputs.project;
    let masks = |frame: usize| {
        project
            .mask_in_play(frame)
            .map(|runs| Arc::new(runs.decode()))
    };
    let views = ProjectViews {
        frames: &project.frames,
        store: inputs.store,
        masks: &masks,
    };
    if let Some(before) = before
        && let Some(fused) = before.cloud(&views, project, progress)?
    {
        return Ok((fused, before.record.settings.clone()));
    }
    let mut fused = make_points(inputs, &views, onto, progress)?;
    fused.cloud.origin = project.origin;
    let settings = settings(inputs.request, &fused, stereo_version(project).is_some());
    Ok((fused, settings))
}

fn make_points(
    inputs: &FusionInputs<'_>,
    views: &ProjectViews<'_>,
    scale: &OntoScale,
    progress: &Progress,
) -> Result<Fused> {
    let FusionInputs {
        project, request, ..
    } = *inputs;
    let (min_confidence, drop_unlabelled) = (
        request.min_confidence.unwrap_or(0.0),
        request.drop_unlabelled,
    );
    let onto = OntoOptions {
        min_confidence,
        drop_unlabelled,
        ..OntoOptions::default()
    };
    let vote = MaskVote {
        views,
        tree: &project.labels,
        options: &onto,
    };
    if let Some(path) = &request.onto {
        let mut given = read_ply(path, progress)?;
        // The project's origin was scaled with its cameras.
        if let Some(factor) = scale.factor {
            given.cloud.scale_by(factor);
        }
        given.cloud.move_origin(project.origin);
        given.warnings.extend(scale.warning.clone());
        let mut fused = vote_onto(&given.cloud, &vote, progress)?;
        fused.report.warnings.splice(0..0, given.warnings);
        return Ok(fused);
    }
    if let Some(version) = stereo_version(project) {
        let (cloud, voxel, unreadable) = dense_cloud(inputs, version, progress)?;
        let (points, seen) = cloud.into_points();
        let mut fused = vote_seen(points, &seen, &vote, progress)?;
        fused.report.voxel = voxel.unwrap_or_default();
        fused.report.warnings.extend(unreadable);
        if has_stale_depths(project) {
            fused
                .report
                .warnings
                .push("the depths were made with other cameras; reconstruct again".into());
        }
        return Ok(fused);
    }
    let voxel = request.voxel;
    let options = FuseOptions {
        voxel,
        min_confidence,
        drop_unlabelled,
        ..FuseOptions::default()
    };
    Ok(fuse(views, &project.labels, &options, progress)?)
}

/// Returns the coordinates of a cloud that is fused now.
///
/// They are those of the cameras, unless the depths were made in other coordinates.
fn coordinates(project: &Project, version: u64) -> Coordinates {
    let is_stereo = |frame: &Frame| matches!(frame.depth, Some(DepthSource::Estimated { .. }));
    match has_stale_depths(project) && project.frames.iter().any(is_stereo) {
        true => Coordinates::chosen_with(version, false),
        false => project.coordinates(),
    }
}

/// Factor for the points of a given cloud if the scale was set after the last vote on it.
struct OntoScale {
    factor: Option<f64>,
    warning: Option<String>,
}

impl OntoScale {
    fn of(project: &Project, request: &FuseRequest) -> Result<Self> {
        let nothing = Self {
            factor: None,
            warning: None,
        };
        let last = project.results.get(&ResultKind::Cloud).and_then(|record| {
            let requested = record
                .request
                .as_ref()
                .filter(|requested| requested.onto == request.onto)?;
            Some((
                record,
                requested,
                requested.onto.as_deref()?,
                record.scaled?,
            ))
        });
        let Some((record, requested, path, factor)) = last else {
            return Ok(nothing);
        };
        if record.geometry.as_ref() == Some(&geometry_digest(project, requested)?) {
            return Ok(Self {
                factor: Some(factor),
                ..nothing
            });
        }
        let warning = format!(
            "{}: its points are taken as they are; since this file was voted on, the scale was set (lengths times {factor:.6}): \
             if the file is older, export the project's cloud and vote on that",
            path.display()
        );
        Ok(Self {
            warning: Some(warning),
            ..nothing
        })
    }
}

/// Returns whether an input of the depths has changed since.
fn has_stale_depths(project: &Project) -> bool {
    project
        .results
        .get(&ResultKind::Depths)
        .is_some_and(|record| record.stale)
}

/// Returns the points of the stereo depth maps with the pixels that see them.
///
/// Also returns the voxel size to which they were thinned, and a warning about frames that cannot
/// be read.
fn dense_cloud(
    inputs: &FusionInputs<'_>,
    version: u64,
    progress: &Progress,
) -> Result<(DenseCloud, Option<f64>, Option<String>)> {
    let frames = &inputs.project.frames;
    let folder = DepthFolder::new(inputs.root, version, frames).scaled(frames);
    let account = folder.load_account()?;
    // A frame that lost its camera since gives no points.
    let is_posed = |frame: usize| {
        frames
            .get(frame)
            .is_some_and(|frame| frame.posed_camera().is_some())
    };
    let compared = |(frame, outcome): (usize, ViewOutcome)| match outcome {
        ViewOutcome::Done { sources, .. } if is_posed(frame) => Some((frame, sources)),
        _ => None,
    };
    let neighbours = account
        .outcomes
        .unwrap_or_default()
        .into_iter()
        .filter_map(compared)
        .collect();
    let request = FusionRequest {
        frames,
        neighbours: &neighbours,
        max_side: account.max_side,
    };
    let (cloud, unreadable) = fuse_depths(
        &request,
        inputs.store,
        &folder,
        &FusionOptions::default(),
        progress,
    )?;
    ensure!(
        !cloud.is_empty(),
        "the depth maps do not agree on any point; check them, and reconstruct with more images"
    );
    let (cloud, voxel) = match inputs.request.voxel {
        Some(voxel) => (cloud.thinned(voxel)?, Some(voxel)),
        None => cloud.thinned_to(STEREO_POINTS, progress)?,
    };
    Ok((cloud, voxel, unreadable))
}

/// Returns whether an input of the cloud has changed.
fn has_changed(before: &Project, now: &Project) -> bool {
    let runs = |project: &Project| -> Vec<_> { project.masks_in_play().collect() };
    let same_name = |label: &Label| {
        let now = now.labels.get(label.id);
        now.is_some_and(|now| (&now.name, now.parent) == (&label.name, label.parent))
    };
    before.frames != now.frames || !before.labels.iter().all(same_name) || runs(before) != runs(now)
}

fn settings(request: &FuseRequest, fused: &Fused, is_stereo: bool) -> String {
    let source = match &request.onto {
        Some(onto) => format!("onto {}", onto.display()),
        None if is_stereo && fused.report.voxel == 0.0 => "stereo".into(),
        None if is_stereo => format!("stereo, voxel {:.6}", fused.report.voxel),
        None => format!("voxel {:.6}{}", fused.report.voxel, chosen(fused)),
    };
    let confidence = request
        .min_confidence
        .map(|share| format!(", min confidence {share}"))
        .unwrap_or_default();
    let Dropped {
        background,
        contour,
        ..
    } = fused.report.dropped;
    let dropped = match request.drop_unlabelled {
        true => {
            format!(", dropped {background} points of the background and {contour} at contours")
        }
        false => String::new(),
    };
    format!(
        "{source}{confidence}{dropped}, {} points",
        fused.report.points
    )
}

/// Describes the basis on which the voxel size was chosen, if it was.
fn chosen(fused: &Fused) -> String {
    let of = |ChosenVoxel { footprint, views }: ChosenVoxel| {
        format!(" (chosen: a pixel covers {footprint:.6}, a place is seen by {views:.0} frames)")
    };
    fused.report.chosen.map(of).unwrap_or_default()
}

/// Returns a one-line summary of the cloud.
fn summary(request: &FuseRequest, fused: &Fused, surface: Option<f64>) -> String {
    let (points, voxel) = (fused.report.points, fused.report.voxel);
    let size = if voxel > 0.0 {
        format!(", voxel {voxel}{}", chosen(fused))
    } else {
        String::new()
    };
    let surface = surface
        .map(|edge| format!(", surface voxel {edge:.6}"))
        .unwrap_or_default();
    let made = if request.onto.is_some() {
        "labelled"
    } else {
        "fused"
    };
    format!("{made} {points} points{size}{surface}")
}
