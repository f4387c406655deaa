use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::{DQuat, DVec2, DVec3};
use ostra_frames::{Frame, ImageSource, Orientation};
use ostra_geometry::{Camera, Pose, TwoViewOptions};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use sha2::{Digest, Sha256};

use super::*;
use crate::sfm::{Descriptors, FeatureError, FeatureExtractor, FeatureMatcher, Features};

const LIMIT: u64 = 1 << 30;

/// Counts its calls; returns as many features as the image is wide.
#[derive(Default)]
struct Worker {
    images: AtomicUsize,
    pairs: AtomicUsize,
    /// Number of first images that all matches depend on.
    shared: usize,
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
            orientations: vec![0.5; width],
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

    fn shared_images(&self, images: &[&Features]) -> Vec<usize> {
        (0..images.len().min(self.shared)).collect()
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
        let cache = FeatureCache::open(self.folder.clone(), LIMIT);
        let extractor = CachedExtractor {
            extractor: &self.worker,
            identity,
            cache: &cache,
        };
        extractor.extract(grey, grey.len() / 4, 4, allowed).unwrap()
    }

    fn matches(&self, features: &[&Features], pair: (usize, usize)) -> Vec<(u32, u32)> {
        let cache = FeatureCache::open(self.folder.clone(), LIMIT);
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
fn matches_are_cached_by_images_and_by_those_that_they_depend_on() {
    let scratch = tempfile::tempdir().unwrap();
    for (shared, expected) in [(0, 1), (1, 1), (2, 2)] {
        let worker = Worker {
            shared,
            ..Worker::default()
        };
        let run = Run {
            folder: scratch.path().join(format!("cache-{shared}")),
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
fn released_matches_are_read_again() {
    let scratch = tempfile::tempdir().unwrap();
    let worker = Worker::default();
    let cache = FeatureCache::open(scratch.path().join("cache"), LIMIT);
    let extractor = CachedExtractor {
        extractor: &worker,
        identity: "a",
        cache: &cache,
    };
    let matcher = CachedMatcher {
        matcher: &worker,
        identity: "a",
        cache: &cache,
    };
    let features = [0.25, 0.5].map(|shade| extractor.extract(&[shade; 24], 6, 4, None).unwrap());
    let first = matcher.matches(&features[0], &features[1]).unwrap();
    for _ in 0..2 {
        cache.release_entries();
        let again = matcher.matches(&features[0], &features[1]).unwrap();
        assert_eq!(again, first);
    }
    let made = worker.pairs.load(Ordering::Relaxed);
    assert_eq!(made, 1, "not matched again");
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
    fs::write(&whole[0].0, "short").unwrap();
    fs::write(&whole[1].0, "short").unwrap();
    let cache = FeatureCache::open(run.folder.clone(), LIMIT);
    let extractor = CachedExtractor {
        extractor: &run.worker,
        identity: "a",
        cache: &cache,
    };
    extractor.extract(&grey, 6, 4, None).unwrap();
    let warnings = cache.save();
    assert!(warnings[0].contains("2 damaged files"), "{warnings:?}");
    assert!(cache.save().is_empty(), "once");
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
    let (cache, worker) = (FeatureCache::open(folder.clone(), LIMIT), Worker::default());
    let extractor = CachedExtractor {
        extractor: &worker,
        identity: "a",
        cache: &cache,
    };
    extractor.extract(&[0.5; 24], 6, 4, None).unwrap();
    assert!(cache.save()[0].contains("not kept"), "{folder:?}");
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
    let cache = FeatureCache::open(scratch.path().join("cache"), 1200);
    let extractor = CachedExtractor {
        extractor: &worker,
        identity: "a",
        cache: &cache,
    };
    // Each takes some 300 bytes.
    (0..8).for_each(|shade| drop(extractor.extract(&[shade as f32; 24], 6, 4, None).unwrap()));
    assert!(cache.save().is_empty());
    let kept = files(&scratch.path().join("cache"));
    let bytes: u64 = kept
        .iter()
        .map(|path| fs::metadata(path).unwrap().len())
        .sum();
    assert!(!kept.is_empty() && bytes <= 1200, "{bytes}");
    assert_eq!(feature_cache_bytes(&scratch.path().join("cache")), bytes);
}

#[test]
fn folder_stays_within_its_limit_while_a_run_writes() {
    let scratch = tempfile::tempdir().unwrap();
    let (folder, worker) = (scratch.path().join("cache"), Worker::default());
    let cache = FeatureCache::open(folder.clone(), 3000);
    let extractor = CachedExtractor {
        extractor: &worker,
        identity: "a",
        cache: &cache,
    };
    for shade in 0..40 {
        drop(extractor.extract(&[shade as f32; 24], 6, 4, None).unwrap());
        let bytes = feature_cache_bytes(&folder);
        assert!(bytes <= 3000, "after {shade}: {bytes}");
    }
}

#[test]
fn limit_of_zero_keeps_nothing() {
    let scratch = tempfile::tempdir().unwrap();
    let run = Run {
        folder: scratch.path().join("cache"),
        worker: Worker::default(),
    };
    run.features("a", &[0.5; 24], None);
    let cache = FeatureCache::open(run.folder.clone(), 0);
    let extractor = CachedExtractor {
        extractor: &run.worker,
        identity: "a",
        cache: &cache,
    };
    extractor.extract(&[0.5; 24], 6, 4, None).unwrap();
    assert_eq!(run.count().0, 2, "not read");
    assert!(cache.save().is_empty());
    assert_eq!(feature_cache_bytes(&run.folder), 0);
}

#[test]
fn removal_spares_files_of_others() {
    let scratch = tempfile::tempdir().unwrap();
    let run = Run {
        folder: scratch.path().join("cache"),
        worker: Worker::default(),
    };
    let right = run.features("a", &[0.25; 24], None);
    run.matches(&[&right, &right], (0, 1));
    let foreign = run.folder.join("notes.txt");
    fs::write(&foreign, "mine").unwrap();
    let bytes = feature_cache_bytes(&run.folder);
    assert!(bytes > 0);
    assert_eq!(remove_feature_cache(&run.folder).unwrap(), bytes);
    assert_eq!(files(&run.folder), std::slice::from_ref(&foreign));
    fs::remove_file(foreign).unwrap();
    remove_feature_cache(&run.folder).unwrap();
    assert!(!run.folder.exists());
}

#[test]
fn verified_pairs_are_computed_once_also_those_without_a_geometry() {
    let scratch = tempfile::tempdir().unwrap();
    let folder = scratch.path().join("cache");
    let camera = Camera::pinhole(640, 480, [500.0; 2], [320.0, 240.0]);
    let mut random = Pcg64Mcg::seed_from_u64(5);
    let mut any = |end: f64| random.random_range(0.0..end);
    let scattered: Vec<[DVec2; 2]> = (0..40)
        .map(|_| [0; 2].map(|_| DVec2::new(any(640.0), any(480.0))))
        .collect();
    let second_from_first = Pose {
        rotation: DQuat::from_rotation_y(0.1),
        translation: DVec3::new(-1.0, 0.1, 0.05),
    };
    let moved: Vec<[DVec2; 2]> = (0..80)
        .filter_map(|_| {
            let at = DVec3::new(any(3.0) - 1.5, any(2.0) - 1.0, 4.0 + any(3.0));
            let second = second_from_first.transform(at);
            Some([camera.project(at)?, camera.project(second)?])
        })
        .collect();
    let options = TwoViewOptions::default();
    let with = |cache: Option<&FeatureCache>, matches: &[[DVec2; 2]]| {
        verified_matches(cache, [&camera, &camera], true, matches, &options)
    };
    let [of_moved, of_scattered] = [&moved, &scattered].map(|matches| with(None, matches));
    assert!(of_moved.as_ref().unwrap().inliers.len() > 60 && of_scattered.is_none());
    let cache = FeatureCache::open(folder.clone(), LIMIT);
    assert_eq!(with(Some(&cache), &moved), of_moved);
    assert_eq!(with(Some(&cache), &scattered), of_scattered);
    drop(cache);
    let kept = files(&folder);
    assert_eq!(kept.len(), 1, "{kept:?}");
    let cache = FeatureCache::open(folder.clone(), LIMIT);
    assert_eq!(with(Some(&cache), &moved), of_moved);
    assert_eq!(with(Some(&cache), &scattered), of_scattered);
    assert!(cache.save().is_empty());
    assert_eq!(files(&folder), kept, "nothing was computed");
    // Another camera is another pair.
    let wider = Camera::pinhole(640, 480, [450.0; 2], [320.0, 240.0]);
    let other = verified_matches(Some(&cache), [&wider, &camera], true, &moved, &options);
    assert_ne!(other, of_moved);
    assert!(cache.save().is_empty());
    assert_eq!(files(&folder).len(), 2);
}

#[test]
fn image_file_is_known_by_its_bytes() {
    let scratch = tempfile::tempdir().unwrap();
    let path = scratch.path().join("a.png");
    fs::write(&path, "an image").unwrap();
    let frame = |path: &Path| Frame {
        name: "a".into(),
        width: 6,
        height: 4,
        image: ImageSource::File {
            path: path.into(),
            orientation: Orientation::default(),
        },
        depth: None,
        camera: None,
    };
    let (cache, worker) = (
        FeatureCache::open(scratch.path().join("cache"), LIMIT),
        Worker::default(),
    );
    let of = |identity| CachedExtractor {
        extractor: &worker,
        identity,
        cache: &cache,
    };
    let key = of("a").image_key(&frame(&path), None).unwrap();
    assert!(!of("a").has_image(&key));
    let features = worker.extract(&[0.5; 24], 6, 4, None).unwrap();
    let colors = vec![[1, 2, 3]; 6];
    of("a").keep_image(&key, &features, &colors);
    // Another name and place, the same bytes.
    let copy = scratch.path().join("b.png");
    fs::copy(&path, &copy).unwrap();
    let key = of("a").image_key(&frame(&copy), None).unwrap();
    assert_eq!(of("a").image(&key, &frame(&copy)), Some((features, colors)));
    let others = [
        of("b").image_key(&frame(&path), None),
        of("a").image_key(&frame(&path), Some(&[true; 24])),
        {
            fs::write(&path, "an Image").unwrap();
            of("a").image_key(&frame(&path), None)
        },
    ];
    for other in others {
        assert!(!of("a").has_image(&other.unwrap()));
    }
    fs::remove_file(&path).unwrap();
    assert_eq!(of("a").image_key(&frame(&path), None), None);
}
