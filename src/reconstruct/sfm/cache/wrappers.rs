use rayon::prelude::*;
use sha2::{Digest, Sha256};

use super::FeatureCache;
use super::entries::Matches;
use super::format::{KeptFeatures, Key, digest_of};
use super::keys::{are_of, begun, pixels_key};
use crate::sfm::{FeatureError, FeatureExtractor, FeatureMatcher, Features, PairMatches};

/// An extractor with a cache: features of an image that it processed before are read instead.
pub struct CachedExtractor<'a> {
    /// Extracts features that are not cached.
    pub extractor: &'a dyn FeatureExtractor,
    /// Identifies the extractor with its options and networks.
    pub identity: &'a str,
    /// The cache.
    pub cache: &'a FeatureCache,
}

impl FeatureExtractor for CachedExtractor<'_> {
    fn name(&self) -> &'static str {
        self.extractor.name()
    }

    fn extract(
        &self,
        grey: &[f32],
        width: usize,
        height: usize,
        allowed: Option<&[bool]>,
    ) -> Result<Features, FeatureError> {
        let key = pixels_key(&[self.identity, self.name()], grey, width, height, allowed);
        if let Some(known) = self
            .cache
            .features(&key, |known| are_of(&known.features, width, height))
        {
            return Ok(known.features);
        }
        let made = KeptFeatures {
            features: self.extractor.extract(grey, width, height, allowed)?,
            colors: Vec::new(),
        };
        self.cache.keep_features(&key, &made);
        Ok(made.features)
    }
}

/// A matcher with a cache: pairs of a set that it matched before are not matched again.
pub struct CachedMatcher<'a> {
    /// Matches pairs that are not cached.
    pub matcher: &'a dyn FeatureMatcher,
    /// Identifies the matcher with its options and networks.
    pub identity: &'a str,
    /// The cache.
    pub cache: &'a FeatureCache,
}

impl FeatureMatcher for CachedMatcher<'_> {
    fn name(&self) -> &'static str {
        self.matcher.name()
    }

    fn shared_images(&self, images: &[&Features]) -> Vec<usize> {
        self.matcher.shared_images(images)
    }

    fn matches(&self, first: &Features, second: &Features) -> Result<Matches, FeatureError> {
        self.of_set(&[first, second])?(0, 1)
    }

    fn of_set<'a>(&'a self, images: &'a [&'a Features]) -> Result<PairMatches<'a>, FeatureError> {
        let (keys, matcher) = (self.keys(images), self.matcher.of_set(images)?);
        Ok(Box::new(move |first, second| {
            let key = keys.of(first, second);
            let counts = [images[first], images[second]].map(|one| one.keypoints.len());
            if let Some(known) = self.cache.pair(&key) {
                if fits(&known, counts) {
                    return Ok(known);
                }
                // The cached matches do not fit the keypoints: a file was changed.
                self.cache.note_damage();
            }
            let made = matcher(first, second)?;
            self.cache.keep_pair(key, &made);
            Ok(made)
        }))
    }
}

impl CachedMatcher<'_> {
    fn keys(&self, images: &[&Features]) -> PairKeys {
        let digests: Vec<Key> = images.par_iter().map(|one| digest_of(one)).collect();
        let mut set = begun(&[self.identity, self.matcher.name()]);
        for shared in self.matcher.shared_images(images) {
            set.update(digests[shared]);
        }
        PairKeys { set, digests }
    }
}

/// Keys of the pairs of a set of images.
struct PairKeys {
    set: Sha256,
    digests: Vec<Key>,
}

impl PairKeys {
    fn of(&self, first: usize, second: usize) -> Key {
        let mut digest = self.set.clone();
        digest.update(self.digests[first]);
        digest.update(self.digests[second]);
        digest.finalize().into()
    }
}

/// Returns whether all matches refer to existing keypoints and are in order.
fn fits(matches: &Matches, counts: [usize; 2]) -> bool {
    matches
        .iter()
        .all(|&(a, b)| (a as usize) < counts[0] && (b as usize) < counts[1])
        && matches.is_sorted_by(|one, next| one.0 < next.0)
}
