//! What stereo gives of a view, and where it is kept.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use glam::Vec3;

use super::patchmatch::{Found, Picture, Plane};
use ostra_cloud::SceneError;
use ostra_geometry::Camera;

/// Depth, normal and confidence of one view, on its raster. All vectors have `width · height` elements.
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
    /// What a search found.
    #[must_use]
    pub fn new(found: &Found, picture: &Picture) -> Self {
        let raster = picture.raster(0);
        let mut estimate = Self::empty(picture.camera);
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

    /// Nothing known.
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

    /// Columns.
    #[must_use]
    pub fn width(&self) -> usize {
        self.camera.width as usize
    }

    /// Rows.
    #[must_use]
    pub fn height(&self) -> usize {
        self.camera.height as usize
    }

    /// The normal of a pixel (camera space, about unit length); zero where unknown.
    #[must_use]
    pub fn normal(&self, at: usize) -> Vec3 {
        Vec3::from(self.normals[at].map(f32::from)) / 127.0
    }

    /// Forgets a pixel.
    pub fn clear(&mut self, at: usize) {
        (self.depths[at], self.normals[at], self.confidence[at]) = (0.0, [0; 3], 0);
    }

    /// The planes of all pixels and their costs, as a search tells them; no plane where depth is unknown.
    #[must_use]
    pub fn found(&self, picture: &Picture) -> Found {
        let raster = picture.raster(0);
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
        Found {
            width: self.width(),
            height: self.height(),
            planes: (0..self.depths.len()).map(plane).collect(),
            costs,
        }
    }
}

/// How far a view's depth is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Stage {
    /// After so many rounds with geometric consistency; 0 = by the pictures alone.
    Round(u32),
    /// What of the last round other views agree with.
    Filtered,
    /// With what others see: ready to be looked at and fused.
    Complete,
}

/// Where depths are kept while others are made, and afterwards: what is there when a run starts is not made again.
pub trait DepthStore: Sync {
    /// The depth of a frame at a stage; `None` when it is not there.
    ///
    /// # Errors
    /// [`SceneError`] when it cannot be read; [`ostra_frames::FrameError::Invalid`] within it when it is damaged, for which
    /// it is made again.
    fn load(&self, frame: usize, stage: Stage) -> Result<Option<Arc<DepthEstimate>>, SceneError>;

    /// Keeps the depth of a frame at a stage.
    ///
    /// # Errors
    /// [`SceneError`] when it cannot be written.
    fn save(&self, frame: usize, stage: Stage, estimate: DepthEstimate) -> Result<(), SceneError>;

    /// Called when no more of a stage is needed by any view.
    ///
    /// # Errors
    /// [`SceneError`] when it cannot be removed.
    fn forget(&self, stage: Stage) -> Result<(), SceneError>;
}

/// Keeps depths in memory: 8 bytes a pixel and stage.
#[derive(Debug, Default)]
pub struct MemoryDepths {
    estimates: Mutex<BTreeMap<(Stage, usize), Arc<DepthEstimate>>>,
}

impl DepthStore for MemoryDepths {
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
