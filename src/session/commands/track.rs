use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Result, bail, ensure};

use crate::masks::{RunMask, TrackRequest, TrackedFrame};
use crate::session::jobs::{Kind, Landing};
use crate::session::{
    Edit, Event, FrameMask, JobId, MaskOrigin, Project, ResultKind, ResultRecord, Session, TrackSettings, engines,
};

/// Tracked frames are gathered this long before they are saved together.
const GATHERED: Duration = Duration::from_millis(300);

/// A tracking run whose frames arrive one by one.
pub(in crate::session) struct TrackRun {
    job: JobId,
    engine: &'static str,
    settings: String,
    begun: Instant,
    /// What it was given.
    made_from: Arc<Project>,
    /// Frames done so far.
    done: usize,
    waiting: Vec<(usize, FrameMask)>,
    saved: Instant,
}

impl Session {
    pub(in crate::session) fn track(&mut self, settings: &TrackSettings) -> Result<JobId> {
        self.check_no_long_job()?;
        let project = self.snapshot()?;
        let request = self.track_request(&project, settings)?;
        let tracker = engines::tracker(settings, &project)?;
        if settings.tracker == "auto" {
            self.events.push(Event::Notice(format!("tracker: {}", tracker.name())));
        }
        let engine = tracker.name();
        let job = self.start("Track", Kind::Long, move |link| {
            link.progress.stage("track")?;
            let mut emit = |tracked: TrackedFrame| {
                let runs = Arc::new(RunMask::encode(&tracked.mask));
                let TrackedFrame { frame, confidence, .. } = tracked;
                let mask = FrameMask { runs, origin: MaskOrigin::Tracked, stale: false, confidence };
                // Where nobody takes it any more, the tracker notices the stop by itself.
                let _ = link.send(move |session| session.gather(frame, mask));
            };
            let warnings = tracker.track(&request, &mut emit, &link.progress)?;
            Ok(Box::new(move |session: &mut Self| {
                session.warn_all(warnings);
                Ok(())
            }) as Landing)
        });
        self.track = Some(TrackRun {
            job,
            engine,
            settings: describe(settings),
            begun: Instant::now(),
            made_from: project,
            done: 0,
            waiting: Vec::new(),
            saved: Instant::now(),
        });
        Ok(job)
    }

    fn track_request(&self, project: &Project, settings: &TrackSettings) -> Result<TrackRequest> {
        let last = project.frames.len().saturating_sub(1);
        let (from, to) = (settings.from.unwrap_or(0), settings.to.unwrap_or(last));
        project.frame(from)?;
        project.frame(to)?;
        ensure!(from <= to, "frame {from} comes after frame {to}; give the earlier one first");
        let anchors = project.masks.iter().filter(|(_, mask)| mask.origin == MaskOrigin::Anchor);
        let anchors: BTreeMap<_, _> = anchors.map(|(&frame, mask)| (frame, Arc::new(mask.runs.decode()))).collect();
        if anchors.is_empty() {
            bail!("no frame has a mask to carry; prompt or paint one first");
        }
        let (frames, store) = (Arc::clone(&project.frames), Arc::clone(&self.store));
        Ok(TrackRequest { frames, store, anchors, from, to, direction: settings.direction })
    }

    fn gather(&mut self, frame: usize, mask: FrameMask) -> Result<()> {
        if let Some(run) = &mut self.track {
            run.done += 1;
            run.waiting.push((frame, mask));
        }
        self.save_tracked(false)
    }

    /// Makes the gathered frames part of the run's step: from time to time, and `at_end` the rest.
    pub(in crate::session) fn save_tracked(&mut self, at_end: bool) -> Result<()> {
        let Some(run) = self.track.as_mut().filter(|run| at_end || run.saved.elapsed() >= GATHERED) else {
            return Ok(());
        };
        run.saved = Instant::now();
        if run.waiting.is_empty() {
            return Ok(());
        }
        let waiting = std::mem::take(&mut run.waiting);
        let (job, made_from) = (run.job, Arc::clone(&run.made_from));
        let (mut record, title) = (run.record(), format!("Track with {}", run.engine));
        let now = self.snapshot()?;
        let outdated = anchors_differ(&made_from, &now);
        let edits = waiting.into_iter().filter_map(|(frame, mask)| carried(&now, frame, mask, outdated));
        let mut edits: Vec<Edit> = edits.collect();
        let fresh: std::collections::BTreeSet<usize> = edits.iter().filter_map(frame_of).collect();
        let old = now.masks.iter().any(|(frame, mask)| mask.stale && !fresh.contains(frame));
        record.stale = outdated || old;
        edits.push(Edit::SetResult { kind: ResultKind::Tracking, record: Some(record) });
        if self.opened()?.commit_part(&title, edits, job)? {
            self.tell_changed();
        }
        Ok(())
    }

