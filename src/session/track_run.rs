use ostra_project::ResultEngine;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Result, bail, ensure};

use crate::TrackSettings;
use ostra_core::job::JobId;
use ostra_frames::FrameStore;
use ostra_masks::{LabelId, RunMask, TrackRequest, TrackedFrame};
use ostra_project::LabelChoice;
use ostra_project::mask_edits::label_name;
use ostra_project::{FrameMask, MaskOrigin, Project, ResultRecord};

/// A tracking run whose frames arrive one by one.
pub(crate) struct TrackRun {
    pub(crate) job: JobId,
    pub(crate) engine: &'static str,
    pub(crate) title: String,
    pub(crate) settings: String,
    /// Labels that are taken from its frames.
    pub(crate) choice: LabelChoice,
    pub(crate) begun: Instant,
    /// The project at the start of the run.
    pub(crate) made_from: Arc<Project>,
    /// Frames done so far.
    pub(crate) done: BTreeSet<usize>,
    pub(crate) waiting: Vec<(usize, FrameMask)>,
    pub(crate) saved: Instant,
    /// Confidence below which the run pauses.
    pub(crate) pause_below: Option<f32>,
    pub(crate) pause: Option<Pause>,
}

/// The frame at which a run paused, and the label with the lowest confidence.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pause {
    pub(crate) frame: usize,
    pub(crate) label: LabelId,
    /// Confidence between 0 and 1.
    pub(crate) confidence: f32,
}

impl TrackRun {
    /// Returns whether this is the run of that job.
    pub(crate) fn is_of(&self, job: JobId) -> bool {
        self.job == job
    }

    /// Returns whether and why the run pauses at a frame.
    ///
    /// It pauses at the label with the lowest confidence, if that is too low.
    pub(crate) fn pause_at(
        &self,
        project: &Project,
        frame: usize,
        mask: &FrameMask,
    ) -> Option<Pause> {
        let barred = &project.absent_on(frame) | &project.locked_on(frame);
        let is_chosen = |label: &LabelId| {
            self.choice
                .labels()
                .is_none_or(|labels| labels.contains(label))
        };
        let is_meant = |label: &LabelId| is_chosen(label) && !barred.contains(label);
        let meant = mask.confidence.iter().filter(|(label, _)| is_meant(label));
        let (&label, &confidence) = meant.min_by(|a, b| a.1.total_cmp(b.1))?;
        (confidence < self.pause_below?).then_some(Pause {
            frame,
            label,
            confidence,
        })
    }

    pub(crate) fn record(&self) -> ResultRecord {
        ResultRecord {
            engine: ResultEngine::from(self.engine),
            frames: self.done.len(),
            seconds: self.begun.elapsed().as_secs_f64(),
            stale: false,
            settings: self.settings.clone(),
            version: 0,
            ..ResultRecord::default()
        }
    }
}

/// Returns the tracker's request for these settings.
pub fn track_request(
    project: &Project,
    store: &Arc<FrameStore>,
    settings: &TrackSettings,
) -> Result<TrackRequest> {
    let last = project.frames.len().saturating_sub(1);
    let (from, to) = (settings.from.unwrap_or(0), settings.to.unwrap_or(last));
    project.frame(from)?;
    project.frame(to)?;
    ensure!(
        from <= to,
        "frame {from} comes after frame {to}; give the earlier one first"
    );
    settings
        .labels
        .iter()
        .try_for_each(|&id| label_name(project, id).map(drop))?;
    let keyframes = project
        .masks
        .iter()
        .filter(|(_, mask)| mask.origin == MaskOrigin::Keyframe);
    let keyframes: BTreeMap<_, _> = keyframes
        .map(|(&frame, mask)| (frame, Arc::new(mask.runs.decode())))
        .collect();
    if keyframes.is_empty() {
        bail!("no frame has a mask to track; prompt or paint one first");
    }
    ensure!(
        (from..=to).any(|frame| !keyframes.contains_key(&frame)),
        "every frame from {from} to {to} is a keyframe, which no tracker changes: there is nothing to track"
    );
    let (frames, store) = (Arc::clone(&project.frames), Arc::clone(store));
    let labels = LabelChoice::new(&settings.labels, settings.replace)
        .labels()
        .cloned();
    Ok(TrackRequest {
        frames,
        store,
        keyframes,
        from,
        to,
        direction: settings.direction,
        labels,
    })
}

/// Converts a tracker's result to the form of a project.
pub fn transferred(tracked: TrackedFrame) -> (usize, FrameMask) {
    let TrackedFrame {
        frame,
        mask,
        confidence,
        ..
    } = tracked;
    let runs = Arc::new(RunMask::encode(&mask));
    (
        frame,
        FrameMask {
            runs,
            origin: MaskOrigin::Tracked,
            stale: false,
            confidence,
        },
    )
}

/// Returns whether the keyframes differ from those that a run started from.
pub(crate) fn keyframes_differ(before: &Project, now: &Project) -> bool {
    let keyframes = |project: &Project| -> Vec<_> {
        let keyframes = project
            .masks
            .iter()
            .filter(|(_, mask)| mask.origin == MaskOrigin::Keyframe);
        keyframes
            .map(|(&frame, mask)| (frame, Arc::clone(&mask.runs)))
            .collect()
    };
    keyframes(before) != keyframes(now)
}

/// Returns the names of the labels to track; empty means all.
pub(crate) fn only_labels(project: &Project, settings: &TrackSettings) -> String {
    let names = settings
        .labels
        .iter()
        .filter_map(|&id| project.labels.get(id))
        .map(|label| label.name.as_str());
    names.collect::<Vec<_>>().join(", ")
}

pub(crate) fn describe(settings: &TrackSettings, only: &str) -> String {
    let mut words = vec![format!("{:?}", settings.direction).to_lowercase()];
    words.extend(settings.from.map(|frame| format!("from {frame}")));
    words.extend(settings.to.map(|frame| format!("to {frame}")));
    words.extend(settings.constrain.then(|| "constrained".to_owned()));
    words.extend((!only.is_empty()).then(|| format!("only {only}")));
    words.extend(
        settings
            .pause_below
            .map(|least| format!("pausing below {least}")),
    );
    words.extend(
        settings
            .short_side
            .map(|side| format!("seen with {side} px")),
    );
    words.extend(settings.replace.then(|| "over other labels".to_owned()));
    words.join(", ")
}
