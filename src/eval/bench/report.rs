use std::fmt::Write as _;

use serde::Serialize;

use super::data_sets::DataSet;
use super::machine::Machine;
use super::measured::Measured;
use crate::cloud_score::TextTable;

/// A program that reconstructs sets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum BenchProgram {
    /// This program.
    Ostra,
    /// COLMAP in Python, on the CPU, with its default options. It finds cameras of photos: images that
    /// follow a path are matched in their order, others each with every other.
    Pycolmap,
    /// Open3D in Python, on the CPU. It finds cameras of recordings with depth, by RGB-D odometry and a
    /// pose graph.
    Open3d,
}

impl BenchProgram {
    /// Returns the name in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Ostra => "ostra",
            Self::Pycolmap => "pycolmap",
            Self::Open3d => "open3d",
        }
    }

    /// Returns whether the program can reconstruct a set.
    pub(super) fn takes(self, set: &DataSet) -> bool {
        self == Self::Ostra || self.takes_photos() == set.depth.is_none()
    }

    /// Returns whether the program finds cameras without depth.
    pub(super) fn takes_photos(self) -> bool {
        self != Self::Open3d
    }
}

/// Results of a bench.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BenchReport {
    /// Version of this program.
    pub version: String,
    /// Machine that it ran on.
    pub machine: Machine,
    /// Sets that were run, in order.
    pub sets: Vec<SetReport>,
    /// Names of sets that are not in the folder of data sets.
    pub not_found: Vec<String>,
    /// Why other programs were not run.
    pub not_run: Vec<String>,
}

/// Results of a set.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SetReport {
    /// Name of the set.
    pub name: String,
    /// Number of its images.
    pub images: usize,
    /// One entry for each program.
    pub runs: Vec<ProgramRun>,
}

impl SetReport {
    /// Returns whether a program failed on the set.
    #[must_use]
    pub fn has_failed(&self) -> bool {
        self.runs.iter().any(|run| run.failure.is_some())
    }
}

/// Results of a program on a set.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ProgramRun {
    /// The program.
    pub program: BenchProgram,
    /// Its version.
    pub version: String,
    /// Why it failed; `None` if it did not.
    pub failure: Option<String>,
    /// What it took; `None` if it failed.
    #[serde(flatten)]
    pub measured: Option<Measured>,
}

/// Text in place of a value that is not known.
const NOT_KNOWN: &str = "not known";

impl BenchReport {
    /// Returns how many runs failed, and of how many.
    #[must_use]
    pub fn failures(&self) -> (usize, usize) {
        let runs = || self.sets.iter().flat_map(|set| &set.runs);
        let failed = runs().filter(|run| run.failure.is_some()).count();
        (failed, runs().count())
    }

    /// Returns the report as text: the machine, a table of the runs, and a table of their steps.
    #[must_use]
    pub fn table(&self) -> String {
        let mut table = TextTable::default();
        table.row([
            "set",
            "program",
            "images",
            "placed",
            "centre error",
            "rotation error",
            "time",
            "per image",
            "peak memory",
        ]);
        let mut failures = String::new();
        for set in &self.sets {
            for run in &set.runs {
                let name = run.program.name();
                if let Some(measured) = &run.measured {
                    table.row(cells(set, name, measured));
                }
                if let Some(failure) = &run.failure {
                    table.row([&set.name, name, &set.images.to_string(), "failed"]);
                    let _ = writeln!(failures, "{}, {name}: {failure}", set.name);
                }
            }
        }
        let mut text = format!("OSTRA {}\n{}\n", self.version, self.machine.text());
        for part in [table.text(), self.steps(), failures] {
            if !part.is_empty() {
                let _ = write!(text, "\n{part}");
            }
        }
        for why in &self.not_run {
            let _ = writeln!(text, "\nnot run: {why}");
        }
        if !self.not_found.is_empty() {
            let _ = writeln!(text, "\nnot found: {}", self.not_found.join(", "));
        }
        text
    }

