//! Helpers that run a session's commands to their end.

use std::ops::ControlFlow;

use ostra_session::{Command, Event, Session};

use crate::program::contents;

/// Runs a command to its end and returns its events.
pub fn perform(session: &mut Session, command: Command) -> anyhow::Result<Vec<Event>> {
    session.act(command)?;
    let events = session.settle(|_| ControlFlow::Continue(()));
    for event in &events {
        if let Event::Failed { error, .. } = event {
            anyhow::bail!("{error}");
        }
    }
    Ok(events)
}

/// Saves the session and returns the bytes of every file of masks, cloud, votes and mesh.
pub fn shown_bytes(session: &mut Session) -> Vec<Vec<u8>> {
    session.save().unwrap();
    let root = session.root().unwrap().to_owned();
    let mut bytes: Vec<Vec<u8>> = contents(&root.join("masks"))
        .into_iter()
        .map(|(_, bytes)| bytes)
        .collect();
    bytes.extend(
        ["cloud.ply", "votes.bin", "mesh.ply"].map(|name| std::fs::read(root.join(name)).unwrap()),
    );
    bytes
}
