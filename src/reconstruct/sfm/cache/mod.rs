//! Cache of features and matches on the disk, shared by all runs.
//!
//! Entries are addressed by the content that they depend on. A different pixel, option or network
//! gives a different key, so an outdated entry is never found.

mod files;
mod format;
#[cfg(test)]
mod tests;
mod wrappers;

pub use files::FeatureCache;
pub use wrappers::{CachedExtractor, CachedMatcher};
