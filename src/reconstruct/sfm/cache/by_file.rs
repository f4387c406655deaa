//! Features of image files by the digest of the file, so that a known image need not be decoded.

use std::io::Read;

use sha2::Digest;

use super::CachedExtractor;
use super::format::{KeptFeatures, Key};
use super::keys::{are_of, begun, extend_with_allowed};
use crate::sfm::Features;
use ostra_core::disk;
use ostra_frames::{Frame, ImageSource};

/// Key of the features of an image file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImageKey(Key);

/// Bytes of an image file that are read at a time.
const CHUNK: usize = 1 << 16;

impl CachedExtractor<'_> {
    /// Returns the key of a frame's image file and its allowed pixels.
    ///
    /// Returns `None` for frames of videos and for unreadable files.
    #[must_use]
    pub fn image_key(&self, frame: &Frame, allowed: Option<&[bool]>) -> Option<ImageKey> {
        let ImageSource::File { path, orientation } = &frame.image else {
            return None;
        };
        let mut digest = begun(&[self.identity, self.extractor.name(), "image file"]);
        digest.update(format!("{}×{} {orientation:?} ", frame.width, frame.height));
        extend_with_allowed(&mut digest, allowed);
        let (mut file, mut bytes) = (disk::open_regular(path).ok()?, vec![0; CHUNK]);
        loop {
            match file.read(&mut bytes).ok()? {
                0 => return Some(ImageKey(digest.finalize().into())),
                read => digest.update(&bytes[..read]),
            }
        }
    }

    /// Returns whether the features of an image are probably cached.
    #[must_use]
    pub fn has_image(&self, key: &ImageKey) -> bool {
        self.cache.has_features(&key.0)
    }

    /// Returns the features of a frame's image and the colour at each, if they are cached.
    #[must_use]
    pub fn image(&self, key: &ImageKey, frame: &Frame) -> Option<(Features, Vec<[u8; 3]>)> {
        let kept = self.cache.features(&key.0, |kept| is_of(kept, frame))?;
        Some((kept.features, kept.colors))
    }

    /// Returns the features of a frame's image that were returned or kept before in this run.
    ///
    /// They do not count as reused.
    #[must_use]
    pub fn image_again(&self, key: &ImageKey, frame: &Frame) -> Option<Features> {
        let kept = self
            .cache
            .read_features(&key.0, |kept| is_of(kept, frame))?;
        Some(kept.features)
    }

    /// Keeps the features of an image, with the colour at each.
    pub fn keep_image(&self, key: &ImageKey, features: &Features, colors: &[[u8; 3]]) {
        let kept = KeptFeatures {
            features: features.clone(),
            colors: colors.to_vec(),
        };
        self.cache.keep_features(&key.0, &kept);
    }
}

/// Returns whether cached features are plausible for the image of a frame.
fn is_of(kept: &KeptFeatures, frame: &Frame) -> bool {
    are_of(&kept.features, frame.width as usize, frame.height as usize)
        && kept.colors.len() == kept.features.keypoints.len()
}
