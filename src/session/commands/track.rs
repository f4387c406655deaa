use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Result, bail, ensure};

use super::paint::label_name;
use crate::Event;
use crate::{Kind, Landing};
use crate::{Session, TrackSettings, engines};
use ostra_core::job::JobId;
use ostra_frames::FrameStore;
use ostra_masks::{LabelId, RunMask, TrackRequest, TrackedFrame};
use ostra_project::{Edit, FrameMask, LabelChoice, MaskOrigin, Project, ResultKind, ResultRecord};

/// Tracked frames are gathered this long before they are saved together.
const GATHERED: Duration = Duration::from_millis(300);

/// A tracking run whose frames arrive one by one.
pub struct TrackRun {
    job: JobId,
    engine: &'static str,
    title: String,
    settings: String,
    /// What of its frames is taken.
    choice: LabelChoice,
    begun: Instant,
    /// What it was given.
    made_from: Arc<Project>,
    /// Frames done so far.
    done: BTreeSet<usize>,
    waiting: Vec<(usize, FrameMask)>,
    saved: Instant,
    /// Confidence below which it ends by itself.
    pause_below: Option<f32>,
    doubt: Option<Doubt>,
}

/// The frame at which a run ended by itself, and the label it was least sure of.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Doubt {
    frame: usize,
    label: LabelId,
    sure: f32,
}

impl Session {
    pub(crate) fn track(&mut self, settings: &TrackSettings) -> Result<JobId> {
        self.check_no_long_job()?;
        let project = self.snapshot()?;
        let request = track_request(&project, &self.store, settings)?;
        let tracker = engines::tracker(settings, &project)?;
        if settings.tracker == "auto" {
            self.events
                .push(Event::Notice(format!("tracker: {}", tracker.name())));
        }
        let engine = tracker.name();
        let job = self.start("Track", Kind::Long, move |link| {
            link.progress.stage("track")?;
            let mut emit = |tracked: TrackedFrame| {
                let preliminary = tracked.preliminary;
                let (frame, mask) = carried(tracked);
                // Where nobody takes it any more, the tracker notices the stop by itself.
                let _ = link.send(move |session| session.gather(frame, mask, preliminary));
            };
            let warnings = tracker.track(&request, &mut emit, &link.progress)?;
            Ok(Box::new(move |session: &mut Self| {
                session.warn_all(warnings);
                Ok(())
            }) as Landing)
        });
        let only = only_labels(&project, settings);
        self.track = Some(TrackRun {
            job,
            engine,
            title: if only.is_empty() {
                format!("Track with {engine}")
            } else {
                format!("Track {only} with {engine}")
            },
            settings: describe(settings, &only),
            choice: LabelChoice::new(&settings.labels, settings.replace),
            begun: Instant::now(),
            made_from: project,
            done: BTreeSet::new(),
            waiting: Vec::new(),
            saved: Instant::now(),
            pause_below: settings.pause_below,
            doubt: None,
        });
        Ok(job)
    }

    fn gather(&mut self, frame: usize, mask: FrameMask, preliminary: bool) -> Result<()> {
        let project = self.snapshot()?;
        if let Some(run) = self.track.as_mut().filter(|run| run.doubt.is_none()) {
            run.doubt = if preliminary {
                None
            } else {
                run.doubts(&project, frame, &mask)
            };
            run.done.insert(frame);
            run.waiting.push((frame, mask));
            if run.doubt.is_some() {
                let job = run.job;
                self.stop(job);
            }
        }
        self.save_tracked(false)
    }

    /// What is told of a run that ended by itself.
    pub(crate) fn paused(&self, job: JobId) -> Option<Event> {
        let Doubt { frame, label, sure } =
            self.track.as_ref().filter(|run| run.is_of(job))?.doubt?;
        let name = label_name(self.project()?, label).ok()?;
        let text = format!(
            "tracking paused at frame {frame}: '{name}' is {:.0} % sure; correct the frame or make it an anchor, then track on from there",
            sure * 100.0
        );
        Some(Event::Paused {
            job,
            frame,
            label,
            text,
        })
    }

