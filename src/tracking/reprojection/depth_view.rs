use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use glam::{Vec2, Vec3};

use ostra_cloud::fuse::naming;
use ostra_core::statistics::upper_median;
use ostra_frames::{DepthMap, Frame, FrameError, FrameStore, Image};
use ostra_geometry::{Camera, Distortion, Isometry, Pinhole, Pose};
use ostra_masks::MaskError;

/// Camera and pose of a frame.
#[derive(Debug, Clone, Copy)]
pub struct CalibratedView {
    pub camera: Camera,
    pub camera_from_world: Pose,
}

/// A frame's camera and depth, with the ray of every pixel.
#[derive(Debug, Clone)]
pub struct DepthView {
    pub posed: CalibratedView,
    pub depth: Arc<DepthMap>,
    /// Intersection of each pixel's ray with the plane z = 1, row by row.
    pub rays: Arc<Vec<Vec2>>,
}

impl DepthView {
    pub fn width(&self) -> usize {
        self.posed.camera.width as usize
    }

    pub fn height(&self) -> usize {
        self.posed.camera.height as usize
    }

    /// Returns the 3-D point of a pixel in camera space; `None` if depth or ray is unknown.
    pub fn point(&self, at: usize) -> Option<Vec3> {
        let depth = self.depth.depths[at];
        let point = (self.rays[at] * depth).extend(depth);
        (depth > 0.0 && point.is_finite()).then_some(point)
    }

    /// Returns the transform from camera space to world space.
    pub fn to_world(&self) -> impl Fn(Vec3) -> Vec3 + Sync {
        let world_from_camera = Isometry::from(&self.posed.camera_from_world.inverse());
        move |point| world_from_camera.transform(point)
    }

    /// Returns the median of the known depths on a sparse grid; `None` without depth.
    pub fn median_depth(&self) -> Option<f32> {
        let mut known: Vec<f32> = self
            .depth
            .depths
            .iter()
            .step_by(61)
            .copied()
            .filter(|&d| d > 0.0)
            .collect();
        upper_median(&mut known)
    }

    /// Returns the points of a sparse grid of about `side`² pixels, in camera space.
    pub fn grid(&self, side: usize) -> Vec<Vec3> {
        let (width, height) = (self.width(), self.height());
        let columns = (width / (2 * side)..width).step_by((width / side).max(1));
        let rows = (height / (2 * side)..height).step_by((height / side).max(1));
        rows.flat_map(|y| columns.clone().map(move |x| y * width + x))
            .filter_map(|at| self.point(at))
            .collect()
    }
}

/// Projection from one camera's space to another camera's pixels.
#[derive(Debug, Clone)]
pub struct Reprojection {
    to_from: Isometry,
    lens: Lens,
    size: Vec2,
}

#[derive(Debug, Clone)]
enum Lens {
    Pinhole(Pinhole),
    Distorted(Camera),
}

impl Reprojection {
    pub fn new(from: &CalibratedView, to: &CalibratedView) -> Self {
        let pose = to
            .camera_from_world
            .compose(&from.camera_from_world.inverse());
        let camera = to.camera;
        let lens = match camera.distortion {
            Distortion::None => Lens::Pinhole(Pinhole::new(&camera)),
            _ => Lens::Distorted(camera),
        };
        Self {
            to_from: Isometry::from(&pose),
            lens,
            size: Vec2::new(camera.width as f32, camera.height as f32),
        }
    }

    /// Transforms a point to the other camera's space.
    pub fn transform(&self, point: Vec3) -> Vec3 {
        self.to_from.transform(point)
    }

    /// Rotates a direction to the other camera's space.
    pub fn turn(&self, direction: Vec3) -> Vec3 {
        self.to_from.rotation * direction
    }

    /// Projects a point of the other camera's space to its image plane.
    ///
    /// The result may lie outside the image. It is `None` behind the camera.
    pub fn project(&self, point: Vec3) -> Option<Vec2> {
        if point.z <= 0.0 {
            return None;
        }
        match &self.lens {
            Lens::Pinhole(camera) => camera.project(point),
            Lens::Distorted(camera) => camera.project(point.as_dvec3()).map(glam::DVec2::as_vec2),
        }
    }

    /// As [`Self::project`], but `None` outside the image.
    pub fn pixel(&self, point: Vec3) -> Option<Vec2> {
        let at = self.project(point)?;
        (at.x >= 0.0 && at.y >= 0.0 && at.x < self.size.x && at.y < self.size.y).then_some(at)
    }
}

/// Maximum number of ray tables in memory; frames with the same camera share one.
const TABLES: usize = 4;

/// The frames of a request with their depth and cameras.
///
/// Pixels are loaded on demand. Frames whose image or depth cannot be read are noted.
#[derive(Debug)]
pub struct DepthViews<'a> {
    frames: &'a [Frame],
    store: &'a FrameStore,
    tables: Mutex<Vec<(Camera, Arc<Vec<Vec2>>)>>,
    /// Errors of the frames that could not be read.
    unread: Mutex<BTreeMap<usize, FrameError>>,
}

