use std::sync::{Arc, Mutex, PoisonError};

use glam::Vec2;

use super::viewpoint::{Stand, Viewpoint};
use crate::frames::{Frame, FrameError, FrameStore};
use crate::geometry::Camera;

/// Tables of rays kept at once; frames of one camera share theirs.
const TABLES: usize = 4;

/// The frames of a request as viewpoints; depth is loaded on demand.
#[derive(Debug)]
pub struct Views<'a> {
    pub frames: &'a [Frame],
    pub store: &'a FrameStore,
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
        ((camera.width, camera.height) == (frame.width, frame.height)).then_some(Stand { camera, camera_from_world })
    }

    /// The frame with its depth; `None` where depth or camera is missing.
    pub fn load(&self, frame: usize) -> Result<Option<Viewpoint>, FrameError> {
        let Some(stand) = self.stand(frame) else { return Ok(None) };
        let Some(depth) = self.store.depth(&self.frames[frame])? else { return Ok(None) };
        Ok(Some(Viewpoint { stand, depth, rays: self.rays(&stand.camera) }))
    }

    fn rays(&self, camera: &Camera) -> Arc<Vec<Vec2>> {
        let mut tables = self.tables.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, rays)) = tables.iter().find(|(of, _)| of == camera) {
            return rays.clone();
        }
        drop(tables);
        let rays = Arc::new(rays_of(camera));
        tables = self.tables.lock().unwrap_or_else(PoisonError::into_inner);
        if tables.len() >= TABLES {
            tables.remove(0);
        }
        tables.push((*camera, rays.clone()));
        rays
    }
}

fn rays_of(camera: &Camera) -> Vec<Vec2> {
    let width = camera.width as usize;
    let mut rays = vec![Vec2::ZERO; width * camera.height as usize];
    for (row, of_row) in rays.chunks_exact_mut(width.max(1)).enumerate() {
        camera.unproject_row(row as u32, of_row);
    }
    rays
}
