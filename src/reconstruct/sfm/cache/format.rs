use glam::DVec2;
use sha2::{Digest, Sha256};

use crate::sfm::{Descriptors, Features};

/// Matches of two images: (keypoint of the first, keypoint of the second).
pub(super) type Matches = Vec<(u32, u32)>;

/// Key of a cached entry: a digest of everything that it depends on.
pub(super) type Key = [u8; 32];

/// First bytes of a file: its kind and the version of its layout.
const FEATURES: &[u8; 8] = b"OSTRAFT1";
const MATCHES: &[u8; 8] = b"OSTRAMT1";
const KIND: usize = FEATURES.len();
/// Length of the digest at the end of a file, in bytes.
const DIGEST: usize = 32;

/// Encodes features as little-endian values followed by their digest.
pub(super) fn encode_features(features: &Features) -> Vec<u8> {
    let mut bytes = FEATURES.to_vec();
    let (is_floats, dim) = (
        features.descriptors.as_floats().is_some(),
        features.descriptors.dim(),
    );
    let counts = [
        features.keypoints.len(),
        features.scales_px.len(),
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
            .chain(&features.scores)
            .flat_map(|value| value.to_le_bytes()),
    );
    match &features.descriptors {
        Descriptors::Bytes { values, .. } => bytes.extend(values),
        Descriptors::Floats { values, .. } => {
            bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        }
    }
    sealed(bytes)
}

/// Decodes features; `None` if the bytes are damaged or incomplete.
pub(super) fn decode_features(bytes: &[u8]) -> Option<Features> {
    let mut values = Reader(opened(bytes, FEATURES)?);
    let [width, height, is_floats] = [values.u32()?, values.u32()?, values.u32()?];
    let [count, scales, scores, dim] = [
        values.count()?,
        values.count()?,
        values.count()?,
        values.count()?,
    ];
    let sizes = [0, count];
    if !sizes.contains(&scales) || !sizes.contains(&scores) || is_floats > 1 {
        return None;
    }
    let places = values.f64s(count.checked_mul(2)?)?;
    let keypoints: Vec<DVec2> = places
        .chunks_exact(2)
        .map(|at| DVec2::new(at[0], at[1]))
        .collect();
    let (scales_px, scores) = (values.f32s(scales)?, values.f32s(scores)?);
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
        scores,
        descriptors,
    })
}

pub(super) fn encode_pairs<'a>(pairs: impl Iterator<Item = (&'a Key, &'a Matches)>) -> Vec<u8> {
    let mut bytes = MATCHES.to_vec();
    for (key, matches) in pairs {
        bytes.extend(key);
        bytes.extend((matches.len() as u64).to_le_bytes());
        bytes.extend(
            matches
                .iter()
                .flat_map(|&(a, b)| [a, b])
                .flat_map(u32::to_le_bytes),
        );
    }
    sealed(bytes)
}

/// Decodes pairs; `None` if the bytes are damaged or incomplete.
pub(super) fn decode_pairs(bytes: &[u8]) -> Option<Vec<(Key, Matches)>> {
    let mut values = Reader(opened(bytes, MATCHES)?);
    let mut pairs = Vec::new();
    while !values.0.is_empty() {
        let key: Key = values.take(DIGEST)?.try_into().ok()?;
        let count = values.count()?;
        let numbers = values
            .take(count.checked_mul(8)?)?
            .as_chunks()
            .0
            .iter()
            .map(|&bytes| u32::from_le_bytes(bytes));
        let numbers: Vec<u32> = numbers.collect();
        pairs.push((
            key,
            numbers
                .chunks_exact(2)
                .map(|pair| (pair[0], pair[1]))
                .collect(),
        ));
    }
    Some(pairs)
}

pub(super) fn hex(key: &Key) -> String {
    key.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn sealed(mut bytes: Vec<u8>) -> Vec<u8> {
    let digest = Sha256::digest(&bytes);
    bytes.extend(&digest[..]);
    bytes
}

/// Returns the bytes between kind and digest, if both are right.
fn opened<'a>(bytes: &'a [u8], kind: &[u8; KIND]) -> Option<&'a [u8]> {
    let (content, digest) = bytes.split_at_checked(bytes.len().checked_sub(DIGEST)?)?;
    (Sha256::digest(content)[..] == *digest)
        .then(|| content.strip_prefix(kind))
        .flatten()
}

struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken)
    }

    fn u32(&mut self) -> Option<u32> {
        self.take(4)?.try_into().ok().map(u32::from_le_bytes)
    }

    fn count(&mut self) -> Option<usize> {
        usize::try_from(self.take(8)?.try_into().ok().map(u64::from_le_bytes)?).ok()
    }

    fn f32s(&mut self, count: usize) -> Option<Vec<f32>> {
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

    fn f64s(&mut self, count: usize) -> Option<Vec<f64>> {
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
