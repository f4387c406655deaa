//! A choice of points written back: the pixels of a frame that see them.
//!
//! May use: scene::select, scene::fuse, scene::doubt, masks, frames, geometry, engine::job. Must not touch: Project, UI,
//! files.

mod blind;
mod seeing;
#[cfg(test)]
mod tests;

pub use seeing::SeeingPixels;
