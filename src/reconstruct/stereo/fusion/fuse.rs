//! Fusion of the depths of all views into points.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{Mat3, Vec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::cloud::{Contributor, DenseCloud, FusedView};
use crate::stereo::filter::{ConsistentPixel, DepthAgreement, Neighbour, PixelPoint};
use crate::stereo::patchmatch::{PosedImage, Raster, Tones};
use crate::stereo::raster::{raster_camera, raster_image};
use crate::stereo::{DepthEstimate, DepthStore, Stage, StereoError};
use ostra_cloud::SceneError;
use ostra_cloud::fuse::{naming, readable};
use ostra_core::job::Progress;
use ostra_core::statistics::mean_median;
use ostra_frames::{Frame, FrameStore, Image};

/// Input of fusion: frames, and which of them were compared.
#[derive(Debug, Clone, Copy)]
pub struct FusionRequest<'a> {
    /// All frames, by number.
    pub frames: &'a [Frame],
    /// For each view that has depth, the frames that it was compared with.
    pub neighbours: &'a BTreeMap<usize, Vec<usize>>,
    /// Longer side of the rasters on which depth was estimated, in pixels.
    pub max_side: u32,
}

/// Fuses the complete depths of some views into points.
///
/// View after view, each pixel that no point uses yet creates one, together with the pixels of
/// neighbouring views that see the same point (J. Schönberger et al., *Pixelwise View Selection for
/// Unstructured Multi-View Stereo*, ECCV 2016, over the graph of views instead of pixels). The
/// point lies on the pixel's own ray, at the median of the depths of their planes. Every pixel is
/// used once.
///
/// The same input gives the same bytes, whatever the number of threads. A view whose image or depth
/// cannot be read creates no points; the line that is returned with the cloud names such views.
///
/// # Errors
/// [`StereoError::Scene`] if no view can be read, [`StereoError::Stopped`].
pub fn fuse_depths(
    request: &FusionRequest<'_>,
    store: &FrameStore,
    depths: &dyn DepthStore,
    options: &FusionOptions,
    progress: &Progress,
) -> Result<(DenseCloud, Option<String>), StereoError> {
    progress.stage("fuse")?;
    let fusion = Fusion::new(request, store, depths, options);
    let mut cloud = fusion.empty_cloud();
    let mut used = unused_pixels(&cloud);
    let (mut unreadable, mut is_any) = (Vec::new(), false);
    for (&number, &place) in &fusion.places {
        progress.step(place, fusion.places.len())?;
        match fusion.view(number, place)? {
            ViewInput::Missing => {}
            ViewInput::Unreadable => unreadable.push(number),
            ViewInput::Read(view) => {
                is_any = true;
                let needed = options.min_pixels.clamp(1, view.others.len() + 1);
                view.add_points(&mut cloud, &mut used, needed, progress)?;
            }
        }
    }
    if let Some(&first) = unreadable.first().filter(|_| !is_any) {
        depths.load(first, Stage::Complete)?;
        store
            .image(&request.frames[first])
            .map_err(SceneError::from)?;
    }
    let names: Vec<&str> = unreadable
        .iter()
        .map(|&number| request.frames[number].name.as_str())
        .collect();
    Ok((
        cloud,
        naming(
            [
                "cannot be read (image or depth) and gives no points of its own; check its files",
                "cannot be read (image or depth) and give no points of their own; check their files",
            ],
            &names,
        ),
    ))
}

/// A run: its input, and the places of its views.
struct Fusion<'a> {
    request: &'a FusionRequest<'a>,
    store: &'a FrameStore,
    depths: &'a dyn DepthStore,
    options: &'a FusionOptions,
    /// Place of each view among the views of the cloud, by frame number.
    places: BTreeMap<usize, usize>,
}

/// Input of one view.
enum ViewInput {
    /// It has no depth or no posed camera.
    Missing,
    /// Its image or depth cannot be read.
    Unreadable,
    /// All of it was read.
    Read(FusionView),
}

impl<'a> Fusion<'a> {
    fn new(
        request: &'a FusionRequest<'a>,
        store: &'a FrameStore,
        depths: &'a dyn DepthStore,
        options: &'a FusionOptions,
    ) -> Self {
        let places = request
            .neighbours
            .keys()
            .enumerate()
            .map(|(at, &frame)| (frame, at))
            .collect();
        Self {
            request,
            store,
            depths,
            options,
            places,
        }
    }

