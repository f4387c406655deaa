//! A choice of points written back: the pixels of a frame that see them.

mod blind;
mod seeing;
#[cfg(test)]
mod tests;

pub use seeing::SeeingPixels;
