//! Videos through the system's ffmpeg: frame times, decoding on demand, and encoding.
//!
//! Decoding forwards continues without a restart.

mod decoder;
mod encoder;
mod probe;
mod programs;
mod search;
mod videos;

pub use encoder::{TurntableOptions, write_turntable};
pub(super) use probe::{Probed, probe};
pub(super) use videos::Videos;
pub use videos::take_video_damage;
