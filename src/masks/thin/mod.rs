//! Thin structures (stems, wires) from a few points along them: a ridge filter, the cheapest path from point to point,
//! and the edges left and right of it.
//!
//! May use: frames, the nouns of masks. Must not touch: files, cameras, 3-D, UI.

mod crop;
mod path;
mod ribbon;
mod ridge;
mod strip;
#[cfg(test)]
mod tests;
mod trace;

pub use trace::trace;
