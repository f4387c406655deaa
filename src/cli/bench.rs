use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};

use super::print::{print_json, print_text, print_to_stderr, printable};
use super::values;
use ostra_core::lists::in_words;
use ostra_eval::bench::{
    BenchOptions, BenchProgram, BenchStage, STANDARD_SETS, StandardSet, SyntheticSet, run_bench,
};

/// Variable with the folder of data sets, for those who do not give it with `--data`.
const DATA_VARIABLE: &str = "OSTRA_DATA";

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum OtherProgram {
    /// COLMAP in Python, on photos.
    Pycolmap,
    /// Open3D in Python, on recordings with depth.
    Open3d,
}

impl From<OtherProgram> for BenchProgram {
    fn from(program: OtherProgram) -> Self {
        match program {
            OtherProgram::Pycolmap => Self::Pycolmap,
            OtherProgram::Open3d => Self::Open3d,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Until {
    Cameras,
    Depth,
    Cloud,
}

#[derive(Debug, Args)]
pub(super) struct BenchArgs {
    /// Folder of the data sets [default: the environment variable OSTRA_DATA].
    #[arg(long, value_name = "FOLDER")]
    pub data: Option<PathBuf>,
    /// Data sets to run [default: all that are in the folder].
    #[arg(long, value_name = "NAME[,NAME…]", value_delimiter = ',', value_parser = standard_set())]
    pub sets: Vec<StandardSet>,
    /// Render so many images of a synthetic plant along a path, 640x480, and run these; the data
    /// sets then run only with --data or --sets.
    #[arg(long, value_name = "N[,N…]", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(3..=5000))]
    pub synthetic: Vec<u32>,
    /// Render so many images of the plant from two cameras, one above the other, as on a turntable;
    /// otherwise as --synthetic.
    #[arg(long, value_name = "N[,N…]", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(8..=5000))]
    pub two_cameras: Vec<u32>,
    /// Last stage to run.
    #[arg(long, value_name = "STAGE", default_value = "cameras")]
    pub until: Until,
    /// Number of rounds; the times are medians.
    #[arg(long, value_name = "N", default_value = "1", value_parser = values::from_one)]
    pub rounds: usize,
    /// Run these programs as well, in turns; they only find cameras.
    #[arg(long, value_name = "PROGRAM[,PROGRAM…]", value_delimiter = ',')]
    pub beside: Vec<OtherProgram>,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
}

/// Returns a parser of names of standard sets; help and errors list all names.
fn standard_set() -> impl TypedValueParser<Value = StandardSet> {
    PossibleValuesParser::new(STANDARD_SETS.iter().map(|set| set.name)).try_map(|name| {
        let named = |set: &StandardSet| set.name == name;
        STANDARD_SETS.into_iter().find(named).ok_or("no such set")
    })
}

/// Returns the programs, each once.
fn other_programs(named: Vec<OtherProgram>) -> Vec<BenchProgram> {
    let mut programs: Vec<BenchProgram> = Vec::new();
    for program in named.into_iter().map(BenchProgram::from) {
        if !programs.contains(&program) {
            programs.push(program);
        }
    }
    programs
}

/// Runs the sets, and prints what they took.
///
/// # Errors
/// Returns an error if there is no set to run, or if a run failed.
pub(super) fn bench(args: BenchArgs) -> Result<()> {
    let set = |images: u32, two_cameras| SyntheticSet {
        images: images as usize,
        two_cameras,
    };
    let along_path = args.synthetic.iter().map(|&images| set(images, false));
    let two_cameras = args.two_cameras.iter().map(|&images| set(images, true));
    let synthetic: Vec<SyntheticSet> = along_path.chain(two_cameras).collect();
    let has_standard = args.data.is_some() || !args.sets.is_empty() || synthetic.is_empty();
    let data = args
        .data
        .or_else(|| std::env::var_os(DATA_VARIABLE).map(PathBuf::from))
        .filter(|_| has_standard);
    ensure!(
        data.is_some() || !has_standard,
        "no folder of data sets is known; give it with --data or {DATA_VARIABLE}, or render images with --synthetic"
    );
    let sets = match (has_standard, args.sets) {
        (false, _) => Vec::new(),
        (true, sets) if sets.is_empty() => STANDARD_SETS.to_vec(),
        (true, sets) => sets,
    };
    let options = BenchOptions {
        program: std::env::current_exe().context("the path of this program is not known")?,
        version: env!("CARGO_PKG_VERSION").to_owned(),
        data,
        sets,
        synthetic,
        until: match args.until {
            Until::Cameras => BenchStage::Cameras,
            Until::Depth => BenchStage::Depth,
            Until::Cloud => BenchStage::Cloud,
        },
        rounds: args.rounds,
        other_programs: other_programs(args.beside),
    };
    let report = run_bench(&options, &mut |line| {
        print_to_stderr(&format!("{}\n", printable(line)));
    })?;
    if args.json {
        print_json(&serde_json::to_string(&report)?);
    } else {
        print_text(&report.table());
    }
    let (failed, runs) = report.failures();
    let names = report.sets.iter().filter(|set| set.has_failed());
    let names: Vec<&str> = names.map(|set| set.name.as_str()).collect();
    ensure!(
        failed == 0,
        "{failed} of {runs} runs failed ({}); the report has the reasons",
        in_words(names, "and")
    );
    Ok(())
}
