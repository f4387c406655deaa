use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::DVec2;
use sha2::{Digest, Sha256};

use super::*;
use crate::sfm::{Descriptors, FeatureError, FeatureExtractor, FeatureMatcher, Features};

/// Counts its calls; returns as many features as the image is wide.
#[derive(Default)]
struct Worker {
    images: AtomicUsize,
    pairs: AtomicUsize,
    depends_on_set: bool,
}

impl FeatureExtractor for Worker {
    fn name(&self) -> &'static str {
        "worker"
    }

    fn extract(
        &self,
        grey: &[f32],
        width: usize,
        height: usize,
        _: Option<&[bool]>,
    ) -> Result<Features, FeatureError> {
        self.images.fetch_add(1, Ordering::Relaxed);
        Ok(Features {
            width: width as u32,
            height: height as u32,
            keypoints: (0..width)
                .map(|x| DVec2::new(x as f64 + 0.25, 1.0 / 3.0))
                .collect(),
            scales_px: vec![1.5; width],
            scores: Vec::new(),
            descriptors: Descriptors::Floats {
                dim: 2,
                values: grey[..2 * width].to_vec(),
            },
        })
    }
}

impl FeatureMatcher for Worker {
    fn name(&self) -> &'static str {
        "worker"
    }

    fn depends_on_set(&self) -> bool {
        self.depends_on_set
    }

    fn matches(
        &self,
        first: &Features,
        second: &Features,
    ) -> Result<Vec<(u32, u32)>, FeatureError> {
        self.pairs.fetch_add(1, Ordering::Relaxed);
        Ok(
            (0..first.keypoints.len().min(second.keypoints.len()) as u32)
                .map(|i| (i, i))
                .collect(),
        )
    }
}

struct Run {
    folder: PathBuf,
    worker: Worker,
}

impl Run {
    fn features(&self, identity: &str, grey: &[f32], allowed: Option<&[bool]>) -> Features {
        let cache = FeatureCache::open(self.folder.clone());
        let extractor = CachedExtractor {
            extractor: &self.worker,
            identity,
            cache: &cache,
        };
        extractor.extract(grey, grey.len() / 4, 4, allowed).unwrap()
    }

    fn matches(&self, features: &[&Features], pair: (usize, usize)) -> Vec<(u32, u32)> {
        let cache = FeatureCache::open(self.folder.clone());
        let matcher = CachedMatcher {
            matcher: &self.worker,
            identity: "a",
            cache: &cache,
        };
        matcher.of_set(features).unwrap()(pair.0, pair.1).unwrap()
    }

    fn count(&self) -> (usize, usize) {
        (
            self.worker.images.load(Ordering::Relaxed),
            self.worker.pairs.load(Ordering::Relaxed),
        )
    }
}

fn files(folder: &Path) -> Vec<PathBuf> {
    fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect()
}

#[test]
fn same_image_is_extracted_once_and_others_again() {
    let scratch = tempfile::tempdir().unwrap();
    let run = Run {
        folder: scratch.path().join("cache"),
        worker: Worker::default(),
    };
    let (grey, mut other) = (vec![0.5; 24], vec![0.5; 24]);
    let first = run.features("a", &grey, None);
    assert_eq!(run.features("a", &grey, None), first);
    assert_eq!(run.count().0, 1);
    other[23] = 0.500_001;
    run.features("a", &other, None);
    run.features("b", &grey, None);
    run.features("a", &grey, Some(&[true; 24]));
    let mut allowed = [true; 24];
    allowed[3] = false;
    run.features("a", &grey, Some(&allowed));
    assert_eq!(
        run.count().0,
        5,
        "another pixel, other options, other pixels allowed"
    );
}

#[test]
fn matches_are_cached_by_images_and_by_set_if_they_depend_on_it() {
    let scratch = tempfile::tempdir().unwrap();
    for (depends_on_set, expected) in [(false, 1), (true, 2)] {
        let worker = Worker {
            depends_on_set,
            ..Worker::default()
        };
        let run = Run {
            folder: scratch.path().join(format!("cache-{depends_on_set}")),
            worker,
        };
        let images = [8, 12, 16].map(|width| {
            run.worker
                .extract(&vec![width as f32; 4 * width], width, 4, None)
                .unwrap()
        });
        let all: Vec<&Features> = images.iter().collect();
        assert_eq!(run.matches(&all, (0, 2)), run.matches(&all, (0, 2)));
        assert_eq!(run.count().1, 1);
        run.matches(&[all[0], all[2]], (0, 1));
        assert_eq!(run.count().1, expected);
    }
}

