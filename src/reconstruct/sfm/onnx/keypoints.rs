use std::path::Path;

use glam::DVec2;

use super::prepared::Prepared;
use crate::sfm::sift::Content;
use crate::sfm::{Descriptors, Features};
use ostra_compute::nn::{Network, NnError, Tensor, load};

/// A keypoint in a prepared picture.
pub struct Found {
    /// In pixels of the prepared picture.
    pub at: DVec2,
    /// How sure the network is, 0..1.
    pub score: f32,
}

/// A picture of which a network finds keypoints.
pub struct Picture<'a> {
    /// Columns, rows.
    pub size: (usize, usize),
    /// As the network sees it.
    pub shown: Prepared,
    allowed: Option<&'a [bool]>,
    content: Content,
}

impl<'a> Picture<'a> {
    /// A grey picture, prepared with sides of at most `max_side` pixels that are multiples of `multiple`; keypoints only
    /// where `allowed` is true, and not in bars beside the picture.
    pub fn new(
        grey: &[f32],
        size: (usize, usize),
        allowed: Option<&'a [bool]>,
        (max_side, multiple): (usize, usize),
    ) -> Self {
        let shown = Prepared::new(grey, size, max_side, multiple);
        Self {
            size,
            shown,
            allowed,
            content: Content::of(grey, size.0, size.1),
        }
    }

    /// The `most` strongest keypoints, of equal ones the first; those that are described by `around` pixels of the prepared
    /// picture lie as far from a bar.
    pub fn strongest(
        &self,
        found: impl Iterator<Item = Found>,
        most: usize,
        around: f32,
    ) -> Vec<Found> {
        let around = around * self.shown.original_from_here.max_element() as f32;
        let mut found: Vec<Found> = found
            .filter(|found| self.allows(found.at, around))
            .collect();
        found.sort_by(|a, b| b.score.total_cmp(&a.score));
        found.truncate(most);
        found
    }

    fn allows(&self, at: DVec2, around: f32) -> bool {
        let px = at * self.shown.original_from_here;
        let (x, y) = (
            (px.x as usize).min(self.size.0 - 1),
            (px.y as usize).min(self.size.1 - 1),
        );
        self.allowed.is_none_or(|mask| mask[y * self.size.0 + x])
            && self.content.holds(px.as_vec2(), around)
    }

    /// What was found, with descriptors of `dim` values that `describe` writes for a position in the prepared picture.
    pub fn features(
        &self,
        found: &[Found],
        dim: usize,
        describe: impl Fn(DVec2, &mut [f32]),
    ) -> Features {
        let mut values = vec![0.0; found.len() * dim];
        found
            .iter()
            .zip(values.chunks_exact_mut(dim))
            .for_each(|(found, row)| describe(found.at, row));
        Features {
            width: self.size.0 as u32,
            height: self.size.1 as u32,
            keypoints: found
                .iter()
                .map(|found| found.at * self.shown.original_from_here)
                .collect(),
            scales_px: Vec::new(),
            scores: found.iter().map(|found| found.score).collect(),
            descriptors: Descriptors::Floats { dim, values },
        }
    }

    /// What a network says of the picture, in planes as many as told per output, one value per cell of `cell` pixels.
    ///
    /// # Errors
    /// Where it gives something else.
    pub fn run<const N: usize>(
        &self,
        network: &Network,
        input: &str,
        planes: [usize; N],
        cell: usize,
    ) -> Result<[Tensor; N], NnError> {
        let shown = &self.shown;
        let given = Tensor::floats(&[1, 1, shown.height, shown.width], shown.grey.clone())?;
        let given = network.run(&[(input, &given)])?;
        let expected =
            planes.map(|planes| vec![1, planes, shown.height / cell, shown.width / cell]);
        let shapes: Vec<&[usize]> = given.iter().map(Tensor::shape).collect();
        let what = format!("gives {shapes:?} where {expected:?} are expected");
        let mismatch = || NnError::Mismatch {
            path: network.path().to_owned(),
            what,
        };
        if shapes != expected {
            return Err(mismatch());
        }
        <[Tensor; N]>::try_from(given).map_err(|_| mismatch())
    }
}

/// The network of an entry that has one file.
pub fn load_only(folder: &Path, name: &str) -> Result<Network, NnError> {
    let missing = || NnError::Request(format!("the catalogue has no file for `{name}`"));
    load(folder, name)?.pop().ok_or_else(missing)
}
