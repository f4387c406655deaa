//! Harness that runs a target on damaged seeds.
//!
//! It reports the number of inputs, the duration of the slowest one, and the memory of the process.

use std::path::Path;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use tempfile::TempDir;

use crate::mutate::{Damage, damaged};

/// Duration above which an input is a finding.
///
/// Inputs take milliseconds; even a busy machine does not stretch them to this.
const HANG: Duration = Duration::from_secs(5);
/// Memory of the whole process in MB above which there is a finding.
const MAX_MB: u64 = 1000;

/// A valid file of some format: its path and its content.
#[derive(Clone)]
pub struct Seed {
    /// Path below the folder that the target reads, separated by `/`.
    pub path: String,
    pub bytes: Vec<u8>,
}

impl Seed {
    pub fn new(path: &str, bytes: impl Into<Vec<u8>>) -> Self {
        Self {
            path: path.to_owned(),
            bytes: bytes.into(),
        }
    }
}

/// Statistics of a run.
#[derive(Default)]
struct Figures {
    executions: u64,
    slowest: Duration,
    total: Duration,
}

/// A fuzz target: a folder, the seeds that are damaged and placed in it, and their reader.
pub struct Target<'a, F> {
    name: String,
    folder: TempDir,
    seeds: &'a [Seed],
    read: F,
    figures: Mutex<Figures>,
}

impl<'a, F: Fn(&Path, &Seed)> Target<'a, F> {
    /// Creates the target and reads the undamaged seeds.
    pub fn new(name: &str, seeds: &'a [Seed], read: F) -> Self {
        let folder = tempfile::tempdir_in(scratch()).unwrap();
        let target = Self {
            name: name.to_owned(),
            folder,
            seeds,
            read,
            figures: Mutex::default(),
        };
        // Readers need the other files next to the damaged one: class names next to labels, images
        // next to points.
        target
            .firsts()
            .for_each(|seed| place(target.folder.path(), seed));
        for seed in seeds {
            target.read(seed);
        }
        target
    }

    /// Returns the first seed of each path.
    fn firsts(&self) -> impl Iterator<Item = &Seed> {
        let is_first = |at: usize| {
            !self.seeds[..at]
                .iter()
                .any(|other| other.path == self.seeds[at].path)
        };
        self.seeds
            .iter()
            .enumerate()
            .filter(move |(at, _)| is_first(*at))
            .map(|(_, seed)| seed)
    }

    /// Reads one damaged seed and records the duration.
    pub fn run(&self, damage: &Damage) {
        let took = self.read(&damaged(self.seeds, damage));
        let mut figures = self.figures.lock().unwrap();
        figures.executions += 1;
        figures.slowest = figures.slowest.max(took);
        figures.total += took;
    }

    fn read(&self, seed: &Seed) -> Duration {
        let folder = self.folder.path();
        place(folder, seed);
        let begun = Instant::now();
        (self.read)(folder, seed);
        let took = begun.elapsed();
        let whole = self.firsts().find(|other| other.path == seed.path).unwrap();
        place(folder, whole);
        took
    }

    /// Prints the number of inputs, the slowest one, and the memory.
    ///
    /// # Panics
    ///
    /// If an input hung, or the process took more memory than any file may cause.
    pub fn report(&self) {
        let figures = self.figures.lock().unwrap();
        assert!(
            figures.slowest < HANG,
            "{}: an input took {:?}",
            self.name,
            figures.slowest
        );
        assert!(peak_mb() < MAX_MB, "{}: {} MB", self.name, peak_mb());
        println!(
            "{}: {} executions in {:.1} s, slowest {:.3} s, peak memory of the process {} MB",
            self.name,
            figures.executions,
            figures.total.as_secs_f64(),
            figures.slowest.as_secs_f64(),
            peak_mb()
        );
    }
}

/// Fuzzes a target within its test, whose name `tests/fuzz/run` uses to find it.
///
/// `iterations` bounds the inputs of a plain `cargo test`; `BOLERO_RANDOM_TEST_TIME_MS` replaces
/// that bound by a time.
macro_rules! fuzz {
    ($name:expr, $iterations:expr, $seeds:expr, $read:expr) => {{
        let seeds = $seeds;
        let target = $crate::harness::Target::new($name, &seeds, $read);
        let target = std::panic::AssertUnwindSafe(&target);
        let check = bolero::check!()
            .with_generator(<$crate::mutate::Damage as bolero::TypeGenerator>::produce());
        let is_timed = std::env::var_os("BOLERO_RANDOM_TEST_TIME_MS").is_some();
        let check = if is_timed {
            check
        } else {
            check.with_iterations($iterations)
        };
        check.for_each(|damage: &$crate::mutate::Damage| target.run(damage));
        target.report();
    }};
}
pub(crate) use fuzz;

fn place(folder: &Path, seed: &Seed) {
    let path = folder.join(&seed.path);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, &seed.bytes).unwrap();
}

/// Returns a folder for the files of targets, in memory if possible.
///
/// A target writes thousands of files a second.
pub fn scratch() -> std::path::PathBuf {
    let memory = Path::new("/dev/shm");
    if memory.is_dir() {
        memory.to_owned()
    } else {
        std::env::temp_dir()
    }
}

fn peak_mb() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.and_then(|line| line.split_whitespace().next()?.parse::<u64>().ok())
        .unwrap_or(0)
        / 1024
}