impl<'a> DepthViews<'a> {
    pub fn new(frames: &'a [Frame], store: &'a FrameStore) -> Self {
        Self {
            frames,
            store,
            tables: Mutex::default(),
            unread: Mutex::default(),
        }
    }

    /// Returns camera and pose of a frame that also has depth; `None` if one is missing.
    pub fn calibrated_view(&self, frame: usize) -> Option<CalibratedView> {
        let frame = &self.frames[frame];
        frame.depth.as_ref()?;
        let (&camera, &camera_from_world) = frame.posed_camera()?;
        Some(CalibratedView {
            camera,
            camera_from_world,
        })
    }

    /// Returns all frames that have depth and a camera.
    pub fn calibrated_views(&self) -> impl Iterator<Item = (usize, CalibratedView)> {
        (0..self.frames.len()).filter_map(|frame| Some((frame, self.calibrated_view(frame)?)))
    }

    /// Loads the depth of a frame that has a [`Self::calibrated_view`]; `None` if unreadable.
    ///
    /// # Errors
    /// [`MaskError::Request`] if camera or depth and image differ in size, or
    /// [`MaskError::Stopped`].
    pub fn load(&self, frame: usize) -> Result<Option<DepthView>, MaskError> {
        let of = &self.frames[frame];
        let Some(depth) = self.noted(frame, self.store.depth(of))? else {
            return Ok(None);
        };
        let (Some(posed), Some(depth)) = (self.calibrated_view(frame), depth) else {
            return Err(MaskError::Request(format!(
                "{} has no depth or no camera",
                of.name
            )));
        };
        let sizes = [
            (posed.camera.width, posed.camera.height),
            (depth.width, depth.height),
        ];
        if let Some((width, height)) = sizes
            .into_iter()
            .find(|&size| size != (of.width, of.height))
        {
            let text = format!(
                "{}: image {}x{}, camera or depth {width}x{height}",
                of.name, of.width, of.height
            );
            return Err(MaskError::Request(format!("{text}; give them in one size")));
        }
        Ok(Some(DepthView {
            posed,
            depth,
            rays: self.rays(&posed.camera),
        }))
    }

    /// Loads the image of a frame; `None` if it cannot be read.
    ///
    /// # Errors
    /// [`MaskError::Stopped`] if the user stops the job.
    pub fn image(&self, frame: usize) -> Result<Option<Arc<Image>>, MaskError> {
        self.noted(frame, self.store.image(&self.frames[frame]))
    }

    /// Returns whether reading the frame has failed.
    pub fn is_unread(&self, frame: usize) -> bool {
        self.unread().contains_key(&frame)
    }

    /// Returns the error of the first frame that could not be read.
    pub fn failure(&self) -> Option<MaskError> {
        self.unread().pop_first().map(|(_, error)| error.into())
    }

    /// Returns one line that names the unreadable frames; `None` if there are none.
    pub fn warning(&self) -> Option<String> {
        let unread = self.unread();
        let names: Vec<&str> = unread
            .keys()
            .map(|&frame| self.frames[frame].name.as_str())
            .collect();
        naming(
            [
                "cannot be read (image or depth) and was not used; check its files",
                "cannot be read (image or depth) and were not used; check their files",
            ],
            &names,
        )
    }

    /// Returns what was read; if reading failed, notes the frame and returns `None`.
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

/// Returns the point on the plane z = 1 that each pixel sees, row by row.
pub fn rays_of(camera: &Camera) -> Vec<Vec2> {
    let width = camera.width as usize;
    let mut rays = vec![Vec2::ZERO; width * camera.height as usize];
    for (row, of_row) in rays.chunks_exact_mut(width.max(1)).enumerate() {
        camera.unproject_row(row as u32, of_row);
    }
    rays
}

/// A rectangle of pixels; `right` and `bottom` are exclusive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PixelBox {
    pub left: usize,
    pub top: usize,
    pub right: usize,
    pub bottom: usize,
}

impl PixelBox {
    /// Returns the box of one pixel.
    pub fn pixel(x: usize, y: usize) -> Self {
        Self {
            left: x,
            top: y,
            right: x + 1,
            bottom: y + 1,
        }
    }

    pub fn width(&self) -> usize {
        self.right - self.left
    }

    pub fn height(&self) -> usize {
        self.bottom - self.top
    }

    /// Returns the smallest box that contains both.
    pub fn union(&self, other: &Self) -> Self {
        Self {
            left: self.left.min(other.left),
            top: self.top.min(other.top),
            right: self.right.max(other.right),
            bottom: self.bottom.max(other.bottom),
        }
    }

    /// Returns whether the boxes overlap.
    pub fn meets(&self, other: &Self) -> bool {
        self.left < other.right
            && other.left < self.right
            && self.top < other.bottom
            && other.top < self.bottom
    }

    /// Returns the box enlarged by `margin` on each side, clipped to the image.
    pub fn grown(&self, margin: usize, width: usize, height: usize) -> Self {
        Self {
            left: self.left.saturating_sub(margin),
            top: self.top.saturating_sub(margin),
            right: (self.right + margin).min(width),
            bottom: (self.bottom + margin).min(height),
        }
    }
}
