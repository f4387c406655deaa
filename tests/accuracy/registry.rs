//! Registry of the accuracy tests.
//!
//! Tests are selected by name and run in parallel. A test whose requirements are missing is
//! reported as ignored.

use std::process::ExitCode;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use libtest_mimic::{Arguments, Trial};

use crate::data::{find_data, find_models, find_onnx_runtime};
use crate::video::has_ffmpeg;

/// Requirements of a test besides the repository.
#[derive(Debug, Clone, Copy)]
pub enum Needs {
    Nothing,
    /// The program ffmpeg.
    Ffmpeg,
    /// Real data sets, by folder name.
    Data(&'static [&'static str]),
    /// Files of network weights.
    Models,
    /// Real data sets, network weights and ONNX Runtime.
    Networks(&'static [&'static str]),
}

impl Needs {
    /// Returns why a test cannot run; `None` if all requirements are met.
    fn missing(self) -> Option<String> {
        match self {
            Self::Nothing => None,
            Self::Ffmpeg => (!has_ffmpeg()).then(|| "ffmpeg is missing: install it".to_owned()),
            Self::Data(sets) => missing_data(sets),
            Self::Models => find_models().err(),
            Self::Networks(sets) => missing_data(sets)
                .or_else(|| find_models().err())
                .or_else(|| find_onnx_runtime().err()),
        }
    }
}

/// Returns a message about the missing data folder or the first missing set.
fn missing_data(sets: &[&str]) -> Option<String> {
    let data = match find_data() {
        Ok(data) => data,
        Err(reason) => return Some(reason),
    };
    let set = sets.iter().find(|set| !data.join(set).is_dir())?;
    Some(format!("data set {set} is missing in {}", data.display()))
}

/// A registered test.
#[derive(Clone, Copy)]
pub struct Test {
    pub name: &'static str,
    pub needs: Needs,
    pub run: fn(),
}

/// Defines `tests()`, which lists the tests of a module by requirement.
macro_rules! tests {
    ($($needs:expr => $($test:ident),+;)+) => {
        pub fn tests() -> Vec<crate::registry::Test> {
            use crate::registry::Needs::*;
            vec![$($(crate::registry::Test {
                name: concat!(module_path!(), "::", stringify!($test)),
                needs: $needs,
                run: $test,
            }),+),+]
        }
    };
}
pub(crate) use tests;

/// Durations and names of the tests that ended.
type Seconds = Arc<Mutex<Vec<(Duration, &'static str)>>>;

/// Runs the tests that the command line selects, then prints their durations, longest first.
pub fn run(tests: Vec<Test>) -> ExitCode {
    let arguments = Arguments::from_args();
    let seconds = Seconds::default();
    let trials = tests
        .into_iter()
        .map(|test| trial(test, &seconds))
        .collect();
    let conclusion = libtest_mimic::run(&arguments, trials);
    let mut seconds = seconds.lock().unwrap_or_else(PoisonError::into_inner);
    seconds.sort_by(|a, b| b.cmp(a));
    for (duration, name) in seconds.iter() {
        println!("{:8.2} s  {name}", duration.as_secs_f64());
    }
    conclusion.exit_code()
}

/// Wraps a test for libtest_mimic.
///
/// A test whose requirements are missing is ignored with the reason, and fails when `CI` is set.
fn trial(test: Test, seconds: &Seconds) -> Trial {
    let name = test.name.strip_prefix("accuracy::").unwrap_or(test.name);
    let missing = test.needs.missing();
    let is_ignored = missing.is_some() && std::env::var_os("CI").is_none();
    let seconds = Arc::clone(seconds);
    let reason = missing.clone();
    let run = move || {
        if let Some(reason) = reason {
            return Err(reason.into());
        }
        let started = Instant::now();
        (test.run)();
        let ended = (started.elapsed(), name);
        seconds
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .push(ended);
        Ok(())
    };
    Trial::test(name, run)
        .with_kind(missing.unwrap_or_default())
        .with_ignored_flag(is_ignored)
}
