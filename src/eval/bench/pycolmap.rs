use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use serde::Serialize;

use super::child::Finished;
use super::data_sets::DataSet;
use super::measured::RunOutcome;
use ostra_core::programs;
use ostra_frames::cameras::{Focal, GivenCameras};

/// The script that drives pycolmap.
const SCRIPT: &str = include_str!("pycolmap.py");

/// What [`SCRIPT`] takes as its argument.
#[derive(Debug, Serialize)]
struct ScriptRequest<'a> {
    images: &'a Path,
    names: Vec<String>,
    /// Focal lengths and principal point; `None` if they are unknown.
    camera: Option<[f64; 4]>,
    sequential: bool,
    work: &'a Path,
}

/// Returns the version of pycolmap that `python3` imports.
///
/// # Errors
/// Returns an error that says how to install it, if it cannot be imported.
pub(super) fn version(work: &Path) -> Result<String> {
    let missing = "`--beside pycolmap`: python3 cannot import it; to install it, run 'python3 -m pip install pycolmap'";
    let import = || -> Result<Finished> {
        let mut python = programs::command("python3")?;
        python.args(["-c", "import pycolmap; print(pycolmap.__version__)"]);
        Finished::run(&mut python, work)
    };
    Ok(import().context(missing)?.output.trim().to_owned())
}

/// Runs pycolmap on a set, and returns what it took and where the cameras are.
///
/// It runs on the CPU with its default options. Images that follow a path are matched in their
/// order, others each with every other. One camera is assumed for all, with given intrinsics if the
/// set has true cameras.
///
/// # Errors
/// Returns an error if the intrinsics cannot be read, or pycolmap fails.
pub(super) fn run(set: &DataSet, work: &Path) -> Result<(RunOutcome, PathBuf)> {
    let request = ScriptRequest {
        images: &set.images,
        names: set.image_names()?,
        camera: set.truth.as_deref().map(intrinsics).transpose()?,
        sequential: set.is_sequence,
        work,
    };
    let mut python = programs::command("python3")?;
    python.args(["-c", SCRIPT, &serde_json::to_string(&request)?]);
    let finished = Finished::run(&mut python, work)?;
    let outcome = RunOutcome {
        seconds: finished.seconds,
        ..finished.json()?
    };
    Ok((outcome, work.join("cameras")))
}

/// Returns focal lengths and principal point of the first true camera, in pixels.
fn intrinsics(truth: &Path) -> Result<[f64; 4]> {
    let cameras = GivenCameras::read(truth)?.cameras;
    let known = cameras.iter().find_map(|camera| {
        let given = camera.intrinsics?;
        match (given.focal, given.principal_px) {
            (Focal::Pixels(focal), Some(principal)) => {
                Some([focal.x, focal.y, principal.x, principal.y])
            }
            _ => None,
        }
    });
    known.with_context(|| {
        format!(
            "{}: has no focal lengths and principal point in pixels",
            truth.display()
        )
    })
}
