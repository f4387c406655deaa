//! PatchMatch on a graphics card: the same depths as the processor's, up to the rounding that a card is free to
//! do. A card that does not fuse products into sums gives depths equal to the bit.
//!
//! What is done once a view (random start, mask, hints) stays on the processor.

mod data;
mod engine;
mod kernels;
mod room;
#[cfg(test)]
mod tests;

pub use engine::Engine;
