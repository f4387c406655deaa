//! Labels the points of an existing cloud by a vote of masks from all views.
//!
//! `cargo run --release --example vote_onto_cloud -- IMAGES CAMERAS MASKS CLOUD.ply PROJECT LABELLED.ply`
//!
//! CAMERAS is a COLMAP model or another known file of cameras in the coordinates of the cloud.
//! MASKS is a folder of palette PNGs (DAVIS) with the names of the images.

#![expect(clippy::print_stderr, reason = "an example reports on the terminal")]

use std::error::Error;
use std::ops::ControlFlow;
use std::path::PathBuf;

use ostra_frames::{FrameFolder, OpenRequest};
use ostra_project::{ExportRequest, FuseRequest};
use ostra_session::{Command, Event, NewProject, Session};

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [images, cameras, masks, cloud, project, labelled] = &args[..] else {
        return Err("usage: vote_onto_cloud IMAGES CAMERAS MASKS CLOUD PROJECT LABELLED".into());
    };
    let commands = [
        Command::New(NewProject {
            root: project.clone(),
            open: OpenRequest {
                sources: vec![FrameFolder::from(images.clone())],
                ..OpenRequest::default()
            },
            cameras: Some(cameras.clone()),
            intrinsics: None,
        }),
        Command::ImportMasks {
            dir: masks.clone(),
            format: ostra_masks::MaskFormat::Davis,
        },
        Command::Fuse(FuseRequest {
            onto: Some(cloud.clone()),
            ..FuseRequest::default()
        }),
        Command::Export(ExportRequest {
            cloud: Some(labelled.clone()),
            ..ExportRequest::default()
        }),
    ];
    let mut session = Session::new();
    for command in commands {
        session.act(command)?;
        for event in session.settle(|_| ControlFlow::Continue(())) {
            match event {
                Event::Notice(text) | Event::Warning(text) => eprintln!("{text}"),
                Event::Failed { error, .. } => return Err(error.into()),
                _ => {}
            }
        }
    }
    Ok(())
}
