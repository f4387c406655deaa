//! The viewpoint of a selection, and the points visible from it.

use glam::Vec3;
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::SceneError;
use ostra_frames::Frame;
use ostra_geometry::{Camera, Pose, PosedCamera, Projection};
use ostra_masks::Region;

/// A viewpoint from which a cloud is seen.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Eye {
    /// The camera of the frame with this number.
    Frame(usize),
    /// A free camera.
    Free {
        /// Intrinsics.
        camera: Camera,
        /// Camera pose.
        camera_from_world: Pose,
    },
}

impl Eye {
    pub(super) fn sight(&self, frames: &[Frame]) -> Result<PosedCamera, SceneError> {
        let (camera, pose) = match self {
            Self::Frame(number) => {
                let refuse = |why: &str| {
                    SceneError::Request(format!("frame {number} {why}; choose another one"))
                };
                let frame = frames.get(*number).ok_or_else(|| refuse("is not there"))?;
                frame
                    .posed_camera()
                    .ok_or_else(|| refuse("has no camera"))?
            }
            Self::Free {
                camera,
                camera_from_world,
            } => (camera, camera_from_world),
        };
        Ok(PosedCamera::new(camera, pose))
    }
}

/// Radius of a point's disc, in spacings of the cloud, so that neighbours on a surface overlap.
const DISC: f64 = 0.75;
/// Minimum radius of a disc in pixels.
const SMALLEST_PX: f64 = 0.8;
/// Maximum radius of a disc in pixels.
///
/// A point right in front of the camera would otherwise cover the whole image.
const LARGEST_PX: f64 = 24.0;
/// Maximum depth of a visible point behind the front.
///
/// The unit is the spacing of the cloud or the footprint of a pixel, whichever is larger. A slanted
/// or rough surface changes by this much within a disc.
const TOLERANCE: f64 = 4.0;
/// Number of image rows rendered by one task.
const BAND_ROWS: usize = 32;

/// A point rendered as a disc that faces the camera.
struct Disc {
    point: u32,
    x: f64,
    y: f64,
    radius: f64,
    depth: f64,
}

/// The rendered part of the image: the bounding box of a region, in pixels.
struct Part {
    left: usize,
    top: usize,
    width: usize,
    height: usize,
}

/// Returns the points that are visible in a region of the image.
///
/// A point is visible if its centre is in the region and at the front of all discs rendered there.
/// This is a depth buffer (Catmull, A Subdivision Algorithm for Computer Display of Curved
/// Surfaces, 1974). Points for which `is_drawn` returns false are neither visible nor occlude
/// others.
pub(super) fn seen_in(
    points: &[Vec3],
    spacing: f64,
    sight: &PosedCamera,
    region: &Region,
    is_drawn: impl Fn(usize) -> bool + Sync,
) -> Vec<u32> {
    let Some(part) = Part::around(region) else {
        return Vec::new();
    };
    let discs = discs(points, spacing, sight, &part, is_drawn);
    let front = part.drawn(&discs);
    let is_seen = |disc: &&Disc| {
        let Some(at) = part.pixel(disc) else {
            return false;
        };
        let (x, y) = (at % part.width + part.left, at / part.width + part.top);
        let tolerance = TOLERANCE * spacing.max(sight.footprint(disc.depth));
        region.at(x as u32, y as u32) && disc.depth <= f64::from(front[at]) + tolerance
    };
    discs
        .par_iter()
        .filter(is_seen)
        .map(|disc| disc.point)
        .collect()
}

fn discs(
    points: &[Vec3],
    spacing: f64,
    sight: &PosedCamera,
    part: &Part,
    is_drawn: impl Fn(usize) -> bool + Sync,
) -> Vec<Disc> {
    let disc = |(point, &position): (usize, &Vec3)| {
        let Projection { at_px, depth } = sight.project(position.as_dvec3())?;
        let radius = (DISC * spacing / sight.footprint(depth)).clamp(SMALLEST_PX, LARGEST_PX);
        let (x, y) = (at_px.x - part.left as f64, at_px.y - part.top as f64);
        let touches = x > -radius
            && y > -radius
            && x < part.width as f64 + radius
            && y < part.height as f64 + radius;
        (touches && is_drawn(point)).then_some(Disc {
            point: point as u32,
            x,
            y,
            radius,
            depth,
        })
    };
    points.par_iter().enumerate().filter_map(disc).collect()
}

impl Part {
    /// Returns the bounding box of a region, or `None` if the region has no pixels.
    fn around(region: &Region) -> Option<Self> {
        let width = region.width as usize;
        let rows = region.inside.chunks_exact(width.max(1));
        let filled = rows
            .enumerate()
            .filter(|(_, row)| row.contains(&true))
            .map(|(y, _)| y);
        let (top, bottom) = filled.fold((usize::MAX, 0), |(top, _), y| (top.min(y), y));
        let inside = || {
            region
                .inside
                .iter()
                .enumerate()
                .filter(|(_, inside)| **inside)
                .map(|(at, _)| at % width)
        };
        let (left, right) = (inside().min()?, inside().max()?);
        Some(Self {
            left,
            top,
            width: right - left + 1,
            height: bottom - top + 1,
        })
    }

    /// Returns the index of the pixel that contains the centre of a disc.
    fn pixel(&self, disc: &Disc) -> Option<usize> {
        let inside = disc.x >= 0.0
            && disc.y >= 0.0
            && disc.x < self.width as f64
            && disc.y < self.height as f64;
        inside.then_some(disc.y as usize * self.width + disc.x as usize)
    }

    /// Returns the minimum depth of all discs per pixel; infinite if there is none.
    fn drawn(&self, discs: &[Disc]) -> Vec<f32> {
        let mut front = vec![f32::INFINITY; self.width * self.height];
        front
            .par_chunks_mut(BAND_ROWS * self.width)
            .enumerate()
            .for_each(|(band, rows)| {
                let top = band * BAND_ROWS;
                let bottom = (top + rows.len() / self.width) as f64;
                for disc in discs.iter().filter(|disc| {
                    disc.y + disc.radius > top as f64 && disc.y - disc.radius < bottom
                }) {
                    disc.draw(rows, self.width, top);
                }
            });
        front
    }
}

impl Disc {
    /// Draws the disc into rows of the depth buffer.
    ///
    /// It covers the pixels whose centres lie within the disc, and always the one that contains its
    /// centre.
    fn draw(&self, rows: &mut [f32], width: usize, top: usize) {
        let (x, y) = (self.x, self.y - top as f64);
        let span = |at: f64, size: usize| {
            let last = ((at + self.radius).floor() as usize + 1).min(size);
            ((at - self.radius).max(0.0) as usize).min(last)..last
        };
        for row in span(y, rows.len() / width) {
            for column in span(x, width) {
                let (dx, dy) = (column as f64 + 0.5 - x, row as f64 + 0.5 - y);
                let is_own = dx.abs() <= 0.5 && dy.abs() <= 0.5;
                if is_own || dx * dx + dy * dy <= self.radius * self.radius {
                    let there = &mut rows[row * width + column];
                    *there = there.min(self.depth as f32);
                }
            }
        }
    }
}
