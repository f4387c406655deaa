use glam::DVec2;
use sha2::{Digest, Sha256};

use crate::sfm::{Descriptors, Features};

/// Key of a cached entry: a digest of everything that it depends on.
pub(super) type Key = [u8; 32];

/// First bytes of a file: its kind and the version of its layout.
pub(super) type Kind = [u8; 8];
/// First bytes of a file with the features of an image.
const FEATURES: &Kind = b"OSTRAFT3";
/// Length of the digest at the end of a file, in bytes.
const DIGEST: usize = 32;

/// Why the content of a file is not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Unusable {
    /// It was changed or cut off.
    Damaged,
    /// It is intact, but of another kind or version.
    OtherVersion,
}

/// Features, and the colour of the image at each; without colours if only its grey values are known.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct KeptFeatures {
    pub features: Features,
    pub colors: Vec<[u8; 3]>,
}

/// Encodes features with their key as little-endian values followed by a digest.
pub(super) fn encode_features(key: &Key, kept: &KeptFeatures) -> Vec<u8> {
    let mut bytes = FEATURES.to_vec();
    bytes.extend(key);
    bytes.extend((kept.colors.len() as u64).to_le_bytes());
    bytes.extend(kept.colors.as_flattened());
    extend_with(&kept.features, &mut bytes);
    sealed(bytes)
}

/// Returns a digest of features.
pub(super) fn digest_of(features: &Features) -> Key {
    let mut bytes = Vec::new();
    extend_with(features, &mut bytes);
    Sha256::digest(bytes).into()
}

fn extend_with(features: &Features, bytes: &mut Vec<u8>) {
    let (is_floats, dim) = (
        features.descriptors.as_floats().is_some(),
        features.descriptors.dim(),
    );
    let counts = [
        features.keypoints.len(),
        features.scales_px.len(),
        features.orientations.len(),
        features.scores.len(),
        dim,
    ];
    bytes.extend(
        [features.width, features.height, u32::from(is_floats)]
            .iter()
            .flat_map(|value| value.to_le_bytes()),
    );
    bytes.extend(
        counts
            .iter()
            .flat_map(|&count| (count as u64).to_le_bytes()),
    );
    bytes.extend(
        features
            .keypoints
            .iter()
            .flat_map(|at| [at.x, at.y])
            .flat_map(f64::to_le_bytes),
    );
    bytes.extend(
        features
            .scales_px
            .iter()
            .chain(&features.orientations)
            .chain(&features.scores)
            .flat_map(|value| value.to_le_bytes()),
    );
    match &features.descriptors {
        Descriptors::Bytes { values, .. } => bytes.extend(values),
        Descriptors::Floats { values, .. } => {
            bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        }
    }
}

/// Decodes the features of a key.
pub(super) fn decode_features(key: &Key, bytes: &[u8]) -> Result<KeptFeatures, Unusable> {
    let mut values = Reader(opened(bytes, FEATURES)?);
    // A file under the name of another one is as good as damaged.
    let is_own = values.key().as_ref() == Some(key);
    let kept = is_own.then(|| kept_features(values)).flatten();
    kept.ok_or(Unusable::Damaged)
}

fn kept_features(mut values: Reader<'_>) -> Option<KeptFeatures> {
    let count = values.count()?;
    let colors = values.take(count.checked_mul(3)?)?.as_chunks().0.to_vec();
    let features = features(values)?;
    let sizes = [0, features.keypoints.len()];
    sizes
        .contains(&count)
        .then_some(KeptFeatures { features, colors })
}

fn features(mut values: Reader<'_>) -> Option<Features> {
    let [width, height, is_floats] = [values.u32()?, values.u32()?, values.u32()?];
    let [count, scales, orientations, scores, dim] = [
        values.count()?,
        values.count()?,
        values.count()?,
        values.count()?,
        values.count()?,
    ];
    let sizes = [0, count];
    let optional = [scales, orientations, scores];
    if !optional.iter().all(|count| sizes.contains(count)) || is_floats > 1 {
        return None;
    }
    let places = values.f64s(count.checked_mul(2)?)?;
    let keypoints: Vec<DVec2> = places
        .chunks_exact(2)
        .map(|at| DVec2::new(at[0], at[1]))
        .collect();
    let (scales_px, orientations) = (values.f32s(scales)?, values.f32s(orientations)?);
    let scores = values.f32s(scores)?;
    let described = count.checked_mul(dim)?;
    let descriptors = match is_floats {
        0 => Descriptors::Bytes {
            dim,
            values: values.take(described)?.to_vec(),
        },
        _ => Descriptors::Floats {
            dim,
            values: values.f32s(described)?,
        },
    };
    let is_whole = values.0.is_empty() && keypoints.iter().all(|at| at.is_finite());
    is_whole.then_some(Features {
        width,
        height,
        keypoints,
        scales_px,
        orientations,
        scores,
        descriptors,
    })
}

pub(super) fn hex(key: &Key) -> String {
    key.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Appends the digest of a file's bytes.
pub(super) fn sealed(mut bytes: Vec<u8>) -> Vec<u8> {
    let digest = Sha256::digest(&bytes);
    bytes.extend(&digest[..]);
    bytes
}

/// Returns the bytes between kind and digest, if both are right.
pub(super) fn opened<'a>(bytes: &'a [u8], kind: &Kind) -> Result<&'a [u8], Unusable> {
    let parts = bytes
        .len()
        .checked_sub(DIGEST)
        .and_then(|length| bytes.split_at_checked(length));
    let (content, digest) = parts.ok_or(Unusable::Damaged)?;
    if Sha256::digest(content)[..] != *digest {
        return Err(Unusable::Damaged);
    }
    content.strip_prefix(kind).ok_or(Unusable::OtherVersion)
}

/// Reads little-endian values one after the other.
pub(super) struct Reader<'a>(pub &'a [u8]);

impl<'a> Reader<'a> {
    pub fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken)
    }

    pub fn u32(&mut self) -> Option<u32> {
        self.take(4)?.try_into().ok().map(u32::from_le_bytes)
    }

    pub fn key(&mut self) -> Option<Key> {
        self.take(DIGEST)?.try_into().ok()
    }

    pub fn u32s(&mut self, count: usize) -> Option<Vec<u32>> {
        let bytes = self.take(count.checked_mul(4)?)?;
        Some(
            bytes
                .as_chunks()
                .0
                .iter()
                .map(|&bytes| u32::from_le_bytes(bytes))
                .collect(),
        )
    }

    pub fn count(&mut self) -> Option<usize> {
        usize::try_from(self.take(8)?.try_into().ok().map(u64::from_le_bytes)?).ok()
    }

    pub fn f32s(&mut self, count: usize) -> Option<Vec<f32>> {
        let bytes = self.take(count.checked_mul(4)?)?;
        Some(
            bytes
                .as_chunks()
                .0
                .iter()
                .map(|&bytes| f32::from_le_bytes(bytes))
                .collect(),
        )
    }

    pub fn f64s(&mut self, count: usize) -> Option<Vec<f64>> {
        let bytes = self.take(count.checked_mul(8)?)?;
        Some(
            bytes
                .as_chunks()
                .0
                .iter()
                .map(|&bytes| f64::from_le_bytes(bytes))
                .collect(),
        )
    }
}
