//! A session that is driven to the end of each command.

use std::ops::ControlFlow;

use ostra_session::{Command, Event, Session};

use crate::program::contents;

/// Carries out a command to its end.
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

/// Every file of masks, cloud, votes and mesh, saved.
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
