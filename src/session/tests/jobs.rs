use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::making::{frame, perform};
use crate::Event;
use crate::Session;
use crate::{JobCompletion, JobKind, jobs::JobContext};
use ostra_project::OpenProject;
use ostra_project::{Edit, Project};

fn opened(folder: &tempfile::TempDir) -> Session {
    let mut session = Session::new();
    session.open = Some(OpenProject::create(&folder.path().join("p"), Project::default()).unwrap());
    session
}

fn settle(session: &mut Session) -> Vec<Event> {
    session.settle(|_| ControlFlow::Continue(()))
}

fn add(name: &str) -> impl FnOnce(&mut Session) -> anyhow::Result<()> + Send + use<> {
    let frames = vec![frame(name)];
    move |session| session.commit("Add", vec![Edit::AddFrames { frames }])
}

fn count(session: &Session) -> usize {
    session.project().unwrap().frames.len()
}

#[test]
fn panic_in_a_job_is_reported_as_its_failure() {
    let mut session = Session::new();
    let job = session.start("Break", JobKind::Long, |_| panic!("index 7 is out"));
    let events = settle(&mut session);
    assert_eq!(
        events[0],
        Event::Started {
            job,
            title: "Break".into()
        }
    );
    let Event::Failed { error, .. } = &events[1] else {
        panic!("{events:?}")
    };
    assert!(error.contains("index 7 is out"), "{error}");
    assert!(session.jobs().is_empty());
}

#[test]
fn partial_results_are_applied_before_the_end() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(&folder);
    let woken = Arc::new(AtomicUsize::new(0));
    let wake = Arc::clone(&woken);
    session.set_waker(move || {
        wake.fetch_add(1, Ordering::Relaxed);
    });
    let work = |context: &JobContext<Session>| {
        for k in 0..200 {
            context.send(add(&k.to_string()))?;
        }
        Ok(Box::new(add("last")) as JobCompletion)
    };
    session.start("Many", JobKind::Long, work);
    let events = settle(&mut session);
    assert!(
        matches!(events.last(), Some(Event::Finished { .. })),
        "{events:?}"
    );
    assert_eq!(
        session.project().unwrap().frames.last().unwrap().name,
        "last"
    );
    assert_eq!(count(&session), 201);
    assert!(woken.load(Ordering::Relaxed) >= 201);
}

#[test]
fn stopped_job_keeps_its_partial_results() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(&folder);
    let work = |context: &JobContext<Session>| {
        context.send(add("piece"))?;
        loop {
            context.progress.step(1, 2)?;
        }
    };
    session.start("Endless", JobKind::Long, work);
    assert!(
        session
            .check_no_long_job()
            .unwrap_err()
            .to_string()
            .contains("'Endless' is still running")
    );
    let stop = |jobs: &[crate::JobView]| match jobs[0].report.done {
        0 => ControlFlow::Continue(()),
        _ => ControlFlow::Break(()),
    };
    let events = session.settle(stop);
    assert!(
        matches!(events.last(), Some(Event::Stopped { .. })),
        "{events:?}"
    );
    assert_eq!(count(&session), 1);
}

#[test]
fn rejected_partial_result_ends_the_job() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(&folder);
    let work = |context: &JobContext<Session>| {
        context.send(add("twice"))?;
        context.send(add("twice"))?;
        loop {
            context.progress.check()?;
        }
    };
    session.start("Refused", JobKind::Long, work);
    let events = settle(&mut session);
    let failed = events.iter().find_map(|event| match event {
        Event::Failed { error, .. } => Some(error.as_str()),
        _ => None,
    });
    assert_eq!(
        failed,
        Some("there is already a frame 'twice'; leave it out"),
        "{events:?}"
    );
    assert_eq!(count(&session), 1);
}

#[test]
fn results_for_a_closed_project_are_dropped() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(&folder);
    let root = session.root().unwrap().to_owned();
    session.start("Late", JobKind::Long, |_| {
        Ok(Box::new(add("late")) as JobCompletion)
    });
    perform(&mut session, crate::Command::Close).unwrap();
    perform(&mut session, crate::Command::Open(root)).unwrap();
    assert_eq!(count(&session), 0);
}
