use std::sync::{Arc, Mutex, PoisonError};

use glam::Vec2;

use super::viewpoint::{Stand, Viewpoint};
use crate::frames::{Frame, FrameStore, Image};
use crate::geometry::Camera;
use crate::masks::MaskError;

/// Tables of rays kept at once; frames of one camera share theirs.
const TABLES: usize = 4;

/// The frames of a request as viewpoints; pixels are loaded on demand.
#[derive(Debug)]
pub struct Views<'a> {
    frames: &'a [Frame],
    store: &'a FrameStore,
    tables: Mutex<Vec<(Camera, Arc<Vec<Vec2>>)>>,
}

impl<'a> Views<'a> {
    pub fn new(frames: &'a [Frame], store: &'a FrameStore) -> Self {
        Self { frames, store, tables: Mutex::default() }
    }

    /// Camera and pose of a frame that has depth too; `None` where one is missing.
    pub fn stand(&self, frame: usize) -> Option<Stand> {
        let frame = &self.frames[frame];
        frame.depth.as_ref()?;
        let (&camera, &camera_from_world) = frame.posed_camera()?;
        Some(Stand { camera, camera_from_world })
    }

    /// All frames that have depth and camera.
    pub fn stands(&self) -> impl Iterator<Item = (usize, Stand)> {
        (0..self.frames.len()).filter_map(|frame| Some((frame, self.stand(frame)?)))
    }

    /// A frame that has a [`Self::stand`], with its depth.
    pub fn load(&self, frame: usize) -> Result<Viewpoint, MaskError> {
        let of = &self.frames[frame];
        let depth = self.store.depth(of)?;
        let (Some(stand), Some(depth)) = (self.stand(frame), depth) else {
            return Err(MaskError::Request(format!("{} has no depth or no camera", of.name)));
        };
        let sizes = [(stand.camera.width, stand.camera.height), (depth.width, depth.height)];
        if let Some((width, height)) = sizes.into_iter().find(|&size| size != (of.width, of.height)) {
            let text = format!("{}: picture {}x{}, camera or depth {width}x{height}", of.name, of.width, of.height);
            return Err(MaskError::Request(format!("{text}; give them in one size")));
        }
        Ok(Viewpoint { stand, depth, rays: self.rays(&stand.camera) })
    }

    pub fn image(&self, frame: usize) -> Result<Arc<Image>, MaskError> {
        Ok(self.store.image(&self.frames[frame])?)
    }

    fn rays(&self, camera: &Camera) -> Arc<Vec<Vec2>> {
        let lock = || self.tables.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, rays)) = lock().iter().find(|(of, _)| of == camera) {
            return rays.clone();
        }
        let rays = Arc::new(rays_of(camera));
        let mut tables = lock();
        if tables.len() >= TABLES {
            tables.remove(0);
        }
        tables.push((*camera, rays.clone()));
        rays
    }
}

/// The point on the plane z = 1 that each pixel of a camera sees, row by row.
pub fn rays_of(camera: &Camera) -> Vec<Vec2> {
    let width = camera.width as usize;
    let mut rays = vec![Vec2::ZERO; width * camera.height as usize];
    for (row, of_row) in rays.chunks_exact_mut(width.max(1)).enumerate() {
        camera.unproject_row(row as u32, of_row);
    }
    rays
}
