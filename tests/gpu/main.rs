//! Tests on the GPU.
//!
//! Without an adapter they are reported as ignored with the reason, and fail when `CI` is set.
//! libtest cannot ignore a test at run time, so these tests have their own harness. Tests of
//! private items stay next to their code and are marked `#[ignore = "needs a GPU adapter: …"]`.

#![expect(clippy::unwrap_used, reason = "tests may panic")]

use std::io::Write as _;

use libtest_mimic::{Arguments, Trial};
use ostra_compute::gpu::{Device, Software};

mod compute;
mod drawing;
mod drawing_clouds;

/// Name and function of one test.
#[derive(Clone, Copy)]
struct Test {
    name: &'static str,
    run: fn(),
}

/// Defines `tests()`, which lists the tests of a module.
macro_rules! tests {
    ($($test:ident),+) => {
        pub fn tests() -> Vec<crate::Test> {
            vec![$(crate::Test {
                name: concat!(module_path!(), "::", stringify!($test)),
                run: $test,
            }),+]
        }
    };
}
use tests;

fn main() {
    // `cargo test` passes this libtest option to every target, but libtest_mimic does not know it.
    let arguments = std::env::args().filter(|argument| argument != "--report-time");
    // A device that computes may not be able to draw.
    let no_device = Device::open(Software::Allowed)
        .err()
        .map(|error| error.to_string());
    let no_view = drawing::View::open().err();
    let computing = compute::tests()
        .into_iter()
        .map(|test| trial(test, no_device.clone()));
    let drawing = [drawing::tests(), drawing_clouds::tests()]
        .into_iter()
        .flatten()
        .map(|test| trial(test, no_view.clone()));
    let trials = computing.chain(drawing).collect();
    let conclusion = libtest_mimic::run(&Arguments::from_iter(arguments), trials);
    let code = i32::from(conclusion.has_failed()) * 101;
    let _ = std::io::stdout().flush();
    // Mesa's software Vulkan has freed memory twice in its exit handlers, after all tests had passed.
    // The result is known by now, so the process ends without them.
    signal_hook::low_level::exit(code);
}

fn trial(test: Test, missing: Option<String>) -> Trial {
    let name = test.name.strip_prefix("gpu::").unwrap_or(test.name);
    let is_ignored = missing.is_some() && std::env::var_os("CI").is_none();
    let kind = missing.clone().unwrap_or_default();
    let run = move || match missing {
        Some(reason) => Err(reason.into()),
        None => {
            (test.run)();
            Ok(())
        }
    };
    Trial::test(name, run)
        .with_kind(kind)
        .with_ignored_flag(is_ignored)
}
