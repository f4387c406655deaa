//! Keys of cached entries, and whether features can be those of an image.

use glam::DVec2;
use sha2::{Digest, Sha256};

use super::format::Key;
use crate::sfm::Features;
use ostra_frames::Image;

/// Increase this when the same input gives other features, matches or geometry than before.
const VERSION: u32 = 3;

/// Starts a digest with the names, each preceded by its length, so that no two lists give the same bytes.
pub(super) fn begun(names: &[&str]) -> Sha256 {
    let mut digest = Sha256::new();
    digest.update(VERSION.to_le_bytes());
    for name in names {
        digest.update((name.len() as u64).to_le_bytes());
        digest.update(name);
    }
    digest
}

/// Returns the key of the features of grey pixels.
pub(super) fn pixels_key(
    names: &[&str],
    grey: &[f32],
    width: usize,
    height: usize,
    allowed: Option<&[bool]>,
) -> Key {
    let mut digest = begun(names);
    digest.update(format!("{width}×{height} "));
    digest.update(bytemuck::cast_slice::<f32, u8>(grey));
    extend_with_allowed(&mut digest, allowed);
    digest.finalize().into()
}

/// Returns the key of the features of a colour image.
pub(super) fn color_key(names: &[&str], image: &Image, allowed: Option<&[bool]>) -> Key {
    let mut digest = begun(names);
    digest.update(format!("{}×{} RGB ", image.width, image.height));
    digest.update(image.pixels.as_flattened());
    extend_with_allowed(&mut digest, allowed);
    digest.finalize().into()
}

/// Adds the pixels where features may lie.
pub(super) fn extend_with_allowed(digest: &mut Sha256, allowed: Option<&[bool]>) {
    digest.update([u8::from(allowed.is_some())]);
    for bits in allowed.unwrap_or_default().chunks(4096) {
        digest.update(bits.iter().map(|&bit| u8::from(bit)).collect::<Vec<u8>>());
    }
}

/// Returns whether features are plausible for an image of this size: the folder may come from an untrusted source.
pub(super) fn are_of(features: &Features, width: usize, height: usize) -> bool {
    let (x_end, y_end) = (width as f64, height as f64);
    let is_inside = |at: &DVec2| (0.0..=x_end).contains(&at.x) && (0.0..=y_end).contains(&at.y);
    (features.width as usize, features.height as usize) == (width, height)
        && features.keypoints.iter().all(is_inside)
        && features
            .scales_px
            .iter()
            .chain(&features.orientations)
            .chain(&features.scores)
            .all(|value| value.is_finite())
        && features
            .descriptors
            .as_floats()
            .is_none_or(|values| values.iter().all(|value| value.is_finite()))
        && features.descriptors.len() == features.keypoints.len()
}
