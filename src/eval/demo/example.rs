//! The example project of the window: the demo's scene as a recording that is ready to be labelled.

use std::fs;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

use super::run::{DemoMethod, new_project};
use crate::synthetic::{Scene, SceneOptions};
use ostra_core::job::{PlannedStage, Progress};
use ostra_session::{Command, Event, NewProject, Session};

/// Makes the images, depths and cameras of a scene in `folder/recording`, and a project of them.
///
/// Returns the project's folder, `folder/example plant`. A project that is there already is kept.
///
/// # Errors
/// Returns an error if the folder cannot be written, or if stopped. An unfinished recording is
/// removed.
pub fn make_example(folder: &Path, scene: &SceneOptions, progress: &Progress) -> Result<PathBuf> {
    let root = folder.join("example plant");
    if root.join("project.toml").is_file() {
        return Ok(root);
    }
    progress.plan(&[
        PlannedStage::new("render", "Render the images", 20.0),
        PlannedStage::new("create the project", "Create the project", 1.0),
    ]);
    let scene = Scene::build(scene)?;
    let recording = folder.join("recording");
    if !recording.exists() {
        let unfinished = folder.join("recording.unfinished");
        let written = write_recording(&scene, &unfinished, &recording, progress);
        if written.is_err() {
            let _ = fs::remove_dir_all(&unfinished);
        }
        written?;
    }
    progress.stage("create the project")?;
    let new = NewProject {
        root: root.clone(),
        ..new_project(folder, DemoMethod::Given, scene.views())
    };
    create(new, progress)?;
    Ok(root)
}

fn write_recording(
    scene: &Scene,
    unfinished: &Path,
    recording: &Path,
    progress: &Progress,
) -> Result<()> {
    scene.write(unfinished, progress)?;
    fs::remove_dir_all(unfinished.join("truth"))
        .and_then(|()| fs::rename(unfinished, recording))
        .with_context(|| format!("{}: cannot be written", recording.display()))
}

fn create(new: NewProject, progress: &Progress) -> Result<()> {
    let mut session = Session::new();
    session.act(Command::New(new))?;
    let events = session.settle(|_| match progress.check() {
        Ok(()) => ControlFlow::Continue(()),
        Err(_) => ControlFlow::Break(()),
    });
    progress.check()?;
    let failure = events.into_iter().find_map(|event| match event {
        Event::Failed { error, .. } => Some(error),
        _ => None,
    });
    if let Some(error) = failure {
        bail!(error);
    }
    session.save()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ostra_frames::Frame;

    fn small() -> SceneOptions {
        SceneOptions {
            views: 2,
            width: 60,
            height: 80,
            ..SceneOptions::default()
        }
    }

    #[test]
    fn example_has_cameras_and_depths_and_is_made_once() {
        let folder = tempfile::tempdir().unwrap();
        let root = make_example(folder.path(), &small(), &Progress::default()).unwrap();
        let frames = ostra_project::store::read_frames(&root).unwrap();
        assert_eq!(frames.len(), 2);
        assert!(
            frames
                .iter()
                .all(|frame| frame.posed_camera().is_some() && Frame::has_sensor_depth(frame))
        );
        fs::remove_dir_all(folder.path().join("recording")).unwrap();
        let again = make_example(folder.path(), &small(), &Progress::default()).unwrap();
        assert_eq!(again, root);
        assert!(!folder.path().join("recording").exists());
    }

    #[test]
    fn stopped_example_leaves_nothing_behind() {
        let folder = tempfile::tempdir().unwrap();
        let progress = Progress::default();
        progress.stop();
        make_example(folder.path(), &small(), &progress).unwrap_err();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
