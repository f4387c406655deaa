use std::sync::Arc;

use super::appearance::Palette;
use super::depth_completion::completed;
use super::depth_surfaces::{DepthSurfaces, depth_edges};
use super::edge_map::edge_map;
use super::graph::RegionGraph;
use super::over_segmentation::{RegionOptions, partition};
use super::prepared::{FlatImage, Prepared};
use super::raster::{Raster, reduced_depth, reduced_image, reduction};
use crate::lab::lab_of;
use crate::{MaskError, PreparedFrame, Segmenter};
use ostra_core::job::Progress;
use ostra_frames::{DepthMap, Image};

/// Graph cut over colour, texture and, if available, depth edges; needs no network weights.
#[derive(Debug, Clone, Copy, Default)]
pub struct BuiltinSegmenter;

impl Segmenter for BuiltinSegmenter {
    fn name(&self) -> &'static str {
        "builtin"
    }

    fn prepare(
        &self,
        image: &Arc<Image>,
        depth: Option<&Arc<DepthMap>>,
        progress: &Progress,
    ) -> Result<Arc<dyn PreparedFrame>, MaskError> {
        Ok(Arc::new(prepare(
            image,
            depth.map(AsRef::as_ref),
            progress,
        )?))
    }
}

/// Computes everything that depends only on the frame, once per frame.
pub(super) fn prepare(
    image: &Arc<Image>,
    depth: Option<&DepthMap>,
    progress: &Progress,
) -> Result<Prepared, MaskError> {
    let (width, height) = (image.width as usize, image.height as usize);
    if width == 0 || height == 0 || image.pixels.len() != width * height {
        return Err(MaskError::Request(format!(
            "an image of {width}×{height} cannot be segmented; open another"
        )));
    }
    if let Some(depth) =
        depth.filter(|depth| (depth.width, depth.height) != (image.width, image.height))
    {
        return Err(MaskError::Request(format!(
            "the depth map is {}×{}, the image {width}×{height}; give depth of the image's size",
            depth.width, depth.height
        )));
    }
    let factor = reduction(width, height);
    if factor == 1 {
        return prepare_reduced(image, image, depth, factor, progress);
    }
    let depth = depth.map(|depth| reduced_depth(depth, factor));
    let reduced = Arc::new(reduced_image(image, factor));
    prepare_reduced(image, &reduced, depth.as_ref(), factor, progress)
}

/// Computes regions on `reduced`, then transfers them to `image`, which is `factor` times as large.
fn prepare_reduced(
    image: &Arc<Image>,
    reduced: &Arc<Image>,
    depth: Option<&DepthMap>,
    factor: usize,
    progress: &Progress,
) -> Result<Prepared, MaskError> {
    const STAGES: usize = 5;
    let (width, height) = (reduced.width as usize, reduced.height as usize);
    progress.step(0, STAGES)?;
    let lab = lab_of(reduced);
    progress.step(1, STAGES)?;
    let measured = depth;
    let depth = measured.map(|depth| completed(depth, &lab));
    let depth = depth
        .as_ref()
        .map(|depth| (depth, DepthSurfaces::new(depth)));
    let depth = depth.as_ref().map(|(depth, surfaces)| (*depth, surfaces));
    let jumps = depth.map(|(depth, surfaces)| (depth_edges(depth), surfaces));
    let edges = edge_map(
        &lab,
        width,
        height,
        jumps.as_ref().map(|(jumps, surfaces)| (jumps, *surfaces)),
    );
    progress.step(2, STAGES)?;
    // Depth separates objects too small for colour; they need regions of their own.
    let area_px = RegionOptions::default().area_px;
    let options = RegionOptions {
        area_px: if depth.is_some() {
            area_px * 2 / 3
        } else {
            area_px
        },
        ..RegionOptions::default()
    };
    let smooth = depth.map(|(_, surfaces)| surfaces.mean(&lab, 1));
    let partition = partition(
        smooth.as_ref().unwrap_or(&lab),
        depth,
        &edges,
        width,
        &options,
    );
    progress.step(3, STAGES)?;
    let graph = RegionGraph::new(&partition, &lab, depth, measured, width);
    let palette = Palette::new(&graph.regions);
    progress.step(4, STAGES)?;
    let raster = Raster::new(image, factor, partition.of_pixel, &graph.regions, progress)?;
    progress.step(STAGES, STAGES)?;
    let flat = depth.is_none().then(|| FlatImage {
        image: Arc::clone(image),
        reduced: Arc::clone(reduced),
    });
    Ok(Prepared {
        raster,
        graph,
        palette,
        flat,
    })
}
