use crate::job_task::JobTask;
use std::collections::BTreeSet;
use std::sync::Arc;

use anyhow::{Result, ensure};

use crate::{JobCompletion, JobKind};
use crate::{Session, Suggestion};
use ostra_cloud::SceneError;
use ostra_cloud::fuse::{naming, readable};
use ostra_core::job::JobId;
use ostra_core::job::Progress;
use ostra_frames::FrameStore;
use ostra_masks::Unexplained;
use ostra_masks::unexplained::areas_in_front;
use ostra_project::Project;
use ostra_project::suggestion::Reason;
use ostra_tracking::flow::{FlowOptions, moving_apart};

/// Maximum number of frames that are searched, spread over those with masks.
const FRAMES_LOOKED_AT: usize = 16;
/// Distance in frames over which motion is measured.
const APART: usize = 3;
/// Maximum number of suggestions.
const MOST: usize = 8;
/// Minimum overlap at which areas on neighbouring searched frames count as the same object.
const SAME_IOU: f64 = 0.15;

impl Session {
    /// Searches frames with masks for unlabelled objects.
    pub(crate) fn suggest(&mut self) -> Result<JobId> {
        let (project, store) = (self.snapshot()?, Arc::clone(&self.store));
        ensure!(
            !project.masks.is_empty(),
            "no frame has a mask; prompt and track first"
        );
        Ok(
            self.start(JobTask::Suggest, JobKind::Short, move |context| {
                let (found, warning) = suggestions(&project, &store, &context.progress)?;
                Ok(Box::new(move |session: &mut Self| {
                    session.suggestions = found;
                    session.warn_all(warning.into_iter().collect());
                    Ok(())
                }) as JobCompletion)
            }),
        )
    }

    /// Returns the unlabelled objects of the last search, the most significant first.
    #[must_use]
    pub fn suggestions(&self) -> &[Suggestion] {
        &self.suggestions
    }
}

/// Returns the suggestions, and a warning about frames whose image or depth cannot be read.
fn suggestions(
    project: &Project,
    store: &FrameStore,
    progress: &Progress,
) -> Result<(Vec<Suggestion>, Option<String>)> {
    progress.stage("suggest")?;
    let frames: Vec<usize> = project.masks.keys().copied().collect();
    let sampled: Vec<usize> = frames
        .iter()
        .copied()
        .step_by(frames.len().div_ceil(FRAMES_LOOKED_AT))
        .collect();
    let mut found: Vec<(usize, usize, Unexplained)> = Vec::new();
    let mut unread = BTreeSet::new();
    for (number, &frame) in sampled.iter().enumerate() {
        progress.step(number, sampled.len())?;
        let all = unexplained_on(project, store, frame, &mut unread)?;
        found.extend(all.into_iter().map(|one| (number, frame, one)));
    }
    if let (true, Some(&first)) = (
        sampled.iter().all(|number| unread.contains(number)),
        sampled.first(),
    ) {
        let frame = project.frame(first)?;
        store.image(frame)?;
        store.depth(frame)?;
    }
    found.sort_by(|a, b| {
        (a.2.why)
            .cmp(&b.2.why)
            .then(b.2.strength.total_cmp(&a.2.strength))
    });
    let mut kept: Vec<&(usize, usize, Unexplained)> = Vec::new();
    for one in &found {
        let is_same = |other: &&(usize, usize, Unexplained)| {
            let same_size = one.2.region.width == other.2.region.width
                && one.2.region.height == other.2.region.height;
            one.0.abs_diff(other.0) <= 2
                && same_size
                && one.2.region.iou(&other.2.region) > SAME_IOU
        };
        if kept.len() < MOST && !kept.iter().any(is_same) {
            kept.push(one);
        }
    }
    let suggested = kept
        .into_iter()
        .filter_map(|(_, frame, one)| Suggestion::of(*frame, &one.region, Reason::Apart(one.why)));
    let names: Vec<&str> = unread
        .iter()
        .map(|&frame| project.frames[frame].name.as_str())
        .collect();
    Ok((
        suggested.collect(),
        naming(
            [
                "cannot be read (image or depth) and was passed over; check its files",
                "cannot be read (image or depth) and were passed over; check their files",
            ],
            &names,
        ),
    ))
}

/// Returns the unlabelled objects of a frame.
///
/// They are found by motion relative to a nearby frame, and by depth if there is any. Frames whose
/// image or depth cannot be read are added to `unread`.
fn unexplained_on(
    project: &Project,
    store: &FrameStore,
    frame: usize,
    unread: &mut BTreeSet<usize>,
) -> Result<Vec<Unexplained>> {
    let of = project.frame(frame)?;
    let Some(mask) = project.masks.get(&frame).map(|mask| mask.runs.decode()) else {
        return Ok(Vec::new());
    };
    let mut found = Vec::new();
    let apart = [Some(frame + APART), frame.checked_sub(APART)];
    let other = apart
        .into_iter()
        .flatten()
        .find(|&other| other < project.frames.len());
    if let Some(other) = other {
        let mut image = |number: usize| -> Result<_> {
            let image = readable(
                store
                    .image(&project.frames[number])
                    .map_err(SceneError::from),
            )?;
            unread.extend(image.is_none().then_some(number));
            Ok(image)
        };
        if let (Some(image), Some(other)) = (image(frame)?, image(other)?) {
            found.extend(moving_apart(&image, &other, &mask, &FlowOptions::default()));
        }
    }
    let depth = readable(store.depth(of).map_err(SceneError::from))?;
    unread.extend(depth.is_none().then_some(frame));
    found.extend(
        depth
            .flatten()
            .into_iter()
            .flat_map(|depth| areas_in_front(&depth, &mask)),
    );
    Ok(found)
}
