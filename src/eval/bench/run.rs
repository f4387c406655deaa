use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, ensure};

use super::data_sets::{DataSet, StandardSet};
use super::machine::Machine;
use super::measured::{BenchStage, CameraErrors, Measured, RunOutcome};
use super::ostra_run::OstraRun;
use super::python::PythonProgram;
use super::report::{BenchProgram, BenchReport, ProgramRun, SetReport};
use super::synthetic_set::SyntheticSet;
use crate::evaluate::score_cameras;
use ostra_core::disk::{Unfinished, WorkFolder};
use ostra_core::lists::in_words;
use ostra_geometry::Alignment;

/// Options of a bench.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BenchOptions {
    /// Path of this program's executable.
    pub program: PathBuf,
    /// Version of this program.
    pub version: String,
    /// Folder of data sets; `None` if only rendered sets run.
    pub data: Option<PathBuf>,
    /// Standard sets to run; those that are not found are reported.
    pub sets: Vec<StandardSet>,
    /// Sets to render.
    pub synthetic: Vec<SyntheticSet>,
    /// Last stage. Other programs only find cameras.
    pub until: BenchStage,
    /// Number of rounds, from 1.
    pub rounds: usize,
    /// Other programs that take turns with this one, on the sets that they can reconstruct.
    pub other_programs: Vec<BenchProgram>,
}

/// A program that can run.
struct Ready {
    program: BenchProgram,
    version: String,
}

/// Runs all sets and returns what they took; `note` gets a line before each run,
/// and one for each program that cannot run.
///
/// A set that fails does not stop the others.
///
/// # Errors
/// Returns an error if none of the sets is found, or the folder for temporary files cannot be
/// written.
pub fn run_bench(options: &BenchOptions, note: &mut dyn FnMut(&str)) -> Result<BenchReport> {
    let folder = std::env::temp_dir();
    let cannot = || format!("{}: cannot be written", folder.display());
    let work = WorkFolder::create(&folder).with_context(cannot)?;
    let _listed = Unfinished::list(work.path());
    let (found, not_found) = options.find_sets()?;
    let mut ready = vec![Ready {
        program: BenchProgram::Ostra,
        version: options.version.clone(),
    }];
    let mut not_run = Vec::new();
    for &program in &options.other_programs {
        let Some(other) = PythonProgram::of(program) else {
            continue;
        };
        let has_set = found.iter().any(|set| program.takes(set))
            || (program.takes_photos() && !options.synthetic.is_empty());
        let version = if has_set {
            other.version(work.path())
        } else {
            Err(no_set(program))
        };
        match version {
            Ok(version) => ready.push(Ready { program, version }),
            Err(error) => {
                note(&format!("warning: {error:#}"));
                not_run.push(format!("{error:#}"));
            }
        }
    }
    let bench = Bench {
        options,
        ready,
        work: work.path(),
    };
    let mut sets = Vec::new();
    for set in &found {
        sets.push(bench.run(set, note));
    }
    for set in &options.synthetic {
        note(&format!("{}: rendering {} images", set.name(), set.images));
        let folder = work.path().join("rendered");
        sets.push(bench.run(&set.render(&folder)?, note));
        remove(&folder)?;
    }
    Ok(BenchReport {
        version: options.version.clone(),
        machine: Machine::this(),
        sets,
        not_found,
        not_run,
    })
}

/// Returns why a program has nothing to run on.
fn no_set(program: BenchProgram) -> anyhow::Error {
    let kind = if program.takes_photos() {
        "has no depth"
    } else {
        "has depth"
    };
    anyhow!(
        "`--beside {}`: no set to run {kind}, which it needs",
        program.name()
    )
}

