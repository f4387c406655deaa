use crate::job_task::JobTask;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Result;

use crate::Event;
use crate::track_run::{
    Pause, TrackRun, describe, keyframes_differ, only_labels, track_request, transferred,
};
use crate::{JobCompletion, JobKind};
use crate::{Session, TrackSettings, engines};
use ostra_core::job::{JobId, PlannedStage};
use ostra_masks::TrackedFrame;
use ostra_project::LabelChoice;
use ostra_project::mask_edits::label_name;
use ostra_project::{Edit, FrameMask, ResultKind, TrackerId};

/// Time for which tracked frames are collected before they are saved together.
const GATHERED: Duration = Duration::from_millis(300);

impl Session {
    pub(crate) fn track(&mut self, settings: &TrackSettings) -> Result<JobId> {
        self.check_no_long_job()?;
        let project = self.snapshot()?;
        let request = track_request(&project, &self.store, settings)?;
        let tracker = engines::tracker(settings, &project)?;
        if settings.tracker == TrackerId::Auto {
            let without = engines::frames_without_stereo_depth(&project);
            let why = if without > 0 {
                format!(
                    " ({without} of {} frames have no depth map; 'geometry' is taken once all have one)",
                    project.frames.len()
                )
            } else {
                String::new()
            };
            self.events
                .push(Event::Notice(format!("tracker: {}{why}", tracker.name())));
        }
        let engine = tracker.name();
        let job = self.start(JobTask::Track, JobKind::Long, move |context| {
            let stages = [PlannedStage::new("track", "Track masks", 1.0)];
            context.progress.plan(&stages);
            context.progress.stage("track")?;
            let mut emit = |tracked: TrackedFrame| {
                let preliminary = tracked.preliminary;
                let (frame, mask) = transferred(tracked);
                // If the frame is no longer accepted, the tracker notices the stop itself.
                let _ = context.send(move |session| session.gather(frame, mask, preliminary));
            };
            let warnings = tracker.track(&request, &mut emit, &context.progress)?;
            Ok(Box::new(move |session: &mut Self| {
                session.warn_all(warnings);
                Ok(())
            }) as JobCompletion)
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
            pause: None,
        });
        Ok(job)
    }

    fn gather(&mut self, frame: usize, mask: FrameMask, preliminary: bool) -> Result<()> {
        let project = self.snapshot()?;
        if let Some(run) = self.track.as_mut().filter(|run| run.pause.is_none()) {
            run.pause = if preliminary {
                None
            } else {
                run.pause_at(&project, frame, &mask)
            };
            run.done.insert(frame);
            run.waiting.push((frame, mask));
            if run.pause.is_some() {
                let job = run.job;
                self.jobs.stop(job);
            }
        }
        self.save_tracked(false)
    }

    /// Returns the event for a run that paused itself.
    pub(crate) fn paused(&self, job: JobId) -> Option<Event> {
        let Pause {
            frame,
            label,
            confidence,
        } = self.track.as_ref().filter(|run| run.is_of(job))?.pause?;
        let name = label_name(self.project()?, label).ok()?;
        let text = format!(
            "tracking paused at frame {frame}: '{name}' has {:.0} % confidence; correct the frame or make it a keyframe, then track on from there",
            confidence * 100.0
        );
        Some(Event::Paused {
            job,
            frame,
            label,
            text,
        })
    }

    /// Adds the collected frames to the run's step.
    ///
    /// This happens at intervals, and with `at_end` for all remaining frames.
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
        let outdated = keyframes_differ(&made_from, &now);
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
            self.report_changed();
        }
        Ok(())
    }

    /// Saves the remaining frames of a run whose job ended, and forgets the run.
    pub(crate) fn end_track(&mut self, job: JobId) -> Result<()> {
        if self.track.as_ref().is_none_or(|run| !run.is_of(job)) {
            return Ok(());
        }
        let saved = self.save_tracked(true);
        self.track = None;
        saved
    }
}

#[cfg(test)]
mod tests;
