//! Features and matches that are kept on the disk from one run to the next, by the content that they were made of: a
//! pixel, an option or a network that differs makes another key, so nothing outdated is ever found.

mod files;
mod format;
#[cfg(test)]
mod tests;
mod wrappers;

pub use files::FeatureCache;
pub use wrappers::{CachedExtractor, CachedMatcher};
