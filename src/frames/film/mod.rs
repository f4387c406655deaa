//! Videos through the system's ffmpeg: when their images are, decoding them on demand, forwards without restart, and
//! making them.

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
