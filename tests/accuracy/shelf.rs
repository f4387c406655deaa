//! The shelf recording, as commands of a session.

use std::path::Path;

use ostra_frames::{FrameFolder, OpenRequest};
use ostra_session::{Command, NewProject, TrackSettings};

pub fn new_project(data: &Path, root: &Path) -> Command {
    let shelf = data.join("apc_shelf_rgbd_labels");
    let sources = vec![FrameFolder {
        frames: shelf.join("color"),
        depth: Some(shelf.join("depth")),
    }];
    let open = OpenRequest {
        sources,
        ..OpenRequest::default()
    };
    Command::New(NewProject {
        root: root.into(),
        open,
        cameras: Some(shelf.join("sparse")),
        intrinsics: None,
    })
}

pub fn track() -> Command {
    Command::Track(TrackSettings::default())
}
