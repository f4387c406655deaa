//! The implementation of each `Command`: one file per group, each an `impl Session`.

mod accept;
mod attach;
mod camera_models;
mod cameras;
mod correct;
mod early_answer;
mod export;
mod export_frames;
mod export_inputs;
mod export_scene;
mod found_cameras;
mod fuse;
mod ground;
mod instances;
mod labels;
mod masks;
mod match_again;
mod open;
mod paint;
mod prompt;
mod propose;
mod range;
mod reconstruct;
mod relocate;
mod scale;
mod scaled_results;
mod stereo;
mod suggest;
mod surface;
mod track;
mod unfinished;

pub use crate::track_run::{track_request, transferred};
