use rayon::prelude::*;
use sha2::{Digest, Sha256};

use super::FeatureCache;
use super::entries::Matches;
use super::format::{KeptFeatures, Key, digest_of};
use super::keys::{are_of, begun, color_key, pixels_key};
use crate::sfm::{FeatureError, FeatureExtractor, FeatureMatcher, Features, PairMatches};
use ostra_frames::Image;

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
        self.kept_or_made(&key, [width, height], || {
            self.extractor.extract(grey, width, height, allowed)
        })
    }

    fn free_buffers(&self) {
        self.extractor.free_buffers();
    }

    fn uses_color(&self) -> bool {
        self.extractor.uses_color()
    }

    fn extract_from_image(
        &self,
        image: &Image,
        allowed: Option<&[bool]>,
    ) -> Result<Features, FeatureError> {
        let size = [image.width as usize, image.height as usize];
        if !self.uses_color() {
            return self.extract(&image.luma(), size[0], size[1], allowed);
        }
        let key = color_key(&[self.identity, self.name()], image, allowed);
        self.kept_or_made(&key, size, || {
            self.extractor.extract_from_image(image, allowed)
        })
    }
}

impl CachedExtractor<'_> {
    /// Returns the features of a key, which are made if they are not in the cache.
    fn kept_or_made(
        &self,
        key: &Key,
        [width, height]: [usize; 2],
        make: impl FnOnce() -> Result<Features, FeatureError>,
    ) -> Result<Features, FeatureError> {
        let known = self
            .cache
            .features(key, |known| are_of(&known.features, width, height));
        if let Some(known) = known {
            return Ok(known.features);
        }
        let made = KeptFeatures {
            features: make()?,
            colors: Vec::new(),
        };
        self.cache.keep_features(key, &made);
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

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;
    use crate::sfm::Descriptors;

    /// Describes an image by its first pixel.
    #[derive(Default)]
    struct FirstPixel {
        uses_color: bool,
        calls: AtomicUsize,
    }

    impl FirstPixel {
        fn features(&self, values: &[f32], width: usize, height: usize) -> Features {
            self.calls.fetch_add(1, Ordering::Relaxed);
            Features {
                width: width as u32,
                height: height as u32,
                keypoints: vec![glam::DVec2::ONE],
                scales_px: Vec::new(),
                orientations: Vec::new(),
                scores: Vec::new(),
                descriptors: Descriptors::Floats {
                    dim: values.len(),
                    values: values.to_vec(),
                },
            }
        }
    }

    impl FeatureExtractor for FirstPixel {
        fn name(&self) -> &'static str {
            "first pixel"
        }

        fn extract(
            &self,
            grey: &[f32],
            width: usize,
            height: usize,
            _: Option<&[bool]>,
        ) -> Result<Features, FeatureError> {
            Ok(self.features(&grey[..1], width, height))
        }

        fn uses_color(&self) -> bool {
            self.uses_color
        }

        fn extract_from_image(
            &self,
            image: &Image,
            allowed: Option<&[bool]>,
        ) -> Result<Features, FeatureError> {
            let (width, height) = (image.width as usize, image.height as usize);
            if !self.uses_color {
                return self.extract(&image.luma(), width, height, allowed);
            }
            let color = image.pixels[0].map(f32::from);
            Ok(self.features(&color, width, height))
        }
    }

    #[test]
    fn images_that_differ_in_colour_only_have_entries_of_their_own() {
        let scratch = tempfile::tempdir().unwrap();
        // Both have the luma 0.299 · 100.
        let images = [[100, 0, 0], [59, 21, 0]].map(|pixel| Image {
            width: 4,
            height: 4,
            pixels: vec![pixel; 16],
        });
        for (uses_color, calls, dim) in [(true, 2, 3), (false, 2, 1)] {
            let pixel = FirstPixel {
                uses_color,
                ..FirstPixel::default()
            };
            let folder = scratch.path().join(uses_color.to_string());
            for _ in 0..2 {
                let cache = FeatureCache::open(folder.clone(), 1 << 20);
                let extractor = CachedExtractor {
                    extractor: &pixel,
                    identity: "a",
                    cache: &cache,
                };
                let found = images
                    .each_ref()
                    .map(|image| extractor.extract_from_image(image, None).unwrap());
                assert_eq!(found[0].descriptors.dim(), dim);
                if uses_color {
                    assert_eq!(found[1].descriptors.as_floats().unwrap(), [59.0, 21.0, 0.0]);
                }
            }
            assert_eq!(pixel.calls.load(Ordering::Relaxed), calls, "read again");
        }
        // Grey values given as such are found again for the image.
        let pixel = FirstPixel::default();
        let cache = FeatureCache::open(scratch.path().join("false"), 1 << 20);
        let extractor = CachedExtractor {
            extractor: &pixel,
            identity: "a",
            cache: &cache,
        };
        extractor.extract(&images[0].luma(), 4, 4, None).unwrap();
        assert_eq!(pixel.calls.load(Ordering::Relaxed), 0);
    }
}
