//! Fusion of the depths of all views into points.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{Mat3, Vec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::cloud::{Contributor, DenseCloud, FusedView};
use crate::stereo::filter::{Agreement, Match, Neighbour};
use crate::stereo::patchmatch::{PosedImage, Raster, Tones};
use crate::stereo::raster::{raster_camera, raster_image};
use crate::stereo::{DepthEstimate, DepthStore, Stage, StereoError};
use ostra_cloud::SceneError;
use ostra_cloud::fuse::{naming, readable};
use ostra_core::job::Progress;
use ostra_core::statistics::mean_median;
use ostra_frames::{Frame, FrameStore, Image};

/// Fuses the complete depths of some views into points.
///
/// View after view, each pixel that no point uses yet creates one, together with the pixels of
/// neighbouring views that see the same point (J. Schönberger et al., *Pixelwise View Selection for
/// Unstructured Multi-View Stereo*, ECCV 2016, over the graph of views instead of pixels). The
/// point lies on the pixel's own ray, at the median of the depths of their planes. Every pixel is
/// used once.
///
/// `neighbours` gives for each view the frames that it was compared with. The same input gives the
/// same bytes, whatever the number of threads. A view whose image or depth cannot be read creates
/// no points; the line that is returned with the cloud names such views.
///
/// # Errors
/// [`StereoError::Scene`] if no view can be read, [`StereoError::Stopped`].
#[expect(
    clippy::too_many_lines,
    reason = "under 80 lines before rustfmt's defaults; to be split"
)]
pub fn fuse_depths(
    frames: &[Frame],
    neighbours: &BTreeMap<usize, Vec<usize>>,
    (store, max_side): (&FrameStore, u32),
    depths: &dyn DepthStore,
    options: &FusionOptions,
    progress: &Progress,
) -> Result<(DenseCloud, Option<String>), StereoError> {
    progress.stage("fuse")?;
    let mut cloud = DenseCloud {
        offsets: vec![0],
        ..DenseCloud::default()
    };
    let (mut unreadable, mut is_any) = (Vec::new(), false);
    let mut used: Vec<Vec<bool>> = Vec::new();
    let places: BTreeMap<usize, usize> = neighbours
        .keys()
        .enumerate()
        .map(|(at, &frame)| (frame, at))
        .collect();
    for &number in places.keys() {
        let Some((camera, _)) = frames[number].posed_camera() else {
            continue;
        };
        let raster = raster_camera(camera, max_side);
        used.push(vec![false; raster.width as usize * raster.height as usize]);
        cloud.views.push(FusedView {
            frame: number,
            raster,
            camera: *camera,
        });
    }
    for (&number, &place) in &places {
        progress.step(place, places.len())?;
        let Some(estimate) = readable(depths.load(number, Stage::Complete))? else {
            unreadable.push(number);
            continue;
        };
        let Some(estimate) = estimate else { continue };
        let (Some((camera, pose)), Some(own)) = (
            frames[number].posed_camera(),
            image(&frames[number], max_side),
        ) else {
            continue;
        };
        let colors =
            raster_image(&frames[number], camera, store, max_side).map_err(SceneError::from);
        let Some(colors) = readable(colors)? else {
            unreadable.push(number);
            continue;
        };
        is_any = true;
        let around = connected(neighbours, number);
        let mut others = Vec::new();
        for other in around {
            let Some(&at) = places.get(&other) else {
                continue;
            };
            let Some(estimate) = readable(depths.load(other, Stage::Complete))?.flatten() else {
                continue;
            };
            if let Some(image) = image(&frames[other], max_side) {
                others.push((at, Neighbour::new(&own, &image, estimate)));
            }
        }
        let view = View {
            place,
            estimate: &estimate,
            colors: &colors,
            raster: own.raster(0),
            world_from_camera: glam::DMat3::from_quat(pose.rotation.conjugate()).as_mat3(),
            centre: pose.centre().as_vec3(),
            others: &others,
            agreement: options.agreement,
        };
        let needed = options.min_pixels.clamp(1, others.len() + 1);
        view.add_points(&mut cloud, &mut used, needed, progress)?;
    }
    if let Some(&first) = unreadable.first().filter(|_| !is_any) {
        depths.load(first, Stage::Complete)?;
        store.image(&frames[first]).map_err(SceneError::from)?;
    }
    let names: Vec<&str> = unreadable
        .iter()
        .map(|&number| frames[number].name.as_str())
        .collect();
    Ok((
        cloud,
        naming(
            "cannot be read (image or depth) and give no points of their own; check their files",
            &names,
        ),
    ))
}

