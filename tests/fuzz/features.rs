//! Fuzz target for the features and matches that a project keeps for the next run.

use std::path::Path;

use glam::DVec2;
use ostra_reconstruct::sfm::matching::NearestMatcher;
use ostra_reconstruct::sfm::{
    CachedExtractor, CachedMatcher, Descriptors, FeatureCache, FeatureError, FeatureExtractor,
    FeatureMatcher, Features,
};
use sha2::{Digest, Sha256};

use crate::harness::{Seed, fuzz};

/// Size in bytes of the digest at the end of a file.
const DIGEST: usize = 32;
const WIDTH: usize = 12;
const HEIGHT: usize = 4;

/// Extractor of one feature per column, described by the column itself.
struct Columns;

impl FeatureExtractor for Columns {
    fn name(&self) -> &'static str {
        "columns"
    }

    fn extract(
        &self,
        grey: &[f32],
        width: usize,
        height: usize,
        _: Option<&[bool]>,
    ) -> Result<Features, FeatureError> {
        let column = |x: usize| (0..height).map(move |y| (grey[y * width + x] * 255.0) as u8);
        Ok(Features {
            width: width as u32,
            height: height as u32,
            keypoints: (0..width)
                .map(|x| DVec2::new(x as f64 + 0.5, 0.5))
                .collect(),
            scales_px: vec![1.5; width],
            orientations: vec![0.75; width],
            scores: vec![0.5; width],
            descriptors: Descriptors::Bytes {
                dim: height,
                values: (0..width).flat_map(column).collect(),
            },
        })
    }
}

/// Extracts and matches the features of two images, or reads them from the folder.
fn extract_and_match(folder: &Path) {
    let cache = FeatureCache::open(folder.to_owned(), 1 << 30);
    let extractor = CachedExtractor {
        extractor: &Columns,
        identity: "fuzz",
        cache: &cache,
    };
    let matcher = NearestMatcher::for_bytes();
    let matcher = CachedMatcher {
        matcher: &matcher,
        identity: "fuzz",
        cache: &cache,
    };
    let images = [1, 2].map(|step| {
        let grey: Vec<f32> = (0..WIDTH * HEIGHT)
            .map(|at| (at * at * step % 256) as f32 / 255.0)
            .collect();
        extractor.extract(&grey, WIDTH, HEIGHT, None).unwrap()
    });
    for one in &images {
        let counts = [
            one.scales_px.len(),
            one.orientations.len(),
            one.scores.len(),
            one.descriptors.len(),
        ];
        assert!(
            counts
                .iter()
                .all(|&count| count == 0 || count == one.keypoints.len())
        );
    }
    let all: Vec<&Features> = images.iter().collect();
    // Descriptors of different lengths cannot be compared; that is an error, not a panic.
    if let Ok(matches) = matcher.of_set(&all).and_then(|matches| matches(0, 1)) {
        for (first, second) in matches {
            assert!((first as usize) < images[0].keypoints.len());
            assert!((second as usize) < images[1].keypoints.len());
        }
    }
}

fn seeds() -> Vec<Seed> {
    let folder = tempfile::tempdir().unwrap();
    extract_and_match(&folder.path().join("cache"));
    let files = std::fs::read_dir(folder.path().join("cache")).unwrap();
    let mut seeds: Vec<Seed> = files
        .map(|entry| {
            let path = entry.unwrap().path();
            Seed::new(
                path.file_name().unwrap().to_str().unwrap(),
                std::fs::read(&path).unwrap(),
            )
        })
        .collect();
    seeds.sort_by(|one, other| one.path.cmp(&other.path));
    assert_eq!(seeds.len(), 3, "two images and the matches of one pair");
    seeds
}

#[test]
fn kept_features() {
    fuzz!("kept features", 2000, seeds(), |folder, seed| {
        // An attacker would also update the digest.
        let content = &seed.bytes[..seed.bytes.len().saturating_sub(DIGEST)];
        let sealed = [content, &Sha256::digest(content)[..]].concat();
        std::fs::write(folder.join(&seed.path), sealed).unwrap();
        extract_and_match(folder);
    });
}
