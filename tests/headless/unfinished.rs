//! Tests that a killed or stopped reconstruction can be continued with the options that it had.

use std::ops::ControlFlow;
use std::path::Path;
use std::process::{Command as Process, Stdio};

use ostra_project::{ReconstructMethod, ReconstructRequest};
use ostra_session::{Command, Event, Session, Unfinished};

use super::scale::Photos;
use crate::program::done;
use crate::session::perform;

/// Starts a reconstruction in another process and kills it while it runs.
///
/// Returns `false` if it ended before.
fn kill_reconstruction(project: &str) -> bool {
    let mut child = Process::new(env!("CARGO_BIN_EXE_ostra"))
        .args(["reconstruct", project, "--method", "sfm"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut has_ended = false;
    while !has_ended && Unfinished::read(Path::new(project)).is_none() {
        has_ended = child.try_wait().unwrap().is_some();
        std::thread::yield_now();
    }
    child.kill().unwrap();
    !child.wait().unwrap().success()
}

#[test]
fn killed_reconstruction_is_offered_on_opening_and_continued() {
    let photos = Photos::new(5);
    let project = photos.project("project", &[]);
    assert!(
        (0..5).any(|_| kill_reconstruction(&project)),
        "it ended before it could be killed"
    );
    let info = done(&["info", &project]);
    assert!(info.contains("reconstruction not finished"), "{info}");
    let mut session = Session::new();
    perform(&mut session, Command::Open(project.clone().into())).unwrap();
    let unfinished = session.unfinished().cloned().expect("an offer");
    let Command::Reconstruct(request) = &unfinished.command else {
        panic!("{unfinished:?}");
    };
    assert_eq!(request.method, ReconstructMethod::Sfm);
    perform(&mut session, unfinished.command).unwrap();
    assert_eq!(session.unfinished(), None);
    drop(session);
    assert_eq!(Unfinished::read(Path::new(&project)), None);
    assert!(!done(&["info", &project]).contains("not finished"));
}

#[test]
fn stopped_reconstruction_is_offered_until_it_is_dismissed() {
    let photos = Photos::new(4);
    let project = photos.project("project", &[]);
    let mut session = Session::new();
    perform(&mut session, Command::Open(project.clone().into())).unwrap();
    let request = ReconstructRequest {
        method: ReconstructMethod::Sfm,
        max_side: Some(200),
        ..ReconstructRequest::default()
    };
    let command = Command::Reconstruct(request);
    session.act(command.clone()).unwrap();
    let events = session.settle(|_| ControlFlow::Break(()));
    assert!(
        events
            .iter()
            .any(|event| matches!(event, Event::Stopped { .. })),
        "{events:?}"
    );
    assert_eq!(session.unfinished().unwrap().command, command);
    // Another session finds it, too.
    drop(session);
    let mut session = Session::new();
    perform(&mut session, Command::Open(project.clone().into())).unwrap();
    assert_eq!(session.unfinished().unwrap().command, command);
    session.dismiss_unfinished();
    assert_eq!(session.unfinished(), None);
    assert_eq!(Unfinished::read(Path::new(&project)), None);
}
