//! PatchMatch on a graphics card.
//!
//! The depths equal the processor's up to the rounding that a card is free to do. A card that does
//! not fuse products into sums gives depths that are equal to the bit.
//!
//! Work that is done once per view (random start, mask, hints) stays on the processor.

mod data;
mod engine;
mod field_buffers;
mod kernels;
#[cfg(test)]
mod tests;

pub use engine::StereoEngine;