#[test]
fn damaged_or_foreign_files_are_computed_again() {
    let scratch = tempfile::tempdir().unwrap();
    let run = Run {
        folder: scratch.path().join("cache"),
        worker: Worker::default(),
    };
    let grey = vec![0.25; 24];
    let right = run.features("a", &grey, None);
    let pair = run.matches(&[&right, &right], (0, 1));
    let whole: Vec<(PathBuf, Vec<u8>)> = files(&run.folder)
        .into_iter()
        .map(|path| (path.clone(), fs::read(path).unwrap()))
        .collect();
    assert_eq!(whole.len(), 2);
    type Damage = fn(&mut Vec<u8>);
    let damages: [Damage; 4] = [
        Vec::clear,
        |bytes| bytes.truncate(bytes.len() / 2),
        |bytes| bytes[40] ^= 1,
        |bytes| bytes.push(0),
    ];
    for (number, damage) in damages.into_iter().enumerate() {
        for (path, bytes) in &whole {
            let mut bytes = bytes.clone();
            damage(&mut bytes);
            fs::write(path, bytes).unwrap();
        }
        assert_eq!(run.features("a", &grey, None), right);
        assert_eq!(run.matches(&[&right, &right], (0, 1)), pair);
        assert_eq!(run.count(), (number + 2, number + 2), "made again");
        run.features("a", &grey, None);
        run.matches(&[&right, &right], (0, 1));
        assert_eq!(run.count(), (number + 2, number + 2), "and whole again");
    }
}

#[test]
fn intact_files_of_other_images_are_not_used() {
    let scratch = tempfile::tempdir().unwrap();
    let run = Run {
        folder: scratch.path().join("cache"),
        worker: Worker::default(),
    };
    let (small, large) = (vec![0.25; 24], vec![0.25; 48]);
    let right = run.features("a", &small, None);
    let of_small = files(&run.folder).remove(0);
    run.features("a", &large, None);
    let of_large = files(&run.folder)
        .into_iter()
        .find(|path| *path != of_small)
        .unwrap();
    fs::copy(of_large, &of_small).unwrap();
    assert_eq!(run.features("a", &small, None), right);
    // The same for matches: of images with fewer keypoints than the file names.
    let wide = run.features("a", &large, None);
    run.matches(&[&wide, &wide], (0, 1));
    let is_matches = |path: &PathBuf| {
        path.file_name()
            .unwrap()
            .to_string_lossy()
            .starts_with("matches-")
    };
    let of_wide = files(&run.folder).into_iter().find(is_matches).unwrap();
    let narrow = run.matches(&[&right, &right], (0, 1));
    let mut bytes = fs::read(&of_wide).unwrap();
    let of_narrow = files(&run.folder)
        .into_iter()
        .find(|path| is_matches(path) && *path != of_wide)
        .unwrap();
    let key = fs::read(&of_narrow).unwrap()[8..40].to_vec();
    bytes[8..40].copy_from_slice(&key);
    let content = bytes.len() - 32;
    let digest = Sha256::digest(&bytes[..content]);
    bytes[content..].copy_from_slice(&digest);
    fs::write(&of_narrow, bytes).unwrap();
    assert_eq!(run.matches(&[&right, &right], (0, 1)), narrow);
}

#[test]
fn write_failures_are_reported_and_the_work_is_done() {
    let scratch = tempfile::tempdir().unwrap();
    let folder = scratch.path().join("cache");
    fs::write(&folder, "a file where the folder should be").unwrap();
    let (cache, worker) = (FeatureCache::open(folder.clone()), Worker::default());
    let extractor = CachedExtractor {
        extractor: &worker,
        identity: "a",
        cache: &cache,
    };
    extractor.extract(&[0.5; 24], 6, 4, None).unwrap();
    assert!(cache.save().unwrap().contains("not kept"), "{folder:?}");
    assert_eq!(cache.report(), None);
}

#[cfg(unix)]
#[test]
fn links_out_of_the_project_are_not_followed() {
    let scratch = tempfile::tempdir().unwrap();
    let [own, foreign] = ["project/cache", "elsewhere"].map(|name| scratch.path().join(name));
    fs::create_dir_all(own.parent().unwrap()).unwrap();
    fs::create_dir(&foreign).unwrap();
    std::os::unix::fs::symlink(&foreign, &own).unwrap();
    let run = Run {
        folder: own,
        worker: Worker::default(),
    };
    run.features("a", &[0.5; 24], None);
    run.features("a", &[0.5; 24], None);
    assert_eq!((run.count().0, files(&foreign).len()), (2, 0));
}

#[test]
fn least_recently_used_entries_are_removed() {
    let scratch = tempfile::tempdir().unwrap();
    let worker = Worker::default();
    let cache = FeatureCache::bounded(scratch.path().join("cache"), 1000);
    let extractor = CachedExtractor {
        extractor: &worker,
        identity: "a",
        cache: &cache,
    };
    // Each takes some 260 bytes.
    (0..8).for_each(|shade| drop(extractor.extract(&[shade as f32; 24], 6, 4, None).unwrap()));
    assert_eq!(cache.save(), None);
    let kept = files(&scratch.path().join("cache"));
    let bytes: u64 = kept
        .iter()
        .map(|path| fs::metadata(path).unwrap().len())
        .sum();
    assert!(!kept.is_empty() && bytes <= 1000, "{bytes}");
}
