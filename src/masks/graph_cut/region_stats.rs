//! Statistics of regions, and borders between two regions.

use rayon::prelude::*;

use super::box_filter::box_mean;
use super::depth_surfaces::known;
use super::over_segmentation::Partition;
use ostra_frames::DepthMap;

/// Means over one region.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct RegionStats {
    /// Area, pixels.
    pub area: f32,
    /// Mean Lab colour.
    pub lab: [f32; 3],
    /// Mean Lab colour of the surface around its pixels; only with depth.
    pub tone: [f32; 3],
    /// Standard deviation of lightness around its pixels, L units.
    ///
    /// Low on smooth surfaces, high in texture.
    pub texture: f32,
    /// Mean position, pixels.
    pub at: [f32; 2],
    /// Mean ln depth; NaN where depth is unknown.
    pub ln_depth: f32,
    /// Whether the depth of nearly all of its pixels was measured rather than filled in.
    pub measured: bool,
    /// Length on the image's border, pixel sides.
    pub rim: f32,
}

/// A border between two regions.
#[derive(Debug, Clone, Copy)]
pub(super) struct Edge {
    pub a: u32,
    pub b: u32,
    /// Length, pixel sides.
    pub length: f32,
    /// Probability that an object ends here, 0–1.
    pub strength: f32,
}

/// Returns the statistics of every region.
pub(super) fn stats(
    partition: &Partition,
    lab: &[[f32; 3]],
    depth: Option<&DepthMap>,
    width: usize,
    height: usize,
) -> Vec<RegionStats> {
    let moments: Vec<[f32; 2]> = lab
        .par_iter()
        .map(|lab| [lab[0], lab[0] * lab[0]])
        .collect();
    let moments = box_mean(&moments, width, height, 3);
    let mut regions = vec![RegionStats::default(); partition.count];
    let mut depth_area = vec![0.0f32; partition.count];
    for (at, &of) in partition.of_pixel.iter().enumerate() {
        let (x, y) = (at % width, at / width);
        let region = &mut regions[of as usize];
        region.area += 1.0;
        (0..3).for_each(|channel| region.lab[channel] += lab[at][channel]);
        region.texture += (moments[at][1] - moments[at][0] * moments[at][0])
            .max(0.0)
            .sqrt();
        region.at[0] += x as f32;
        region.at[1] += y as f32;
        region.rim += f32::from(
            u8::from(x == 0)
                + u8::from(x + 1 == width)
                + u8::from(y == 0)
                + u8::from(y + 1 == height),
        );
        if let Some(depth) = depth
            .map(|depth| depth.depths[at])
            .filter(|&depth| known(depth))
        {
            region.ln_depth += depth.ln();
            depth_area[of as usize] += 1.0;
        }
    }
    for (region, depth_area) in regions.iter_mut().zip(depth_area) {
        region.lab = region.lab.map(|sum| sum / region.area);
        region.texture /= region.area;
        region.at = region.at.map(|sum| sum / region.area + 0.5);
        region.ln_depth = if depth_area > 0.25 * region.area {
            region.ln_depth / depth_area
        } else {
            f32::NAN
        };
    }
    regions
}

/// Radius of the surface mean that gives a region its tone, pixels.
pub(super) const TONE_RADIUS_PX: usize = 3;

/// Sets the tone of each region to the mean over its pixels of `smooth`.
pub(super) fn set_tones(regions: &mut [RegionStats], partition: &Partition, smooth: &[[f32; 3]]) {
    for (&of, smooth) in partition.of_pixel.iter().zip(smooth) {
        let region = &mut regions[of as usize];
        (0..3).for_each(|channel| region.tone[channel] += smooth[channel] / region.area);
    }
}

/// Marks the regions whose depth was measured.
pub(super) fn set_measured(
    regions: &mut [RegionStats],
    partition: &Partition,
    measured: &DepthMap,
) {
    let mut known_px = vec![0.0; regions.len()];
    for (&of, &depth) in partition.of_pixel.iter().zip(&measured.depths) {
        known_px[of as usize] += f32::from(u8::from(known(depth)));
    }
    for (region, known_px) in regions.iter_mut().zip(known_px) {
        region.measured = known_px > 0.9 * region.area;
    }
}
