use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use rustc_hash::FxHashMap;

use super::format::{
    Key, Matches, decode_features, decode_pairs, encode_features, encode_pairs, hex,
};
use crate::sfm::Features;
use ostra_core::disk;

/// Size limit of the folder: features of about 1,500 images with 8,192 each, with their matches.
const BUDGET_BYTES: u64 = 2 << 30;
/// Larger files cannot have been written by this program.
const LARGEST_FILE: u64 = 256 << 20;
/// Limit for the matches that are read, most recently used first, because they stay in memory.
const LOADED_BYTES: u64 = 256 << 20;
/// Matches are written at least this often, so that a killed run loses little.
const SAVE_EVERY: Duration = Duration::from_secs(2);

/// Features and matches cached in a folder.
///
/// Each image has a file `features-KEY.bin`; the matches of several pairs share a file
/// `matches-KEY.bin`. A file that is missing, damaged or cannot be written only means that the work
/// is done again. When the folder exceeds its limit, the least recently used files are removed
/// first.
#[derive(Debug)]
pub struct FeatureCache {
    folder: PathBuf,
    budget_bytes: u64,
    pairs: Mutex<PairCache>,
    /// Why nothing more is written.
    failure: Mutex<Option<String>>,
    found: Counts,
    made: Counts,
}

#[derive(Debug, Default)]
struct PairCache {
    known: FxHashMap<Key, Matches>,
    /// Keys of the entries that are not on the disk yet.
    unsaved: Vec<Key>,
    saved: Option<Instant>,
}

#[derive(Debug, Default)]
struct Counts {
    images: AtomicUsize,
    pairs: AtomicUsize,
}

impl FeatureCache {
    /// Opens the cache of a folder, which need not exist yet.
    #[must_use]
    pub fn open(folder: PathBuf) -> Self {
        Self::bounded(folder, BUDGET_BYTES)
    }

    pub(super) fn bounded(folder: PathBuf, budget_bytes: u64) -> Self {
        let known = if is_own_folder(&folder) {
            read_pairs(&folder)
        } else {
            FxHashMap::default()
        };
        Self {
            folder,
            budget_bytes,
            pairs: Mutex::new(PairCache {
                known,
                ..PairCache::default()
            }),
            failure: Mutex::default(),
            found: Counts::default(),
            made: Counts::default(),
        }
    }

    /// Reports for people what was reused and what was computed; `None` if nothing was reused.
    #[must_use]
    pub fn report(&self) -> Option<String> {
        let count = |counts: &AtomicUsize| counts.load(Ordering::Relaxed);
        let [images, pairs] = [&self.found.images, &self.found.pairs].map(count);
        let [more_images, more_pairs] = [&self.made.images, &self.made.pairs].map(count);
        (images + pairs > 0).then(|| {
            format!(
                "features of {images} of {} images and matches of {pairs} of {} pairs were there from an earlier run",
                images + more_images,
                pairs + more_pairs
            )
        })
    }

    /// Writes unsaved entries and removes what exceeds the limit; returns why not everything could be kept.
    pub fn save(&self) -> Option<String> {
        self.save_pairs(&mut lock(&self.pairs));
        self.make_room();
        let failure = lock(&self.failure).clone();
        failure.map(|why| format!("features and matches are not kept for the next run: {why}"))
    }

    /// Returns the features of a key if they are cached and pass `is_right`.
    pub(super) fn features(
        &self,
        key: &Key,
        is_right: impl FnOnce(&Features) -> bool,
    ) -> Option<Features> {
        let path = self.features_path(key);
        let bytes = is_own_folder(&self.folder).then(|| read(&path)).flatten();
        let found = bytes
            .and_then(|bytes| decode_features(&bytes))
            .filter(is_right);
        let counts = if found.is_some() {
            &self.found
        } else {
            &self.made
        };
        counts.images.fetch_add(1, Ordering::Relaxed);
        if found.is_some() {
            disk::mark_used(&path);
        }
        found
    }

    pub(super) fn keep_features(&self, key: &Key, features: &Features) {
        self.write(&self.features_path(key), &encode_features(features));
    }

