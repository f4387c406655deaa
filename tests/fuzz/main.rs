//! Fuzzing of every parser and of whole project folders.
//!
//! Each test is a fuzz target. `cargo test` gives every target a bounded number of random inputs.
//! Coverage-guided runs use libFuzzer for as long as requested: `tests/fuzz/run`.
//!
//! An input describes damage: which seed file to take and what to change in it ([`mutate`]). The
//! tests write the seeds themselves ([`seeds`]). So there is nothing to download, and random inputs
//! get past the first bytes of a format.

#[cfg(test)]
mod cameras;
#[cfg(test)]
mod features;
#[cfg(test)]
mod harness;
#[cfg(test)]
mod images;
#[cfg(test)]
mod masks;
#[cfg(test)]
mod mutate;
#[cfg(test)]
mod projects;
#[cfg(test)]
mod scenes;
#[cfg(test)]
mod seeds;
