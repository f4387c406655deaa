use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Result, bail};
use serde::Deserialize;

use super::child::Finished;
use super::data_sets::DataSet;
use super::measured::{BenchStage, RunOutcome};
use ostra_project::StepSeconds;

/// What `ostra reconstruct --json` and `ostra fuse --json` print.
#[derive(Debug, Deserialize)]
struct CommandResults {
    results: BTreeMap<String, CommandResult>,
    peak_memory_bytes: Option<u64>,
}

#[derive(Debug, Deserialize)]
struct CommandResult {
    frames: usize,
    #[serde(default)]
    steps: Vec<StepSeconds>,
}

/// A run of this program on a set, in a new project.
pub(super) struct OstraRun<'a> {
    /// Path of the executable.
    pub program: &'a Path,
    pub set: &'a DataSet,
    pub until: BenchStage,
    /// Empty folder for the project.
    pub work: &'a Path,
}

impl OstraRun<'_> {
    /// Reconstructs the set, and returns what it took and where the cameras are.
    ///
    /// Creating the project and exporting the cameras do not count.
    ///
    /// # Errors
    /// Returns the error of the command that fails.
    pub fn run(&self) -> Result<(RunOutcome, PathBuf)> {
        let project = self.work.join("project");
        let mut new = self.command("new", &project);
        new.arg("--frames").arg(&self.set.images);
        new.args(["--every", &self.set.every.to_string()]);
        for (option, path) in [
            ("--depth", self.set.depth.as_ref()),
            ("--cameras", self.set.truth.as_ref()),
        ] {
            if let Some(path) = path {
                new.arg(option).arg(path);
            }
        }
        Finished::run(&mut new, self.work)?;
        let mut outcome = RunOutcome {
            seconds: 0.0,
            steps: Vec::new(),
            placed: 0,
            peak_memory_bytes: Some(0),
        };
        let is_recording = self.set.depth.is_some();
        let method = if is_recording { "rgbd" } else { "sfm" };
        let command = self.reconstruct(&project, method);
        outcome.placed = self.measure(command, "cameras", &mut outcome)?;
        if self.until >= BenchStage::Depth && !is_recording {
            let command = self.reconstruct(&project, "mvs");
            self.measure(command, "depths", &mut outcome)?;
        }
        if self.until >= BenchStage::Cloud {
            let mut fuse = self.command("fuse", &project);
            fuse.arg("--json");
            self.measure(fuse, "cloud", &mut outcome)?;
        }
        let cameras = self.work.join("cameras");
        let mut export = self.command("export", &project);
        export.arg("--cameras").arg(&cameras);
        Finished::run(&mut export, self.work)?;
        Ok((outcome, cameras))
    }

    fn command(&self, name: &str, project: &Path) -> Command {
        let mut command = Command::new(self.program);
        command.arg(name).arg(project);
        command
    }

    fn reconstruct(&self, project: &Path, method: &str) -> Command {
        let mut command = self.command("reconstruct", project);
        command.args(["--method", method, "--json"]);
        command
    }

    /// Runs a command, adds what it took, and returns the number of frames of its result.
    fn measure(&self, mut command: Command, kind: &str, sum: &mut RunOutcome) -> Result<usize> {
        let finished = Finished::run(&mut command, self.work)?;
        let mut printed: CommandResults = finished.json()?;
        let Some(result) = printed.results.remove(kind) else {
            bail!("the program reported no {kind}");
        };
        sum.seconds += finished.seconds;
        sum.steps.extend(result.steps);
        sum.peak_memory_bytes = sum
            .peak_memory_bytes
            .zip(printed.peak_memory_bytes)
            .map(|(before, now)| before.max(now));
        Ok(result.frames)
    }
}
