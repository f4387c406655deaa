//! Thin structures (stems, wires) from a few points along them: a ridge filter, the cheapest path from point to point,
//! and the edges left and right of it.

mod path;
mod ribbon;
mod ridge;
#[cfg(test)]
mod tests;
mod trace;

pub use trace::trace;
