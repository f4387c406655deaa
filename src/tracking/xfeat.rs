use std::path::Path;

use crate::flow::{DenseFeatures, FeatureMap};
use ostra_compute::nn::{Network, NnError, Tensor, load};
use ostra_core::image::ImageSize;
use ostra_masks::MaskError;

/// Computes features of cells of 8 × 8 pixels with the XFeat network.
///
/// Potje, Cadar, Araujo, Martins, Nascimento: "XFeat: Accelerated Features for Lightweight Image
/// Matching", CVPR 2024.
#[derive(Debug)]
pub struct XFeatCells {
    network: Network,
}

/// Side of a cell in pixels.
const CELL_PX: usize = 8;
/// Image sides must be multiples of this: the network halves the image five times.
const MULTIPLE: usize = 32;

impl XFeatCells {
    /// Loads the network `xfeat` from a folder of networks.
    ///
    /// # Errors
    /// Fails if the network is not installed there or does not load, or if ONNX Runtime is missing.
    pub fn load(folder: &Path) -> Result<Self, NnError> {
        let missing = || NnError::Request("the catalogue has no file for `xfeat`".to_owned());
        Ok(Self {
            network: load(folder, "xfeat")?.pop().ok_or_else(missing)?,
        })
    }
}

impl DenseFeatures for XFeatCells {
    fn feature_map(&self, grey: &[f32], size: ImageSize) -> Result<FeatureMap, MaskError> {
        let (width, height) = (
            size.width.next_multiple_of(MULTIPLE),
            size.height.next_multiple_of(MULTIPLE),
        );
        // Repeat the last column and row up to the size that the network requires.
        let shown = (0..width * height).map(|at| {
            (at / width).min(size.height - 1) * size.width + (at % width).min(size.width - 1)
        });
        let input = Tensor::floats(&[1, 1, height, width], shown.map(|at| grey[at]).collect())?;
        let given = self.network.run(&[("input", &input)])?;
        let (columns, rows) = (width / CELL_PX, height / CELL_PX);
        let features = given
            .iter()
            .find(|output| output.shape() == [1, FeatureMap::DIM, rows, columns]);
        let path = self.network.path().display();
        let unfit = || {
            MaskError::Network(format!(
                "{path}: does not give {} values per cell",
                FeatureMap::DIM
            ))
        };
        let planes = features.ok_or_else(unfit)?.as_floats();
        Ok(FeatureMap::of_planes(
            planes,
            ImageSize::new(columns, rows),
            size,
            CELL_PX,
        ))
    }
}
