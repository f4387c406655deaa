use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use serde::Serialize;

use super::child::Finished;
use super::data_sets::{DEPTH_UNITS_PER_METRE, DataSet};
use super::measured::RunOutcome;
use super::report::BenchProgram;
use ostra_core::programs;
use ostra_frames::cameras::{Focal, GivenCameras};

/// What the scripts take as their argument.
#[derive(Debug, Serialize)]
struct ScriptRequest<'a> {
    images: &'a Path,
    names: Vec<String>,
    /// Folder of the depth maps, for a recording.
    depth: Option<&'a Path>,
    units_per_metre: f64,
    /// Focal lengths and principal point; `None` if they are unknown.
    camera: Option<[f64; 4]>,
    sequential: bool,
    work: &'a Path,
}

/// A program in Python, driven by a script.
pub(super) struct PythonProgram {
    /// Name of the module, and of the package that has it.
    module: &'static str,
    script: &'static str,
}

impl PythonProgram {
    /// Returns the program; `None` if it is not one in Python.
    pub fn of(program: BenchProgram) -> Option<Self> {
        let script = match program {
            BenchProgram::Ostra => return None,
            BenchProgram::Pycolmap => {
                concat!(include_str!("timing.py"), include_str!("pycolmap.py"))
            }
            BenchProgram::Open3d => concat!(include_str!("timing.py"), include_str!("open3d.py")),
        };
        Some(Self {
            module: program.name(),
            script,
        })
    }

    /// Returns the version that `python3` imports.
    ///
    /// # Errors
    /// Returns an error that says how to install it, if it cannot be imported.
    pub fn version(&self, work: &Path) -> Result<String> {
        let module = self.module;
        let missing = || {
            format!(
                "`--beside {module}`: python3 cannot import it; to install it, run 'python3 -m pip install {module}'"
            )
        };
        let import = || -> Result<Finished> {
            let mut python = programs::command("python3")?;
            let print = format!("import {module}; print({module}.__version__)");
            python.args(["-c", &print]);
            Finished::run(&mut python, work)
        };
        Ok(import().with_context(missing)?.output.trim().to_owned())
    }

    /// Runs the program on a set, and returns what it took and where the cameras are.
    ///
    /// It runs on the CPU. One camera is assumed for all images, with given intrinsics if the set has
    /// true cameras.
    ///
    /// # Errors
    /// Returns an error if the intrinsics cannot be read, or the program fails.
    pub fn run(&self, set: &DataSet, work: &Path) -> Result<(RunOutcome, PathBuf)> {
        let request = ScriptRequest {
            images: &set.images,
            names: set.image_names()?,
            depth: set.depth.as_deref(),
            units_per_metre: DEPTH_UNITS_PER_METRE,
            camera: set.truth.as_deref().map(intrinsics).transpose()?,
            sequential: set.is_sequence,
            work,
        };
        let mut python = programs::command("python3")?;
        python.args(["-c", self.script, &serde_json::to_string(&request)?]);
        let finished = Finished::run(&mut python, work)?;
        let outcome = RunOutcome {
            seconds: finished.seconds,
            ..finished.json()?
        };
        Ok((outcome, work.join("cameras")))
    }
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
