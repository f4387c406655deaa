//! Videos through the system's ffmpeg: frame times, decoding on demand, and encoding.
//!
//! Decoding forwards continues without a restart.

mod decoder;
mod encoder;
mod films;
mod probe;
mod programs;
mod search;

pub use encoder::{FilmOptions, write_film};
pub(super) use films::Films;
pub use films::take_video_damage;
pub(super) use probe::{Probed, probe};
