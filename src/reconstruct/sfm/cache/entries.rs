//! Small results by key: many share a file, and all are in memory while a cache is open.

use std::time::{Duration, Instant};

use glam::{DQuat, DVec3};
use ostra_geometry::{Pose, TwoViewKind};
use rustc_hash::FxHashMap;

use super::format::{Key, Kind, Reader, Unusable, opened, sealed};

/// Entries are written at least this often, so that a killed run loses little.
const SAVE_EVERY: Duration = Duration::from_secs(2);

/// A result that shares a file with others.
pub(super) trait Entry: Clone {
    /// Start of the names of its files.
    const PREFIX: &'static str;
    /// First bytes of its files.
    const KIND: &'static Kind;

    /// Appends it to the bytes of a file.
    fn encode(&self, bytes: &mut Vec<u8>);

    /// Reads it; `None` if it is not whole.
    fn decode(values: &mut Reader<'_>) -> Option<Self>;
}

/// Matches of two images: (keypoint of the first, keypoint of the second).
pub(super) type Matches = Vec<(u32, u32)>;

impl Entry for Matches {
    const PREFIX: &'static str = "matches-";
    const KIND: &'static Kind = b"OSTRAMT1";

    fn encode(&self, bytes: &mut Vec<u8>) {
        bytes.extend((self.len() as u64).to_le_bytes());
        bytes.extend(
            self.iter()
                .flat_map(|&(a, b)| [a, b])
                .flat_map(u32::to_le_bytes),
        );
    }

    fn decode(values: &mut Reader<'_>) -> Option<Self> {
        let count = values.count()?;
        let numbers = values.u32s(count.checked_mul(2)?)?;
        Some(numbers.chunks_exact(2).map(|n| (n[0], n[1])).collect())
    }
}

/// What verification keeps of the geometry of two views.
#[derive(Debug, Clone, PartialEq)]
pub struct VerifiedMatches {
    /// Indices of the matches that agree, ascending.
    pub inliers: Vec<u32>,
    /// The kind of geometry that explains them.
    pub kind: TwoViewKind,
    /// `second_from_first` with a translation of length 1, if it could be determined.
    pub second_from_first: Option<Pose>,
    /// Median angle between the two rays of a match in radians.
    pub parallax: f64,
}

/// Kinds of geometry by their number in a file.
const KINDS: [TwoViewKind; 4] = [
    TwoViewKind::Calibrated,
    TwoViewKind::Uncalibrated,
    TwoViewKind::Planar,
    TwoViewKind::Panoramic,
];

/// `None` stands for a pair whose matches agree with no geometry, which takes longest to find out.
impl Entry for Option<VerifiedMatches> {
    const PREFIX: &'static str = "verified-";
    const KIND: &'static Kind = b"OSTRAVP1";

    fn encode(&self, bytes: &mut Vec<u8>) {
        let Some(found) = self else {
            bytes.extend(0_u32.to_le_bytes());
            return;
        };
        let kind = KINDS.iter().position(|&kind| kind == found.kind);
        let flags = [
            1 + kind.unwrap_or(0) as u32,
            u32::from(found.second_from_first.is_some()),
        ];
        bytes.extend(flags.iter().flat_map(|flag| flag.to_le_bytes()));
        bytes.extend(found.parallax.to_le_bytes());
        if let Some(pose) = found.second_from_first {
            let values = pose
                .rotation
                .to_array()
                .into_iter()
                .chain(pose.translation.to_array());
            bytes.extend(values.flat_map(f64::to_le_bytes));
        }
        bytes.extend((found.inliers.len() as u64).to_le_bytes());
        bytes.extend(found.inliers.iter().flat_map(|at| at.to_le_bytes()));
    }

    fn decode(values: &mut Reader<'_>) -> Option<Self> {
        let Some(number) = values.u32()?.checked_sub(1) else {
            return Some(None);
        };
        let kind = *KINDS.get(number as usize)?;
        let has_pose = values.u32()?;
        let parallax = values.f64s(1)?[0];
        let second_from_first = match has_pose {
            0 => None,
            1 => Some(pose(&values.f64s(7)?)?),
            _ => return None,
        };
        let count = values.count()?;
        let inliers = values.u32s(count)?;
        let is_sound = parallax.is_finite() && inliers.is_sorted_by(|one, next| one < next);
        is_sound.then_some(Some(VerifiedMatches {
            inliers,
            kind,
            second_from_first,
            parallax,
        }))
    }
}

fn pose(values: &[f64]) -> Option<Pose> {
    let (rotation, translation) = values.split_at_checked(4)?;
    let pose = Pose {
        rotation: DQuat::from_slice(rotation),
        translation: DVec3::from_slice(translation),
    };
    let is_rotation = (pose.rotation.length_squared() - 1.0).abs() < 1e-3;
    (is_rotation && pose.translation.is_finite()).then_some(pose)
}

/// The entries of one kind.
#[derive(Debug)]
pub(super) struct Entries<E> {
    known: FxHashMap<Key, E>,
    /// Whether those of the files have to be read again.
    pub are_released: bool,
    /// Keys of the entries that are not on the disk yet.
    unsaved: Vec<Key>,
    saved: Option<Instant>,
}

impl<E> Default for Entries<E> {
    fn default() -> Self {
        Self {
            known: FxHashMap::default(),
            are_released: false,
            unsaved: Vec::new(),
            saved: None,
        }
    }
}

impl<E: Entry> Entries<E> {
    /// Creates the entries of which those of the files are read when one is asked for.
    pub fn released() -> Self {
        Self {
            are_released: true,
            ..Self::default()
        }
    }

    /// Adds the entries of a file, except those of which a file that was loaded before has a newer one.
    pub fn load(&mut self, bytes: &[u8]) -> Result<(), Unusable> {
        let mut values = Reader(opened(bytes, E::KIND)?);
        let mut entries = Vec::new();
        while !values.0.is_empty() {
            let entry = values.key().zip(E::decode(&mut values));
            entries.push(entry.ok_or(Unusable::Damaged)?);
        }
        for (key, entry) in entries {
            self.known.entry(key).or_insert(entry);
        }
        Ok(())
    }

    pub fn get(&self, key: &Key) -> Option<&E> {
        self.known.get(key)
    }

    /// Keeps an entry; returns whether entries should be saved now.
    pub fn keep(&mut self, key: Key, entry: E) -> bool {
        self.known.insert(key, entry);
        self.unsaved.push(key);
        self.saved.get_or_insert_with(Instant::now).elapsed() > SAVE_EVERY
    }

    /// Returns the bytes of a file with the unsaved entries; `None` if there are none.
    pub fn take_unsaved(&mut self) -> Option<Vec<u8>> {
        let mut unsaved = std::mem::take(&mut self.unsaved);
        if unsaved.is_empty() {
            return None;
        }
        // In a fixed order, so that the same entries give the same file.
        unsaved.sort_unstable();
        unsaved.dedup();
        let mut bytes = E::KIND.to_vec();
        for key in unsaved {
            if let Some(entry) = self.known.get(&key) {
                bytes.extend(key);
                entry.encode(&mut bytes);
            }
        }
        self.saved = Some(Instant::now());
        Some(sealed(bytes))
    }
}
