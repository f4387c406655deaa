use glam::DVec2;
use sha2::{Digest, Sha256};

use super::FeatureCache;
use super::format::{Key, Matches, encode_features};
use crate::sfm::{FeatureError, FeatureExtractor, FeatureMatcher, Features, PairMatches};

/// Increase this when the same input gives other features or matches than before.
const VERSION: u32 = 1;

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
        let mut digest = begun(&[self.identity, self.extractor.name()]);
        digest.update(format!("{width}×{height} {} ", allowed.is_some()));
        digest.update(bytemuck::cast_slice::<f32, u8>(grey));
        let bits = allowed.unwrap_or_default().chunks(4096);
        bits.for_each(|bits| {
            digest.update(bits.iter().map(|&bit| u8::from(bit)).collect::<Vec<u8>>());
        });
        let key: Key = digest.finalize().into();
        if let Some(known) = self
            .cache
            .features(&key, |known| are_of(known, width, height))
        {
            return Ok(known);
        }
        let made = self.extractor.extract(grey, width, height, allowed)?;
        self.cache.keep_features(&key, &made);
        Ok(made)
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

    fn depends_on_set(&self) -> bool {
        self.matcher.depends_on_set()
    }

    fn matches(&self, first: &Features, second: &Features) -> Result<Matches, FeatureError> {
        self.matcher.matches(first, second)
    }

    fn of_set<'a>(&'a self, images: &'a [&'a Features]) -> Result<PairMatches<'a>, FeatureError> {
        Ok(self.cached(
            self.keys(images),
            images,
            Some(self.matcher.of_set(images)?),
        ))
    }

    fn of_pairs<'a>(
        &'a self,
        images: &'a [&'a Features],
        pairs: &[(usize, usize)],
    ) -> Result<PairMatches<'a>, FeatureError> {
        let keys = self.keys(images);
        let is_known =
            |&(first, second): &(usize, usize)| self.cache.has_pair(&keys.of(first, second));
        // The shared data of a set is only computed if some pair is unknown. It is computed outside
        // the closure, which runs in parallel: a parallel job that waits for another one can end up
        // waiting for itself.
        let needs_matcher = !pairs.iter().all(is_known);
        let matcher = needs_matcher
            .then(|| self.matcher.of_pairs(images, pairs))
            .transpose()?;
        Ok(self.cached(keys, images, matcher))
    }
}

impl CachedMatcher<'_> {
    fn keys(&self, images: &[&Features]) -> PairKeys {
        let digests: Vec<Key> = images
            .iter()
            .map(|one| Sha256::digest(encode_features(one)).into())
            .collect();
        let mut set = begun(&[self.identity, self.matcher.name()]);
        if self.matcher.depends_on_set() {
            digests.iter().for_each(|digest| set.update(digest));
        }
        PairKeys { set, digests }
    }

    fn cached<'a>(
        &'a self,
        keys: PairKeys,
        images: &'a [&'a Features],
        matcher: Option<PairMatches<'a>>,
    ) -> PairMatches<'a> {
        Box::new(move |first, second| {
            let key = keys.of(first, second);
            let counts = [images[first], images[second]].map(|one| one.keypoints.len());
            if let Some(known) = self.cache.pair(&key).filter(|known| fits(known, counts)) {
                return Ok(known);
            }
            let made = match &matcher {
                Some(matcher) => matcher(first, second)?,
                // The cached matches do not fit the keypoints: a file was changed.
                None => self.matcher.matches(images[first], images[second])?,
            };
            self.cache.keep_pair(key, &made);
            Ok(made)
        })
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

/// Returns whether features are plausible for an image of this size: the folder may come from an untrusted source.
fn are_of(features: &Features, width: usize, height: usize) -> bool {
    let (x_end, y_end) = (width as f64, height as f64);
    let is_inside = |at: &DVec2| (0.0..=x_end).contains(&at.x) && (0.0..=y_end).contains(&at.y);
    (features.width as usize, features.height as usize) == (width, height)
        && features.keypoints.iter().all(is_inside)
        && features
            .scales_px
            .iter()
            .chain(&features.scores)
            .all(|value| value.is_finite())
        && features
            .descriptors
            .as_floats()
            .is_none_or(|values| values.iter().all(|value| value.is_finite()))
        && features.descriptors.len() == features.keypoints.len()
}

/// Returns whether all matches refer to existing keypoints and are in order.
fn fits(matches: &Matches, counts: [usize; 2]) -> bool {
    matches
        .iter()
        .all(|&(a, b)| (a as usize) < counts[0] && (b as usize) < counts[1])
        && matches.is_sorted_by(|one, next| one.0 < next.0)
}

/// Starts a digest with the names, each preceded by its length, so that no two lists give the same bytes.
fn begun(names: &[&str]) -> Sha256 {
    let mut digest = Sha256::new();
    digest.update(VERSION.to_le_bytes());
    for name in names {
        digest.update((name.len() as u64).to_le_bytes());
        digest.update(name);
    }
    digest
}