    /// Makes the gathered frames part of the run's step: from time to time, and `at_end` the rest.
    pub(crate) fn save_tracked(&mut self, at_end: bool) -> Result<()> {
        let Some(run) = self
            .track
            .as_mut()
            .filter(|run| at_end || run.saved.elapsed() >= GATHERED)
        else {
            return Ok(());
        };
        run.saved = Instant::now();
        if run.waiting.is_empty() {
            return Ok(());
        }
        let waiting = std::mem::take(&mut run.waiting);
        let (job, made_from) = (run.job, Arc::clone(&run.made_from));
        let (mut record, title, choice) = (run.record(), run.title.clone(), run.choice.clone());
        let now = self.snapshot()?;
        let outdated = anchors_differ(&made_from, &now);
        let marked = |mask: FrameMask| FrameMask {
            stale: outdated,
            ..mask
        };
        let edits = waiting
            .into_iter()
            .filter_map(|(frame, mask)| choice.edit(&now, frame, marked(mask)));
        let mut edits: Vec<Edit> = edits.collect();
        let fresh: BTreeSet<usize> = edits.iter().filter_map(Edit::masked_frame).collect();
        let old = now
            .masks
            .iter()
            .any(|(frame, mask)| mask.stale && !fresh.contains(frame));
        record.stale = outdated || old;
        edits.push(Edit::SetResult {
            kind: ResultKind::Tracking,
            record: Some(record),
        });
        if self.opened()?.commit_part(&title, edits, job)? {
            self.tell_changed();
        }
        Ok(())
    }

    /// Saves what a run brought, and forgets the run: its job ended.
    pub(crate) fn end_track(&mut self, job: JobId) -> Result<()> {
        if self.track.as_ref().is_none_or(|run| !run.is_of(job)) {
            return Ok(());
        }
        let saved = self.save_tracked(true);
        self.track = None;
        saved
    }
}

impl TrackRun {
    /// Whether this is the run of that job.
    pub(crate) fn is_of(&self, job: JobId) -> bool {
        self.job == job
    }

    /// The label of a frame that the run is least sure of, where that is not sure enough.
    fn doubts(&self, project: &Project, frame: usize, mask: &FrameMask) -> Option<Doubt> {
        let barred = &project.absent_on(frame) | &project.locked_on(frame);
        let is_chosen = |label: &LabelId| {
            self.choice
                .labels()
                .is_none_or(|labels| labels.contains(label))
        };
        let is_meant = |label: &LabelId| is_chosen(label) && !barred.contains(label);
        let meant = mask.confidence.iter().filter(|(label, _)| is_meant(label));
        let (&label, &sure) = meant.min_by(|a, b| a.1.total_cmp(b.1))?;
        (sure < self.pause_below?).then_some(Doubt { frame, label, sure })
    }

    fn record(&self) -> ResultRecord {
        ResultRecord {
            engine: self.engine.to_owned(),
            frames: self.done.len(),
            seconds: self.begun.elapsed().as_secs_f64(),
            stale: false,
            settings: self.settings.clone(),
            version: 0,
            ..ResultRecord::default()
        }
    }
}

/// What a tracker is given for these settings.
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
    let anchors = project
        .masks
        .iter()
        .filter(|(_, mask)| mask.origin == MaskOrigin::Anchor);
    let anchors: BTreeMap<_, _> = anchors
        .map(|(&frame, mask)| (frame, Arc::new(mask.runs.decode())))
        .collect();
    if anchors.is_empty() {
        bail!("no frame has a mask to carry; prompt or paint one first");
    }
    let (frames, store) = (Arc::clone(&project.frames), Arc::clone(store));
    let labels = LabelChoice::new(&settings.labels, settings.replace)
        .labels()
        .cloned();
    Ok(TrackRequest {
        frames,
        store,
        anchors,
        from,
        to,
        direction: settings.direction,
        labels,
    })
}

/// A tracker's answer as a project holds it.
pub fn carried(tracked: TrackedFrame) -> (usize, FrameMask) {
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

/// Whether the anchors are no longer those that a run was given.
fn anchors_differ(before: &Project, now: &Project) -> bool {
    let anchors = |project: &Project| -> Vec<_> {
        let anchors = project
            .masks
            .iter()
            .filter(|(_, mask)| mask.origin == MaskOrigin::Anchor);
        anchors
            .map(|(&frame, mask)| (frame, Arc::clone(&mask.runs)))
            .collect()
    };
    anchors(before) != anchors(now)
}

/// Names of the labels that alone are tracked; empty = all.
fn only_labels(project: &Project, settings: &TrackSettings) -> String {
    let names = settings
        .labels
        .iter()
        .filter_map(|&id| project.labels.get(id))
        .map(|label| label.name.as_str());
    names.collect::<Vec<_>>().join(", ")
}

fn describe(settings: &TrackSettings, only: &str) -> String {
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

#[cfg(test)]
mod tests;