/// Returns an image's geometry without its pixels.
fn image(frame: &Frame, max_side: u32) -> Option<PosedImage> {
    let (camera, pose) = frame.posed_camera()?;
    Some(PosedImage::new(
        Tones::default(),
        raster_camera(camera, max_side),
        *pose,
        32,
    ))
}

/// Returns the frames that a frame was compared with, and those that were compared with it.
fn connected(neighbours: &BTreeMap<usize, Vec<usize>>, number: usize) -> Vec<usize> {
    let own = neighbours.get(&number).into_iter().flatten().copied();
    let others = neighbours
        .iter()
        .filter(|(_, sources)| sources.contains(&number))
        .map(|(&frame, _)| frame);
    let mut all: Vec<usize> = own.chain(others).collect();
    all.sort_unstable();
    all.dedup();
    all
}

struct View<'a> {
    place: usize,
    estimate: &'a Arc<DepthEstimate>,
    colors: &'a Image,
    raster: Raster,
    world_from_camera: Mat3,
    centre: Vec3,
    others: &'a [(usize, Neighbour)],
    agreement: Agreement,
}

impl View<'_> {
    /// Rows of pixels are matched in parallel; points are created one after the other.
    fn add_points(
        &self,
        cloud: &mut DenseCloud,
        used: &mut [Vec<bool>],
        min_pixels: usize,
        progress: &Progress,
    ) -> Result<(), StereoError> {
        const ROWS: usize = 64;
        let (width, height) = (self.estimate.width(), self.estimate.height());
        for first in (0..height).step_by(ROWS) {
            progress.check()?;
            let pixels = first * width..(first + ROWS).min(height) * width;
            let matched: Vec<Vec<(usize, Match)>> = pixels
                .clone()
                .into_par_iter()
                .map(|at| {
                    if used[self.place][at] {
                        Vec::new()
                    } else {
                        self.matches(at)
                    }
                })
                .collect();
            for (at, mut matches) in pixels.zip(matched) {
                if used[self.place][at] || self.estimate.depths[at] <= 0.0 {
                    continue;
                }
                matches.retain(|&(view, found)| !used[view][found.pixel]);
                if matches.len() + 1 < min_pixels {
                    continue;
                }
                self.add_point(cloud, at, &matches);
                used[self.place][at] = true;
                matches
                    .iter()
                    .for_each(|&(view, found)| used[view][found.pixel] = true);
            }
        }
        Ok(())
    }

    fn matches(&self, at: usize) -> Vec<(usize, Match)> {
        let depth = self.estimate.depths[at];
        if depth <= 0.0 {
            return Vec::new();
        }
        let width = self.estimate.width();
        let (place, normal) = (
            ((at % width) as f32, (at / width) as f32),
            self.estimate.normal(at),
        );
        let found = |(view, neighbour): &(usize, Neighbour)| {
            Some((
                *view,
                neighbour.matched(place, 1.0 / depth, normal, &self.agreement)?,
            ))
        };
        self.others.iter().filter_map(found).collect()
    }

    fn add_point(&self, cloud: &mut DenseCloud, at: usize, matches: &[(usize, Match)]) {
        let width = self.estimate.width();
        let own = 1.0 / self.estimate.depths[at];
        let others = matches.iter().map(|(_, found)| found.inverse_depth);
        let mut inverse_depths: Vec<f32> = others.chain([own]).collect();
        let inverse_depth = mean_median(&mut inverse_depths).unwrap_or(own);
        let normal = matches
            .iter()
            .fold(self.estimate.normal(at), |sum, (_, found)| {
                sum + found.normal
            });
        let ray = self.raster.ray((at % width) as f32, (at / width) as f32);
        cloud
            .positions
            .push(self.centre + self.world_from_camera * (ray / inverse_depth));
        cloud
            .normals
            .push(self.world_from_camera * normal.normalize_or_zero());
        cloud.colors.push(self.colors.pixels[at]);
        cloud.contributors.push(Contributor {
            view: self.place as u32,
            pixel: at as u32,
        });
        let others = matches.iter().map(|&(view, found)| Contributor {
            view: view as u32,
            pixel: found.pixel as u32,
        });
        cloud.contributors.extend(others);
        cloud.offsets.push(cloud.contributors.len() as u32);
    }
}

/// Options of fusion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FusionOptions {
    /// When pixels of two views see the same point.
    pub agreement: Agreement,
    /// Pixels per point, each of another view and including its own, at least 1; the number of
    /// views if there are fewer.
    pub min_pixels: usize,
}

impl Default for FusionOptions {
    fn default() -> Self {
        Self {
            agreement: Agreement::default(),
            min_pixels: 3,
        }
    }
}
