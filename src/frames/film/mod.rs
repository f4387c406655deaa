//! Films through the system's ffmpeg: when their pictures are, and decoding them on demand, forwards without restart.
//!
//! May use: the nouns of frames. Must not touch: how frames are named or cached.

mod decoder;
mod films;
mod probe;
mod programs;

pub(super) use films::Films;
pub(super) use probe::{Probed, probe};
