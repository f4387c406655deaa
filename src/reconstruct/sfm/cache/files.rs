use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use sha2::{Digest, Sha256};

use super::entries::{Entries, Entry, Matches, VerifiedMatches};
use super::format::{KeptFeatures, Key, Unusable, decode_features, encode_features, hex};
use ostra_core::disk;

/// Larger files cannot have been written by this program.
const LARGEST_FILE: u64 = 256 << 20;
/// Limit for the entries of a kind that are read, most recently used first, because they stay in memory.
const LOADED_BYTES: u64 = 256 << 20;
/// Share of the limit after whose growth the size is checked again.
const CHECKED_SHARE: u64 = 16;

/// Features, matches and verified pairs in a folder.
///
/// The features of an image are in a file `features-KEY.bin`. Matches and verified pairs are in files
/// of many entries each. A file that is missing, damaged or cannot be
/// written only means that the work is done again. When the folder exceeds its limit, the least
/// recently used files are removed first.
#[derive(Debug)]
pub struct FeatureCache {
    folder: PathBuf,
    limit_bytes: u64,
    matches: Mutex<Entries<Matches>>,
    verified: Mutex<Entries<Option<VerifiedMatches>>>,
    /// Why nothing more is written.
    failure: Mutex<Option<String>>,
    /// Number of files that were damaged.
    damaged: AtomicUsize,
    /// Bytes written since the size was checked.
    unchecked_bytes: AtomicU64,
    found: Counts,
    made: Counts,
}

#[derive(Debug, Default)]
struct Counts {
    images: AtomicUsize,
    pairs: AtomicUsize,
}

impl FeatureCache {
    /// Opens the cache of a folder, which need not exist yet, with its limit in bytes.
    ///
    /// With a limit of 0, nothing is read or kept.
    #[must_use]
    pub fn open(folder: PathBuf, limit_bytes: u64) -> Self {
        let cache = Self {
            folder,
            limit_bytes,
            matches: Mutex::default(),
            verified: Mutex::default(),
            failure: Mutex::default(),
            damaged: AtomicUsize::new(0),
            unchecked_bytes: AtomicU64::new(0),
            found: Counts::default(),
            made: Counts::default(),
        };
        if cache.is_readable() {
            cache.load(&mut lock(&cache.matches));
            cache.load(&mut lock(&cache.verified));
        }
        cache
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

    /// Writes unsaved entries and removes what exceeds the limit.
    ///
    /// Returns warnings for people: files that were damaged, and why not everything could be kept.
    #[must_use]
    pub fn save(&self) -> Vec<String> {
        self.save_entries();
        if is_own_folder(&self.folder) {
            disk::remove_leftovers(&self.folder, false);
            self.make_room();
        }
        let damaged = self.damaged.swap(0, Ordering::Relaxed);
        let what = match damaged {
            1 => "file was not used; its",
            _ => "files were not used; their",
        };
        let damage = (damaged > 0).then(|| {
            format!(
                "{}: {damaged} damaged {what} features and matches were computed again",
                self.folder.display()
            )
        });
        let failure = lock(&self.failure).clone();
        let failure =
            failure.map(|why| format!("features and matches are not kept for the next run: {why}"));
        damage.into_iter().chain(failure).collect()
    }

    /// Frees the matches and verified pairs in memory; they are read again when one is asked for.
    pub fn release_entries(&self) {
        self.save_entries();
        if self.is_readable() && lock(&self.failure).is_none() {
            *lock(&self.matches) = Entries::released();
            *lock(&self.verified) = Entries::released();
        }
    }

    /// Returns the features of a key if they are cached and pass `is_right`.
    pub(super) fn features(
        &self,
        key: &Key,
        is_right: impl FnOnce(&KeptFeatures) -> bool,
    ) -> Option<KeptFeatures> {
        let found = self.read_features(key, is_right);
        let counts = if found.is_some() {
            &self.found
        } else {
            &self.made
        };
        counts.images.fetch_add(1, Ordering::Relaxed);
        found
    }

    pub(super) fn read_features(
        &self,
        key: &Key,
        is_right: impl FnOnce(&KeptFeatures) -> bool,
    ) -> Option<KeptFeatures> {
        let path = self.features_path(key);
        let bytes = self.is_readable().then(|| read(&path)).flatten()?;
        let decoded = decode_features(key, &bytes);
        match decoded.and_then(|kept| is_right(&kept).then_some(kept).ok_or(Unusable::Damaged)) {
            Ok(kept) => {
                disk::mark_used(&path);
                Some(kept)
            }
            Err(why) => {
                self.remove_unusable(&path, why);
                None
            }
        }
    }

    /// Returns whether there is a file with the features of a key, which may be damaged.
    pub(super) fn has_features(&self, key: &Key) -> bool {
        self.is_readable() && self.features_path(key).exists()
    }

    pub(super) fn keep_features(&self, key: &Key, kept: &KeptFeatures) {
        self.write(&self.features_path(key), &encode_features(key, kept));
    }

    pub(super) fn pair(&self, key: &Key) -> Option<Matches> {
        let found = self.loaded(&self.matches).get(key).cloned();
        let counts = if found.is_some() {
            &self.found
        } else {
            &self.made
        };
        counts.pairs.fetch_add(1, Ordering::Relaxed);
        found
    }

    pub(super) fn keep_pair(&self, key: Key, matches: &Matches) {
        self.keep(&self.matches, key, matches.clone());
    }

    pub(super) fn verified(&self, key: &Key) -> Option<Option<VerifiedMatches>> {
        self.loaded(&self.verified).get(key).cloned()
    }

    pub(super) fn keep_verified(&self, key: Key, verified: Option<VerifiedMatches>) {
        self.keep(&self.verified, key, verified);
    }

    fn keep<E: Entry>(&self, entries: &Mutex<Entries<E>>, key: Key, entry: E) {
        let mut entries = lock(entries);
        if entries.keep(key, entry) {
            self.write_unsaved(&mut entries);
        }
    }

    fn save_entries(&self) {
        self.write_unsaved(&mut lock(&self.matches));
        self.write_unsaved(&mut lock(&self.verified));
    }

    fn write_unsaved<E: Entry>(&self, entries: &mut Entries<E>) {
        if let Some(bytes) = entries.take_unsaved() {
            let name = file_name(E::PREFIX, &Sha256::digest(&bytes).into());
            self.write(&self.folder.join(name), &bytes);
        }
    }

    /// Returns the entries, which are read from the files again if they were released.
    fn loaded<'a, E: Entry>(&self, entries: &'a Mutex<Entries<E>>) -> MutexGuard<'a, Entries<E>> {
        let mut entries = lock(entries);
        if std::mem::take(&mut entries.are_released) && self.is_readable() {
            self.load(&mut entries);
        }
        entries
    }

    fn load<E: Entry>(&self, entries: &mut Entries<E>) {
        let mut left = LOADED_BYTES;
        let files = disk::kept_files(&self.folder, |name| is_named(name, E::PREFIX));
        for file in files.into_iter().rev() {
            let Some(rest) = left.checked_sub(file.bytes) else {
                break;
            };
            let Some(bytes) = read(&file.path) else {
                continue;
            };
            match entries.load(&bytes) {
                Ok(()) => {
                    disk::mark_used(&file.path);
                    left = rest;
                }
                Err(why) => self.remove_unusable(&file.path, why),
            }
        }
    }

    fn remove_unusable(&self, path: &Path, why: Unusable) {
        match why {
            Unusable::Damaged => self.remove_damaged(path),
            Unusable::OtherVersion => drop(fs::remove_file(path)),
        }
    }

    /// Counts an entry that cannot be right: its file was changed.
    pub(super) fn note_damage(&self) {
        self.damaged.fetch_add(1, Ordering::Relaxed);
    }

    fn remove_damaged(&self, path: &Path) {
        self.note_damage();
        let _ = fs::remove_file(path);
    }

    fn features_path(&self, key: &Key) -> PathBuf {
        self.folder.join(file_name(FEATURES, key))
    }

    fn is_readable(&self) -> bool {
        self.limit_bytes > 0 && is_own_folder(&self.folder)
    }

    /// Writing is not tried again after a failure: a full disk does not become emptier by it.
    fn write(&self, path: &Path, bytes: &[u8]) {
        if self.limit_bytes == 0 {
            return;
        }
        let mut failure = lock(&self.failure);
        if failure.is_none() {
            let written = make_own_folder(&self.folder).and_then(|()| disk::write(path, bytes));
            *failure = written
                .err()
                .map(|error| format!("{}: {error}", self.folder.display()));
        }
        let more = bytes.len() as u64;
        let unchecked = self.unchecked_bytes.fetch_add(more, Ordering::Relaxed) + more;
        if unchecked > self.limit_bytes / CHECKED_SHARE && is_own_folder(&self.folder) {
            self.unchecked_bytes.store(0, Ordering::Relaxed);
            self.make_room();
        }
    }

    fn make_room(&self) {
        disk::remove_beyond(disk::kept_files(&self.folder, is_ours), self.limit_bytes);
    }
}

