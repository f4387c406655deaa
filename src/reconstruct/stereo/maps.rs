//! Results of stereo for a view, and their storage.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use glam::Vec3;

use super::patchmatch::{Plane, PlaneMap, PosedImage};
use ostra_cloud::SceneError;
use ostra_geometry::Camera;

/// Depth, normal and confidence of one view, on its raster.
///
/// All vectors have `width · height` elements, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthEstimate {
    /// Intrinsics of the raster, without distortion.
    pub camera: Camera,
    /// Depth along the optical axis in world units; 0 = unknown.
    pub depths: Vec<f32>,
    /// Unit normal towards the camera, in camera space, times 127; zero where depth is unknown.
    pub normals: Vec<[i8; 3]>,
    /// How well the sources agree with the depth, 0–255 for 0–1.
    pub confidence: Vec<u8>,
}

impl DepthEstimate {
    /// Converts the result of a search.
    #[must_use]
    pub fn new(found: &PlaneMap, image: &PosedImage) -> Self {
        let raster = image.raster(0);
        let mut estimate = Self::empty(image.camera);
        for (at, (plane, &cost)) in found.planes.iter().zip(&found.costs).enumerate() {
            if plane.inverse_depth > 0.0 {
                let normal = plane.normal(
                    &raster,
                    (at % found.width) as f32,
                    (at / found.width) as f32,
                );
                estimate.depths[at] = 1.0 / plane.inverse_depth;
                estimate.normals[at] = (127.0 * normal).round().to_array().map(|value| value as i8);
                estimate.confidence[at] = (255.0 * (1.0 - cost).clamp(0.0, 1.0)).round() as u8;
            }
        }
        estimate
    }

    /// Creates an estimate in which all depths are unknown.
    #[must_use]
    pub fn empty(camera: Camera) -> Self {
        let count = camera.width as usize * camera.height as usize;
        Self {
            camera,
            depths: vec![0.0; count],
            normals: vec![[0; 3]; count],
            confidence: vec![0; count],
        }
    }

    /// Returns the number of columns.
    #[must_use]
    pub fn width(&self) -> usize {
        self.camera.width as usize
    }

    /// Returns the number of rows.
    #[must_use]
    pub fn height(&self) -> usize {
        self.camera.height as usize
    }

    /// Returns the normal of a pixel (camera space, about unit length); zero if unknown.
    #[must_use]
    pub fn normal(&self, at: usize) -> Vec3 {
        Vec3::from(self.normals[at].map(f32::from)) / 127.0
    }

    /// Marks a pixel as unknown.
    pub fn clear(&mut self, at: usize) {
        (self.depths[at], self.normals[at], self.confidence[at]) = (0.0, [0; 3], 0);
    }

    /// Returns the planes of all pixels and their costs, as a search returns them; no plane where depth is unknown.
    #[must_use]
    pub fn found(&self, image: &PosedImage) -> PlaneMap {
        let raster = image.raster(0);
        let width = self.width().max(1);
        let plane = |at: usize| match self.depths[at] {
            depth if depth > 0.0 => Plane::from_normal(
                depth,
                self.normal(at),
                &raster,
                (at % width) as f32,
                (at / width) as f32,
            ),
            _ => Plane::default(),
        };
        let costs = self
            .confidence
            .iter()
            .map(|&confidence| 1.0 - f32::from(confidence) / 255.0)
            .collect();
        PlaneMap {
            width: self.width(),
            height: self.height(),
            planes: (0..self.depths.len()).map(plane).collect(),
            costs,
        }
    }
}

/// Processing stage of a view's depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Stage {
    /// After this many rounds with geometric consistency; 0 = by the images alone.
    Round(u32),
    /// Depths of the last round that other views agree with.
    Filtered,
    /// Completed by what others see: ready to be viewed and fused.
    Complete,
}

/// Storage of depths during and after a run; stages that exist when a run starts are not computed again.
pub trait DepthStore: Sync {
    /// Returns the depth of a frame at a stage; `None` if it does not exist.
    ///
    /// # Errors
    /// [`SceneError`] if it cannot be read; it contains [`ostra_frames::FrameError::Invalid`] if it
    /// is damaged, in which case it is computed again.
    fn load(&self, frame: usize, stage: Stage) -> Result<Option<Arc<DepthEstimate>>, SceneError>;

    /// Stores the depth of a frame at a stage.
    ///
    /// # Errors
    /// [`SceneError`] if it cannot be written.
    fn save(&self, frame: usize, stage: Stage, estimate: DepthEstimate) -> Result<(), SceneError>;

    /// Removes a stage that no view needs any more.
    ///
    /// # Errors
    /// [`SceneError`] if it cannot be removed.
    fn forget(&self, stage: Stage) -> Result<(), SceneError>;
}

/// Stores depths in memory: 8 bytes per pixel and stage.
#[derive(Debug, Default)]
pub struct InMemoryDepthStore {
    estimates: Mutex<BTreeMap<(Stage, usize), Arc<DepthEstimate>>>,
}

impl DepthStore for InMemoryDepthStore {
    fn load(&self, frame: usize, stage: Stage) -> Result<Option<Arc<DepthEstimate>>, SceneError> {
        let estimates = self
            .estimates
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        Ok(estimates.get(&(stage, frame)).map(Arc::clone))
    }

    fn save(&self, frame: usize, stage: Stage, estimate: DepthEstimate) -> Result<(), SceneError> {
        let mut estimates = self
            .estimates
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        estimates.insert((stage, frame), Arc::new(estimate));
        Ok(())
    }

    fn forget(&self, stage: Stage) -> Result<(), SceneError> {
        let mut estimates = self
            .estimates
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        estimates.retain(|&(kept, _), _| kept != stage);
        Ok(())
    }
}
