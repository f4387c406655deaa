//! Cache of features, matches and verified pairs on the disk, shared by all runs.
//!
//! Entries are addressed by the content that they depend on. A different image, option or network
//! gives a different key, so an outdated entry is never found.

mod by_file;
mod entries;
mod files;
mod format;
mod keys;
#[cfg(test)]
mod tests;
mod verified;
mod wrappers;

pub use by_file::ImageKey;
pub use entries::VerifiedMatches;
pub use files::{FeatureCache, feature_cache_bytes, remove_feature_cache};
pub use verified::verified_matches;
pub use wrappers::{CachedExtractor, CachedMatcher};