impl Drop for FeatureCache {
    fn drop(&mut self) {
        self.save_entries();
    }
}

/// Returns the size of the cache of a folder in bytes.
#[must_use]
pub fn feature_cache_bytes(folder: &Path) -> u64 {
    if !is_own_folder(folder) {
        return 0;
    }
    let files = disk::kept_files(folder, is_ours);
    files.iter().map(|file| file.bytes).sum()
}

/// Removes the files of the cache of a folder, and the folder if nothing else is in it.
///
/// Returns the number of bytes that became free.
///
/// # Errors
/// Returns the error of the first file that cannot be removed.
pub fn remove_feature_cache(folder: &Path) -> std::io::Result<u64> {
    if !is_own_folder(folder) {
        return Ok(0);
    }
    let mut bytes = 0;
    for file in disk::kept_files(folder, is_ours) {
        fs::remove_file(&file.path)?;
        bytes += file.bytes;
    }
    disk::remove_leftovers(folder, false);
    // Files of others stay, and with them the folder.
    let _ = fs::remove_dir(folder);
    Ok(bytes)
}

/// Start of the names of files with the features of an image.
const FEATURES: &str = "features-";

fn is_ours(name: &OsStr) -> bool {
    let prefixes = [FEATURES, Matches::PREFIX, Option::<VerifiedMatches>::PREFIX];
    prefixes.iter().any(|prefix| is_named(name, prefix))
}

fn file_name(prefix: &str, key: &Key) -> String {
    format!("{prefix}{}.bin", hex(key))
}

fn is_named(name: &OsStr, prefix: &str) -> bool {
    name.to_str()
        .is_some_and(|name| name.starts_with(prefix) && name.ends_with(".bin"))
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
