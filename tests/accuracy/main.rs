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

#[path = "../support/book_pages.rs"]
mod book_pages;
#[path = "../support/crash_child.rs"]
#[cfg_attr(unix, expect(dead_code, reason = "the quick tests fill the disk"))]
mod crash_child;
#[path = "../support/data.rs"]
mod data;
#[path = "../support/data_set.rs"]
mod data_set;
#[path = "../support/kill_jobs.rs"]
mod kill_jobs;
#[path = "../support/program.rs"]
mod program;
#[path = "../support/project.rs"]
mod project;
#[path = "../support/session.rs"]
mod session;
#[path = "../support/video.rs"]
mod video;

mod attach;
mod auto_segmenter;
mod bedroom;
mod book_commands;
mod book_images;
mod bricks;
mod cameras;
mod constrain;
mod correct;
mod crash;
mod demo_folder;
mod floors;
mod flow;
mod following;
mod frames;
mod fuse;
mod kills;
mod large_sets;
mod long_videos;
mod masks;
mod networks;
mod registry;
mod reprojection;
mod rgbd;
mod segmenter;
mod sfm;
mod sfm_failures;
mod sfm_learned;
mod shared;
mod shelf;
mod stereo;
mod synthetic_stereo;
mod synthetic_traits;
mod text_prompts;
mod tiller;
mod traits;
mod tutorials;
mod video_seeking;
mod videos;
mod whole_job;

fn main() -> std::process::ExitCode {
    let modules = [
        attach::tests(),
        auto_segmenter::tests(),
        bedroom::tests(),
        book_commands::tests(),
        book_images::tests(),
        bricks::tests(),
        cameras::tests(),
        reprojection::tests(),
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
        large_sets::tests(),
        masks::tests(),
        rgbd::tests(),
        segmenter::tests(),
        whole_job::tests(),
        sfm::tests(),
        sfm_failures::tests(),
        sfm_learned::tests(),
        shared::tests(),
        stereo::tests(),
        synthetic_stereo::tests(),
        synthetic_traits::tests(),
        traits::tests(),
        text_prompts::tests(),
        long_videos::tests(),
        tutorials::tests(),
        video_seeking::tests(),
        videos::tests(),
    ];
    registry::run(modules.into_iter().flatten().collect())
}