    /// Returns the wall time of the steps, in seconds, with a column for each step of any run.
    fn steps(&self) -> String {
        let measured = || {
            self.sets.iter().flat_map(|set| {
                let run = |run: &'_ ProgramRun| Some((run.program, run.measured.clone()?));
                set.runs.iter().filter_map(run).map(|run| (&set.name, run))
            })
        };
        let mut titles: Vec<String> = Vec::new();
        for (_, (_, measured)) in measured() {
            for step in measured.steps {
                if !titles.contains(&step.step) {
                    titles.push(step.step);
                }
            }
        }
        if titles.is_empty() {
            return String::new();
        }
        let mut table = TextTable::default();
        let head = ["seconds".to_owned(), "program".to_owned()];
        table.row(head.into_iter().chain(titles.iter().cloned()));
        for (set, (program, measured)) in measured() {
            let seconds = |title: &String| {
                let of_step = measured.steps.iter().filter(|step| step.step == *title);
                let seconds: Vec<f64> = of_step.map(|step| step.seconds).collect();
                match seconds[..] {
                    [] => "–".to_owned(),
                    _ => format!("{:.1}", seconds.iter().sum::<f64>()),
                }
            };
            let first = [set.clone(), program.name().to_owned()];
            table.row(first.into_iter().chain(titles.iter().map(seconds)));
        }
        table.text()
    }
}

/// Returns the cells of a run that did not fail.
fn cells(set: &SetReport, program: &str, measured: &Measured) -> Vec<String> {
    let or_not_known = |text: Option<String>| text.unwrap_or_else(|| NOT_KNOWN.to_owned());
    let memory = measured.peak_memory_bytes;
    vec![
        set.name.clone(),
        program.to_owned(),
        set.images.to_string(),
        measured.placed.to_string(),
        or_not_known(measured.centre_percent.map(|error| format!("{error:.3} %"))),
        or_not_known(measured.rotation_deg.map(|error| format!("{error:.3}°"))),
        format!("{:.1} s", measured.seconds),
        format!("{:.2} s", measured.seconds_per_image),
        or_not_known(memory.map(|bytes| format!("{:.0} MB", bytes as f64 / 1e6))),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use ostra_project::StepSeconds;

    fn report() -> BenchReport {
        let step = |step: &str, seconds| StepSeconds {
            step: step.into(),
            seconds,
        };
        let measured = Measured {
            seconds: 12.34,
            seconds_per_image: 1.234,
            rounds: vec![12.34],
            steps: vec![step("Find features", 2.0), step("Match images", 3.5)],
            placed: 10,
            centre_percent: Some(0.0312),
            rotation_deg: None,
            peak_memory_bytes: Some(310_400_000),
        };
        let run = |program, measured: Option<Measured>| ProgramRun {
            program,
            version: "1".into(),
            failure: measured.is_none().then(|| "no start".into()),
            measured,
        };
        BenchReport {
            version: "1".into(),
            machine: Machine {
                processor: Some("a processor".into()),
                cores: 1,
                memory_bytes: None,
                system: "linux".into(),
            },
            sets: vec![SetReport {
                name: "fountain".into(),
                images: 10,
                runs: vec![
                    run(BenchProgram::Ostra, Some(measured)),
                    run(BenchProgram::Pycolmap, None),
                ],
            }],
            not_found: vec!["dtu".into()],
            not_run: Vec::new(),
        }
    }

    #[test]
    fn table_has_the_machine_every_run_and_the_steps() {
        let expected = "\
OSTRA 1
a processor, 1 core, memory not known, linux

set        program  images  placed  centre error  rotation error    time  per image  peak memory
fountain     ostra      10      10       0.031 %       not known  12.3 s     1.23 s       310 MB
fountain  pycolmap      10  failed

seconds   program  Find features  Match images
fountain    ostra            2.0           3.5

fountain, pycolmap: no start

not found: dtu
";
        assert_eq!(report().table(), expected);
        assert_eq!(report().failures(), (1, 2));
    }

    #[test]
    fn json_has_the_values_of_a_run_next_to_its_program() {
        let json = serde_json::to_value(report()).unwrap();
        let run = &json["sets"][0]["runs"][0];
        assert_eq!(run["program"], "ostra");
        assert_eq!(run["seconds"], 12.34);
        assert_eq!(run["steps"][1]["step"], "Match images");
        assert!(run["rotation_deg"].is_null() && run["failure"].is_null());
        let failed = &json["sets"][0]["runs"][1];
        assert_eq!(failed["failure"], "no start");
        assert!(failed.get("seconds").is_none());
    }
}
