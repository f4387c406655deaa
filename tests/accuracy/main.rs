//! Tests on real data: accuracy floors that may only rise, whole demos, long runs.
//!
//! `cargo test --test accuracy [-- FILTER]`. Data sets are read from `../shared/data` or
//! `OSTRA_DATA`, networks from `../shared/models` or `OSTRA_MODELS`. `ORT_DYLIB_PATH` names the
//! library that runs them. A test without its data is reported as ignored with the reason, and
//! fails when `CI` is set.

#![expect(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::print_stdout,
    reason = "tests may panic, and print the figures that they measure"
)]

#[path = "../support/crash_child.rs"]
#[cfg_attr(unix, expect(dead_code, reason = "the quick tests fill the disk"))]
mod crash_child;
#[path = "../support/data.rs"]
mod data;
#[path = "../support/data_set.rs"]
mod data_set;
#[path = "../support/film.rs"]
mod film;
#[path = "../support/kill_jobs.rs"]
mod kill_jobs;
#[path = "../support/program.rs"]
mod program;
#[path = "../support/project.rs"]
mod project;
#[path = "../support/session.rs"]
mod session;

mod adopt;
mod bedroom;
mod bricks;
mod cameras;
mod carry;
mod constrain;
mod correct;
mod crash;
mod demo_folder;
mod films;
mod floors;
mod flow;
mod following;
mod frames;
mod fuse;
mod kills;
mod long_films;
mod masks;
mod networks;
mod registry;
mod rgbd;
mod segmenter;
mod sfm;
mod sfm_failures;
mod sfm_learned;
mod shared;
mod shelf;
mod stereo;
mod stereo_made;
mod synthetic_traits;
mod tiller;
mod traits;
mod video_seeking;
mod whole_job;
mod words;

fn main() -> std::process::ExitCode {
    let modules = [
        adopt::tests(),
        bedroom::tests(),
        bricks::tests(),
        cameras::tests(),
        carry::tests(),
        constrain::tests(),
        correct::tests(),
        crash::tests(),
        demo_folder::tests(),
        floors::tests(),
        flow::tests(),
        following::tests(),
        frames::tests(),
        fuse::tests(),
        kills::tests(),
        masks::tests(),
        rgbd::tests(),
        segmenter::tests(),
        whole_job::tests(),
        sfm::tests(),
        sfm_failures::tests(),
        sfm_learned::tests(),
        shared::tests(),
        stereo::tests(),
        stereo_made::tests(),
        synthetic_traits::tests(),
        traits::tests(),
        words::tests(),
        long_films::tests(),
        video_seeking::tests(),
        films::tests(),
    ];
    registry::run(modules.into_iter().flatten().collect())
}