impl BenchOptions {
    /// Returns the standard sets that are there, and the names of those that are not.
    fn find_sets(&self) -> Result<(Vec<DataSet>, Vec<String>)> {
        let (mut found, mut not_found) = (Vec::new(), Vec::new());
        let Some(data) = &self.data else {
            return Ok((found, not_found));
        };
        ensure!(
            data.is_dir(),
            "{}: is no folder; give the folder of the data sets with --data",
            data.display()
        );
        for set in &self.sets {
            match set.find(data) {
                Some(set) => found.push(set),
                None => not_found.push(set.name.to_owned()),
            }
        }
        let folders = || in_words(self.sets.iter().map(|set| set.folder), "and");
        ensure!(
            !found.is_empty() || !self.synthetic.is_empty(),
            "{}: holds none of the data sets; they are looked for in its folders {}",
            data.display(),
            folders()
        );
        Ok((found, not_found))
    }
}

/// Removes a folder of temporary files, so that large sets do not add up.
fn remove(folder: &Path) -> Result<()> {
    std::fs::remove_dir_all(folder)
        .with_context(|| format!("{}: cannot be removed", folder.display()))
}

/// A bench in progress.
struct Bench<'a> {
    options: &'a BenchOptions,
    ready: Vec<Ready>,
    work: &'a Path,
}

impl Bench<'_> {
    /// Runs all programs on a set, in turns.
    fn run(&self, set: &DataSet, note: &mut dyn FnMut(&str)) -> SetReport {
        let images = set.image_names().map_or(0, |names| names.len());
        let takes = |ready: &&Ready| ready.program.takes(set);
        let programs: Vec<&Ready> = self.ready.iter().filter(takes).collect();
        let mut rounds: Vec<Result<Rounds>> = Vec::new();
        rounds.resize_with(programs.len(), || Ok(Rounds::default()));
        for round in 1..=self.options.rounds {
            for (ready, rounds) in programs.iter().zip(&mut rounds) {
                let Ok(done) = rounds else { continue };
                let name = ready.program.name();
                let of = self.options.rounds;
                note(&format!("{}: {name}, round {round} of {of}", set.name));
                if let Err(error) = self.round(set, ready.program, done) {
                    *rounds = Err(error);
                }
            }
        }
        let runs = programs.into_iter().zip(rounds).map(|(ready, rounds)| {
            let measured =
                rounds.map(|rounds| Measured::of(rounds.outcomes, images, rounds.errors));
            ProgramRun {
                program: ready.program,
                version: ready.version.clone(),
                failure: measured.as_ref().err().map(|error| format!("{error:#}")),
                measured: measured.ok().flatten(),
            }
        });
        SetReport {
            name: set.name.clone(),
            images,
            runs: runs.collect(),
        }
    }

    /// Runs a program once in a new folder, and scores it.
    fn round(&self, set: &DataSet, program: BenchProgram, rounds: &mut Rounds) -> Result<()> {
        let work = self.work.join("run");
        std::fs::create_dir(&work)
            .with_context(|| format!("{}: cannot be made", work.display()))?;
        let finished = match PythonProgram::of(program) {
            None => {
                let run = OstraRun {
                    program: &self.options.program,
                    set,
                    until: self.options.until,
                    work: &work,
                };
                run.run()
            }
            Some(other) => other.run(set, &work),
        };
        let scored = finished.and_then(|(outcome, cameras)| Ok((outcome, errors(set, &cameras)?)));
        remove(&work)?;
        let (outcome, errors) = scored?;
        rounds.outcomes.push(outcome);
        rounds.errors = errors;
        Ok(())
    }
}

/// Rounds of a program on a set so far.
#[derive(Default)]
struct Rounds {
    outcomes: Vec<RunOutcome>,
    /// Errors of the last round, if the set has ground truth.
    errors: Option<CameraErrors>,
}

/// Compares cameras with the ground truth, if the set has it.
///
/// Depth gives the scale, so it counts for sets that have it.
fn errors(set: &DataSet, cameras: &Path) -> Result<Option<CameraErrors>> {
    let Some(truth) = &set.truth else {
        return Ok(None);
    };
    let alignment = if set.depth.is_some() {
        Alignment::Se3
    } else {
        Alignment::Sim3
    };
    let score = score_cameras(truth, cameras, alignment, false)?;
    Ok(Some(CameraErrors {
        centre_percent: score.centre_percent,
        rotation_deg: score.error.rotation_deg.median,
    }))
}
