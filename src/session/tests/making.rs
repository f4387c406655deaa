//! Small projects and their parts for tests.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

pub use ostra_project::testing::*;

use crate::{Command, Event, Session};

/// Writes three small images and returns their folder.
pub fn images(folder: &Path) -> PathBuf {
    let place = folder.join("pictures");
    std::fs::create_dir_all(&place).unwrap();
    for k in 0..3u8 {
        let image = image::RgbImage::from_fn(64, 48, |x, _| {
            image::Rgb(if (20..40).contains(&x) {
                [200, 40, 40]
            } else {
                [30, 60 + k, 90]
            })
        });
        image.save(place.join(format!("{k}.png"))).unwrap();
    }
    place
}

/// Executes a command to its end; a failure of its job is an error.
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