    pub(super) fn pair(&self, key: &Key) -> Option<Matches> {
        let found = lock(&self.pairs).known.get(key).cloned();
        let counts = if found.is_some() {
            &self.found
        } else {
            &self.made
        };
        counts.pairs.fetch_add(1, Ordering::Relaxed);
        found
    }

    pub(super) fn has_pair(&self, key: &Key) -> bool {
        lock(&self.pairs).known.contains_key(key)
    }

    pub(super) fn keep_pair(&self, key: Key, matches: &Matches) {
        let mut pairs = lock(&self.pairs);
        pairs.known.insert(key, matches.clone());
        pairs.unsaved.push(key);
        if pairs.saved.get_or_insert_with(Instant::now).elapsed() > SAVE_EVERY {
            self.save_pairs(&mut pairs);
        }
    }

    fn save_pairs(&self, pairs: &mut PairCache) {
        let unsaved = std::mem::take(&mut pairs.unsaved);
        let Some(first) = unsaved.iter().min() else {
            return;
        };
        let path = self.folder.join(format!("matches-{}.bin", hex(first)));
        let rows = unsaved
            .iter()
            .filter_map(|key| Some((key, pairs.known.get(key)?)));
        self.write(&path, &encode_pairs(rows));
        pairs.saved = Some(Instant::now());
    }

    fn features_path(&self, key: &Key) -> PathBuf {
        self.folder.join(format!("features-{}.bin", hex(key)))
    }

    /// Writing is not tried again after a failure: a full disk does not become emptier by it.
    fn write(&self, path: &Path, bytes: &[u8]) {
        let mut failure = lock(&self.failure);
        if failure.is_none() {
            let written = make_own_folder(&self.folder).and_then(|()| disk::write(path, bytes));
            *failure = written
                .err()
                .map(|error| format!("{}: {error}", self.folder.display()));
        }
    }

    fn make_room(&self) {
        if !is_own_folder(&self.folder) {
            return;
        }
        disk::remove_leftovers(&self.folder, false);
        let is_ours = |name: &OsStr| is_named(name, "features-") || is_named(name, "matches-");
        disk::remove_beyond(disk::kept_files(&self.folder, is_ours), self.budget_bytes);
    }
}

impl Drop for FeatureCache {
    fn drop(&mut self) {
        self.save_pairs(&mut lock(&self.pairs));
    }
}

/// Returns whether this is a folder of the project, not a link that leads out of it.
fn is_own_folder(folder: &Path) -> bool {
    fs::symlink_metadata(folder).is_ok_and(|about| about.is_dir())
}

fn make_own_folder(folder: &Path) -> std::io::Result<()> {
    if is_own_folder(folder) {
        return Ok(());
    }
    fs::create_dir(folder)
}

fn read_pairs(folder: &Path) -> FxHashMap<Key, Matches> {
    let (mut known, mut left) = (FxHashMap::default(), LOADED_BYTES);
    let files = disk::kept_files(folder, |name| is_named(name, "matches-"));
    for file in files.into_iter().rev() {
        let Some(rest) = left.checked_sub(file.bytes) else {
            break;
        };
        if let Some(pairs) = read(&file.path).and_then(|bytes| decode_pairs(&bytes)) {
            known.extend(pairs);
            disk::mark_used(&file.path);
            left = rest;
        }
    }
    known
}

fn is_named(name: &OsStr, start: &str) -> bool {
    name.to_str()
        .is_some_and(|name| name.starts_with(start) && name.ends_with(".bin"))
}

/// Reads a regular file of plausible size; links are not followed.
fn read(path: &Path) -> Option<Vec<u8>> {
    let about = fs::symlink_metadata(path).ok()?;
    (about.is_file() && about.len() <= LARGEST_FILE)
        .then(|| fs::read(path).ok())
        .flatten()
}

fn lock<T>(value: &Mutex<T>) -> MutexGuard<'_, T> {
    value.lock().unwrap_or_else(PoisonError::into_inner)
}