    /// Returns a cloud with the views and no points yet.
    fn empty_cloud(&self) -> DenseCloud {
        let mut cloud = DenseCloud {
            offsets: vec![0],
            ..DenseCloud::default()
        };
        for &number in self.places.keys() {
            let Some((camera, _)) = self.request.frames[number].posed_camera() else {
                continue;
            };
            cloud.views.push(FusedView {
                frame: number,
                raster: raster_camera(camera, self.request.max_side),
                camera: *camera,
            });
        }
        cloud
    }

    /// Reads a view and its neighbours.
    fn view(&self, number: usize, place: usize) -> Result<ViewInput, StereoError> {
        let max_side = self.request.max_side;
        let frame = &self.request.frames[number];
        let Some(estimate) = readable(self.depths.load(number, Stage::Complete))? else {
            return Ok(ViewInput::Unreadable);
        };
        let Some(estimate) = estimate else {
            return Ok(ViewInput::Missing);
        };
        let (Some((camera, pose)), Some(own)) = (frame.posed_camera(), image(frame, max_side))
        else {
            return Ok(ViewInput::Missing);
        };
        let colors = raster_image(frame, camera, self.store, max_side).map_err(SceneError::from);
        let Some(colors) = readable(colors)? else {
            return Ok(ViewInput::Unreadable);
        };
        Ok(ViewInput::Read(FusionView {
            place,
            estimate,
            colors,
            raster: own.raster(0),
            world_from_camera: glam::DMat3::from_quat(pose.rotation.conjugate()).as_mat3(),
            centre: pose.centre().as_vec3(),
            others: self.others(number, &own)?,
            agreement: self.options.agreement,
        }))
    }

    /// Returns the readable neighbours of a view, each with its place.
    fn others(
        &self,
        number: usize,
        own: &PosedImage,
    ) -> Result<Vec<(usize, Neighbour)>, StereoError> {
        let mut others = Vec::new();
        for other in connected(self.request.neighbours, number) {
            let Some(&at) = self.places.get(&other) else {
                continue;
            };
            let Some(estimate) = readable(self.depths.load(other, Stage::Complete))?.flatten()
            else {
                continue;
            };
            if let Some(image) = image(&self.request.frames[other], self.request.max_side) {
                others.push((at, Neighbour::new(own, &image, estimate)));
            }
        }
        Ok(others)
    }
}

/// Returns for each view which pixels a point uses: none.
fn unused_pixels(cloud: &DenseCloud) -> Vec<Vec<bool>> {
    cloud
        .views
        .iter()
        .map(|view| vec![false; view.raster.width as usize * view.raster.height as usize])
        .collect()
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

/// A view that creates points.
struct FusionView {
    place: usize,
    estimate: Arc<DepthEstimate>,
    colors: Image,
    raster: Raster,
    world_from_camera: Mat3,
    centre: Vec3,
    others: Vec<(usize, Neighbour)>,
    agreement: DepthAgreement,
}

impl FusionView {
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
            let matched: Vec<Vec<(usize, ConsistentPixel)>> = pixels
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

    fn matches(&self, at: usize) -> Vec<(usize, ConsistentPixel)> {
        let depth = self.estimate.depths[at];
        if depth <= 0.0 {
            return Vec::new();
        }
        let (width, normal) = (self.estimate.width(), self.estimate.normal(at));
        let point = PixelPoint::new(at, width, 1.0 / depth, normal);
        let found = |(view, neighbour): &(usize, Neighbour)| {
            Some((*view, neighbour.matched(&point, &self.agreement)?))
        };
        self.others.iter().filter_map(found).collect()
    }

    fn add_point(&self, cloud: &mut DenseCloud, at: usize, matches: &[(usize, ConsistentPixel)]) {
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
    pub agreement: DepthAgreement,
    /// Pixels per point, each of another view and including its own, at least 1; the number of
    /// views if there are fewer.
    pub min_pixels: usize,
}

impl Default for FusionOptions {
    fn default() -> Self {
        Self {
            agreement: DepthAgreement::default(),
            min_pixels: 3,
        }
    }
}
