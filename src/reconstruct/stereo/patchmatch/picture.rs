use std::sync::Arc;

use glam::{DMat3, DVec3};

use super::ncc::Transfer;
use super::plane::Raster;
use super::texture::{Texture, Tones};
use ostra_geometry::{Camera, Pose};

/// A posed pinhole picture with its pyramid, each level half the size of the one before.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Intrinsics of the finest level, without distortion.
    pub camera: Camera,
    /// The pose.
    pub camera_from_world: Pose,
    /// From the finest level on; at least one.
    pub levels: Vec<Arc<Texture>>,
    /// No two pixels differ: nothing can be compared.
    pub is_constant: bool,
}

impl Picture {
    /// The pyramid of a picture, down to a longer side of at least `coarsest_px`.
    #[must_use]
    pub fn new(tones: Tones, camera: Camera, camera_from_world: Pose, coarsest_px: u32) -> Self {
        let is_constant = tones.is_constant();
        let mut levels = vec![Arc::new(Texture::new(&tones))];
        let mut finest = tones;
        while finest.width.max(finest.height) / 2 >= coarsest_px.max(32) as usize
            && finest.width.min(finest.height) > 1
        {
            finest = finest.halved();
            levels.push(Arc::new(Texture::new(&finest)));
        }
        Self {
            camera,
            camera_from_world,
            levels,
            is_constant,
        }
    }

    /// Bytes of its pixels.
    #[must_use]
    pub fn bytes(&self) -> usize {
        let texel = size_of::<u32>() + size_of::<[u8; 2]>();
        self.levels
            .iter()
            .map(|level| level.quads.len() * texel)
            .sum()
    }

    /// Columns and rows of the finest level.
    #[must_use]
    pub fn size(&self) -> (usize, usize) {
        (self.levels[0].width, self.levels[0].height)
    }

    /// The camera at a level.
    #[must_use]
    pub fn raster(&self, level: usize) -> Raster {
        let (focal, principal) = self.at_level(level);
        Raster {
            focal: focal.map(|v| v as f32),
            principal: principal.map(|v| v as f32),
        }
    }

    /// Focal lengths and principal point in pixel indices of a level.
    fn at_level(&self, level: usize) -> ([f64; 2], [f64; 2]) {
        let mut focal = self.camera.focal_px.to_array();
        let mut principal = (self.camera.principal_px - 0.5).to_array();
        for _ in 0..level {
            focal = focal.map(|f| 0.5 * f);
            // The centre of a coarse pixel lies between those of its two fine ones.
            principal = principal.map(|c| 0.5 * (c - 0.5));
        }
        (focal, principal)
    }

    fn matrix(&self, level: usize) -> DMat3 {
        let ([fx, fy], [cx, cy]) = self.at_level(level);
        DMat3::from_cols(
            DVec3::new(fx, 0.0, 0.0),
            DVec3::new(0.0, fy, 0.0),
            DVec3::new(cx, cy, 1.0),
        )
    }

    /// The way from this picture's pixels to another's, both at a level.
    #[must_use]
    pub fn transfer(&self, to: &Self, level: usize) -> Transfer {
        let to_from_here = to
            .camera_from_world
            .compose(&self.camera_from_world.inverse());
        let k = to.matrix(level);
        let matrix = k * DMat3::from_quat(to_from_here.rotation) * self.matrix(level).inverse();
        let column = |v: DVec3| v.as_vec3().to_array();
        Transfer {
            matrix: [
                column(matrix.x_axis),
                column(matrix.y_axis),
                column(matrix.z_axis),
            ],
            offset: column(k * to_from_here.translation),
        }
    }
}