    /// Saves what a run brought, and forgets the run: its job ended.
    pub(in crate::session) fn end_track(&mut self, job: JobId) -> Result<()> {
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
    pub(in crate::session) fn is_of(&self, job: JobId) -> bool {
        self.job == job
    }

    fn record(&self) -> ResultRecord {
        ResultRecord {
            engine: self.engine.to_owned(),
            frames: self.done,
            seconds: self.begun.elapsed().as_secs_f64(),
            stale: false,
            settings: self.settings.clone(),
            version: 0,
        }
    }
}

/// The edit that gives a frame its carried mask: none for an anchor, which no tracker overwrites, for a frame that is
/// gone, or for labels that are gone.
fn carried(project: &Project, frame: usize, mask: FrameMask, outdated: bool) -> Option<Edit> {
    let before = project.masks.get(&frame);
    let is_anchor = before.is_some_and(|mask| mask.origin == MaskOrigin::Anchor);
    let fits = project.frames.get(frame).is_some_and(|of| (of.width, of.height) == (mask.runs.width, mask.runs.height));
    let known = |id| id == crate::masks::LabelId::NONE || project.labels.get(id).is_some();
    let known = mask.runs.runs.iter().all(|&(id, _)| known(id));
    let mask = FrameMask { stale: outdated, ..mask };
    (!is_anchor && fits && known).then_some(Edit::SetMask { frame, mask: Some(mask) })
}

fn frame_of(edit: &Edit) -> Option<usize> {
    match edit {
        Edit::SetMask { frame, .. } => Some(*frame),
        _ => None,
    }
}

/// Whether the anchors are no longer those that a run was given.
fn anchors_differ(before: &Project, now: &Project) -> bool {
    let anchors = |project: &Project| -> Vec<_> {
        let anchors = project.masks.iter().filter(|(_, mask)| mask.origin == MaskOrigin::Anchor);
        anchors.map(|(&frame, mask)| (frame, Arc::clone(&mask.runs))).collect()
    };
    anchors(before) != anchors(now)
}

fn describe(settings: &TrackSettings) -> String {
    let mut words = vec![format!("{:?}", settings.direction).to_lowercase()];
    words.extend(settings.from.map(|frame| format!("from {frame}")));
    words.extend(settings.to.map(|frame| format!("to {frame}")));
    words.extend(settings.constrain.then(|| "constrained".to_owned()));
    words.join(", ")
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::session::tests::making::{anchor, project, record, tracked};
    use crate::session::{JobId, OpenProject};

    /// A session with a run whose frames the test brings.
    fn running(folder: &tempfile::TempDir, project: Project) -> Session {
        let mut session = Session::new();
        session.open = Some(OpenProject::create(&folder.path().join("p"), project).unwrap());
        session.track = Some(TrackRun {
            job: JobId(1),
            engine: "flow",
            settings: String::new(),
            begun: Instant::now(),
            made_from: session.snapshot().unwrap(),
            done: 0,
            waiting: Vec::new(),
            saved: Instant::now(),
        });
        session
    }

    fn stale(session: &Session, frame: usize) -> bool {
        session.project().unwrap().masks[&frame].stale
    }

    #[test]
    fn what_is_carried_from_anchors_that_changed_meanwhile_is_stale() {
        let folder = tempfile::tempdir().unwrap();
        let mut start = project();
        start.apply(Edit::SetMask { frame: 0, mask: Some(anchor([1, 0, 0])) }).unwrap();
        start.apply(Edit::SetResult { kind: ResultKind::Cloud, record: Some(record("fuse")) }).unwrap();
        let mut session = running(&folder, start.clone());
        session.gather(1, tracked([1, 0, 0])).unwrap();
        session.save_tracked(true).unwrap();
        assert!(!stale(&session, 1));
        session.commit("Paint", vec![Edit::SetMask { frame: 3, mask: Some(anchor([2, 2, 2])) }]).unwrap();
        assert!(stale(&session, 1));
        for frame in [2, 3, 4] {
            session.gather(frame, tracked([1, 1, 0])).unwrap();
        }
        session.end_track(JobId(1)).unwrap();
        assert!(stale(&session, 2) && stale(&session, 4));
        assert_eq!(session.project().unwrap().masks[&3], anchor([2, 2, 2]), "the new anchor stands");
        assert!(session.project().unwrap().results[&ResultKind::Tracking].stale);
        for title in ["Track with flow", "Paint", "Track with flow"] {
            assert_eq!(session.undo_title(), Some(title));
            session.undo().unwrap();
        }
        assert_eq!(**session.project().unwrap(), start);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]

        #[test]
        fn anchors_stay_under_tracking(
            anchors in proptest::collection::btree_set(0usize..5, 0..5),
            brought in proptest::collection::vec((0usize..7, 0u16..4), 0..12),
        ) {
            let folder = tempfile::tempdir().unwrap();
            let mut start = project();
            for &frame in &anchors {
                start.apply(Edit::SetMask { frame, mask: Some(anchor([1, 2, 0])) }).unwrap();
            }
            let mut session = running(&folder, start);
            for (frame, id) in brought {
                session.gather(frame, tracked([id, 0, 1])).unwrap();
            }
            session.end_track(JobId(1)).unwrap();
            let project = session.project().unwrap();
            for frame in &anchors {
                prop_assert_eq!(&project.masks[frame], &anchor([1, 2, 0]));
            }
            let tracked = project.masks.iter().filter(|(frame, _)| !anchors.contains(frame));
            prop_assert!(tracked.into_iter().all(|(_, mask)| mask.origin == MaskOrigin::Tracked));
        }
    }
}
