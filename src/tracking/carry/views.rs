use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use glam::Vec2;

use super::viewpoint::{Stand, Viewpoint};
use ostra_cloud::fuse::naming;
use ostra_frames::{Frame, FrameError, FrameStore, Image};
use ostra_geometry::Camera;
use ostra_masks::MaskError;

/// Tables of rays kept at once; frames of one camera share theirs.
const TABLES: usize = 4;

/// The frames of a request as viewpoints; pixels are loaded on demand. Frames whose image or depth cannot be read are
/// noted.
#[derive(Debug)]
pub struct Views<'a> {
    frames: &'a [Frame],
    store: &'a FrameStore,
    tables: Mutex<Vec<(Camera, Arc<Vec<Vec2>>)>>,
    /// What reading said of the frames that cannot be read.
    unread: Mutex<BTreeMap<usize, FrameError>>,
}

impl<'a> Views<'a> {
    pub fn new(frames: &'a [Frame], store: &'a FrameStore) -> Self {
        Self {
            frames,
            store,
            tables: Mutex::default(),
            unread: Mutex::default(),
        }
    }

    /// Camera and pose of a frame that has depth too; `None` where one is missing.
    pub fn stand(&self, frame: usize) -> Option<Stand> {
        let frame = &self.frames[frame];
        frame.depth.as_ref()?;
        let (&camera, &camera_from_world) = frame.posed_camera()?;
        Some(Stand {
            camera,
            camera_from_world,
        })
    }

    /// All frames that have depth and camera.
    pub fn stands(&self) -> impl Iterator<Item = (usize, Stand)> {
        (0..self.frames.len()).filter_map(|frame| Some((frame, self.stand(frame)?)))
    }

    /// A frame that has a [`Self::stand`], with its depth; `None` where that cannot be read.
    ///
    /// # Errors
    /// [`MaskError::Request`] where camera and picture differ in size; [`MaskError::Stopped`].
    pub fn load(&self, frame: usize) -> Result<Option<Viewpoint>, MaskError> {
        let of = &self.frames[frame];
        let Some(depth) = self.noted(frame, self.store.depth(of))? else {
            return Ok(None);
        };
        let (Some(stand), Some(depth)) = (self.stand(frame), depth) else {
            return Err(MaskError::Request(format!(
                "{} has no depth or no camera",
                of.name
            )));
        };
        let sizes = [
            (stand.camera.width, stand.camera.height),
            (depth.width, depth.height),
        ];
        if let Some((width, height)) = sizes
            .into_iter()
            .find(|&size| size != (of.width, of.height))
        {
            let text = format!(
                "{}: picture {}x{}, camera or depth {width}x{height}",
                of.name, of.width, of.height
            );
            return Err(MaskError::Request(format!("{text}; give them in one size")));
        }
        Ok(Some(Viewpoint {
            stand,
            depth,
            rays: self.rays(&stand.camera),
        }))
    }

    /// The picture of a frame; `None` where it cannot be read.
    ///
    /// # Errors
    /// [`MaskError::Stopped`].
    pub fn image(&self, frame: usize) -> Result<Option<Arc<Image>>, MaskError> {
        self.noted(frame, self.store.image(&self.frames[frame]))
    }

    /// Whether a frame was found that cannot be read.
    pub fn is_unread(&self, frame: usize) -> bool {
        self.unread().contains_key(&frame)
    }

    /// The first of the frames that could not be read, as an error.
    pub fn failure(&self) -> Option<MaskError> {
        self.unread().pop_first().map(|(_, error)| error.into())
    }

    /// One line that names the frames which could not be read; `None` where there are none.
    pub fn warning(&self) -> Option<String> {
        let unread = self.unread();
        let names: Vec<&str> = unread
            .keys()
            .map(|&frame| self.frames[frame].name.as_str())
            .collect();
        naming(
            "cannot be read (image or depth) and were not used; check their files",
            &names,
        )
    }

    /// What was read of a frame; where it cannot be, the frame is noted.
    fn noted<T>(&self, frame: usize, read: Result<T, FrameError>) -> Result<Option<T>, MaskError> {
        match read {
            Err(FrameError::Stopped(stopped)) => Err(stopped.into()),
            Err(error) => {
                self.unread().entry(frame).or_insert(error);
                Ok(None)
            }
            Ok(read) => Ok(Some(read)),
        }
    }

    fn unread(&self) -> MutexGuard<'_, BTreeMap<usize, FrameError>> {
        self.unread.lock().unwrap_or_else(PoisonError::into_inner)
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
