//! The tests of this tier: found by name, run side by side, reported as ignored where what they need is missing.

use std::process::ExitCode;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use libtest_mimic::{Arguments, Trial};

use crate::data::{find_data, find_models, find_onnx_runtime};
use crate::film::has_ffmpeg;

/// What a test needs besides the repository.
#[derive(Debug, Clone, Copy)]
pub enum Needs {
    Nothing,
    /// The program ffmpeg.
    Ffmpeg,
    /// Real data sets.
    Data,
    /// Networks' weights, as files.
    Models,
    /// Real data sets, networks' weights and something to run them.
    Networks,
}

impl Needs {
    /// Why a test cannot run; `None` where all it needs is there.
    fn missing(self) -> Option<String> {
        match self {
            Self::Nothing => None,
            Self::Ffmpeg => (!has_ffmpeg()).then(|| "ffmpeg is missing: install it".to_owned()),
            Self::Data => find_data().err(),
            Self::Models => find_models().err(),
            Self::Networks => find_data()
                .and_then(|_| find_models())
                .and_then(|_| find_onnx_runtime())
                .err(),
        }
    }
}

/// One test.
#[derive(Clone, Copy)]
pub struct Test {
    pub name: &'static str,
    pub needs: Needs,
    pub run: fn(),
}

/// Lists the tests of a module by what they need.
macro_rules! tests {
    ($($needs:ident: $($test:ident),+;)+) => {
        pub fn tests() -> Vec<crate::registry::Test> {
            vec![$($(crate::registry::Test {
                name: concat!(module_path!(), "::", stringify!($test)),
                needs: crate::registry::Needs::$needs,
                run: $test,
            }),+),+]
        }
    };
}
pub(crate) use tests;

/// Seconds of the tests that ended.
type Seconds = Arc<Mutex<Vec<(Duration, &'static str)>>>;

/// Runs what the command line asks for and prints how long each test took, the slowest first.
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

/// A test whose needs are missing is ignored with the reason, and fails when `CI` is set.
fn trial(test: Test, seconds: &Seconds) -> Trial {
    let name = test.name.strip_prefix("accuracy::").unwrap_or(test.name);
    let missing = test.needs.missing();
    let is_ignored = missing.is_some() && std::env::var_os("CI").is_none();
    let seconds = Arc::clone(seconds);
    let run = move || {
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
