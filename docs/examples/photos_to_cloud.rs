//! Computes cameras and depth maps of photos and fuses them into a cloud.
//!
//! `cargo run --release --example photos_to_cloud -- FOLDER PROJECT CLOUD.ply`

#![expect(clippy::print_stderr, reason = "an example reports on the terminal")]

use std::error::Error;
use std::ops::ControlFlow;
use std::path::PathBuf;

use ostra_frames::{FrameFolder, OpenRequest};
use ostra_project::{ExportRequest, FuseRequest, ReconstructMethod, ReconstructRequest};
use ostra_session::{Command, Event, NewProject, Session};

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [photos, project, cloud] = &args[..] else {
        return Err("usage: photos_to_cloud FOLDER PROJECT CLOUD.ply".into());
    };
    let commands = [
        Command::New(NewProject {
            root: project.clone(),
            open: OpenRequest {
                sources: vec![FrameFolder::from(photos.clone())],
                ..OpenRequest::default()
            },
            cameras: None,
            intrinsics: None,
        }),
        Command::Reconstruct(ReconstructRequest {
            method: ReconstructMethod::Mvs,
            max_side: Some(640),
            ..ReconstructRequest::default()
        }),
        Command::Fuse(FuseRequest::default()),
        Command::Export(ExportRequest {
            cloud: Some(cloud.clone()),
            ..ExportRequest::default()
        }),
    ];
    let mut session = Session::new();
    for command in commands {
        run(&mut session, command)?;
    }
    Ok(())
}

/// Executes a command and waits for its job; prints what it reports.
fn run(session: &mut Session, command: Command) -> Result<(), Box<dyn Error>> {
    session.act(command)?;
    for event in session.settle(|_| ControlFlow::Continue(())) {
        match event {
            Event::Notice(text) | Event::Warning(text) => eprintln!("{text}"),
            Event::Failed { error, .. } => return Err(error.into()),
            _ => {}
        }
    }
    Ok(())
}
