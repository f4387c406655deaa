use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DVec2, Vec3};
use rustc_hash::FxHashSet;

use super::cloud::Snapshot;
use crate::Event;
use crate::query::{QueryKey, WithWarnings};
use anyhow::Result;
use ostra_cloud::LabelledCloud;
use ostra_cloud::fuse::naming;
use ostra_core::job::Progress;
use ostra_core::statistics::upper_median;
use ostra_frames::{Frame, FrameError, FrameStore};
use ostra_geometry::Pose;
use ostra_masks::{LabelMask, RunMask};
use ostra_project::{Project, ResultKind};

/// Maximum number of points of the shown frame.
const POINTS_OF_FRAME: usize = 200_000;
/// Maximum number of points of all frames together.
const POINTS_OF_ALL: usize = 300_000;
/// Maximum number of frames that are read for the points of all.
const FRAMES: usize = 150;
/// Number of pixels of each of these frames.
const SAMPLED: usize = 30_000;

/// Points of the depth maps, before a cloud is fused.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthPoints {
    /// The points, with the labels of the pixels that they come from.
    pub cloud: Arc<LabelledCloud>,
    /// Whether there are points of all frames, and not only of the shown one.
    pub has_all: bool,
    /// Whether positions are in the world; otherwise they are those of the shown frame's camera.
    pub in_world: bool,
}

/// Pixels with depth and their positions in space.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct DepthPixels {
    positions: Vec<Vec3>,
    colors: Vec<[u8; 3]>,
    pixels: Vec<PixelOf>,
}

/// A pixel of a frame, counted along the rows of its image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct PixelOf {
    frame: usize,
    index: u32,
    /// Columns and rows of the image.
    size: [u32; 2],
}

impl DepthPixels {
    fn push(&mut self, position: Vec3, color: [u8; 3], pixel: PixelOf) {
        self.positions.push(position);
        self.colors.push(color);
        self.pixels.push(pixel);
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }
}

/// The frames of a project, and which of their depths fit the cameras.
#[derive(Clone)]
pub(crate) struct DepthFrames {
    pub(crate) frames: Arc<Vec<Frame>>,
    /// Whether estimated depths were made with other cameras, and have no place in the world.
    has_stale_depths: bool,
}

impl DepthFrames {
    /// Returns the frames of a project, or `None` if none of them has a depth to show.
    pub(crate) fn of(project: &Project) -> Option<Self> {
        let record = project.results.get(&ResultKind::Depths);
        let frames = Self {
            frames: Arc::clone(&project.frames),
            has_stale_depths: record.is_some_and(|record| record.stale),
        };
        let has_any = frames.frames.iter().any(|frame| frames.has_depth(frame));
        has_any.then_some(frames)
    }

    fn has_depth(&self, frame: &Frame) -> bool {
        frame.has_sensor_depth() || (frame.depth.is_some() && !self.has_stale_depths)
    }

    /// Returns whether any camera has a pose.
    pub(crate) fn has_poses(&self) -> bool {
        self.frames
            .iter()
            .any(|frame| frame.posed_camera().is_some())
    }
}

impl PartialEq for DepthFrames {
    fn eq(&self, other: &Self) -> bool {
        self.has_stale_depths == other.has_stale_depths && Arc::ptr_eq(&self.frames, &other.frames)
    }
}

/// The shown frame among the frames of the project.
#[derive(Clone, PartialEq)]
pub(crate) struct FramePointsKey {
    pub(crate) all: DepthFrames,
    pub(crate) frame: usize,
}

impl QueryKey for FramePointsKey {
    const TITLE: &'static str = "Place depth of frame";

    /// The points of another frame are shown until those of the wanted one are ready.
    fn serves(&self, wanted: &Self) -> bool {
        self.all == wanted.all
    }
}

/// All frames of the project.
#[derive(Clone, PartialEq)]
pub(crate) struct AllPointsKey {
    pub(crate) all: DepthFrames,
}

impl QueryKey for AllPointsKey {
    const TITLE: &'static str = "Place depth of all frames";
    const EVENT: Option<Event> = Some(Event::CloudChanged);
}

/// Placed pixels and the masks that label them.
#[derive(Clone)]
pub(crate) struct DepthPointsKey {
    frames: DepthFrames,
    shown: Option<Arc<DepthPixels>>,
    all: Option<Arc<DepthPixels>>,
    masks: BTreeMap<usize, Arc<RunMask>>,
}

impl DepthPointsKey {
    /// Creates the key; `mask` returns the mask of a frame.
    ///
    /// Returns `None` if there are no points.
    pub(crate) fn new(
        frames: &DepthFrames,
        shown: Option<&Arc<DepthPixels>>,
        all: Option<&Arc<DepthPixels>>,
        mask: impl Fn(usize) -> Option<Arc<RunMask>>,
    ) -> Option<Self> {
        let [shown, all] = [shown, all].map(|part| part.filter(|pixels| !pixels.is_empty()));
        if shown.is_none() && all.is_none() {
            return None;
        }
        // Masks of frames without points change nothing, but asking for them costs little.
        let of_shown = shown.and_then(|shown| shown.pixels.first());
        let masks = (0..frames.frames.len())
            .filter(|&frame| all.is_some() || of_shown.is_some_and(|pixel| pixel.frame == frame))
            .filter_map(|frame| Some((frame, mask(frame)?)));
        Some(Self {
            frames: frames.clone(),
            shown: shown.cloned(),
            all: all.cloned(),
            masks: masks.collect(),
        })
    }
}

impl PartialEq for DepthPointsKey {
    fn eq(&self, other: &Self) -> bool {
        let is_same = |a: &Option<Arc<DepthPixels>>, b: &Option<Arc<DepthPixels>>| match (a, b) {
            (Some(a), Some(b)) => Arc::ptr_eq(a, b),
            (a, b) => a.is_none() && b.is_none(),
        };
        let pairs = || self.masks.iter().zip(&other.masks);
        self.frames == other.frames
            && is_same(&self.shown, &other.shown)
            && is_same(&self.all, &other.all)
            && self.masks.len() == other.masks.len()
            && pairs().all(|((frame, a), (of, b))| frame == of && (Arc::ptr_eq(a, b) || a == b))
    }
}

impl QueryKey for DepthPointsKey {
    const TITLE: &'static str = "Label points of depth maps";
    const EVENT: Option<Event> = Some(Event::CloudChanged);

    /// Points with the labels of earlier masks are shown until the new ones are ready.
    fn serves(&self, wanted: &Self) -> bool {
        self.frames == wanted.frames
    }
}

/// Places the pixels of the shown frame.
///
/// While no frame has a pose, they are placed in the frame's own camera. The depth of a frame that
/// cannot be read gives no points; the image view reports the error.
///
/// # Errors
///
/// Returns an error if the progress is stopped.
pub(crate) fn place_frame(
    snapshot: &Snapshot,
    key: &FramePointsKey,
    progress: &Progress,
) -> Result<DepthPixels> {
    progress.check()?;
    let Some(pose) = pose_to_show(key) else {
        return Ok(DepthPixels::default());
    };
    let source = PlacedPixels {
        store: &snapshot.store,
        frame: &key.all.frames[key.frame],
        number: key.frame,
        camera_from_world: pose,
    };
    let mut placed = DepthPixels::default();
    let read = source.each(POINTS_OF_FRAME, |position, color, pixel, _| {
        placed.push(position, color, pixel);
    });
    Ok(if read.is_ok() {
        placed
    } else {
        DepthPixels::default()
    })
}

/// Returns the pose for the points of a frame, or `None` if they have no place.
fn pose_to_show(key: &FramePointsKey) -> Option<Pose> {
    let frame = key.all.frames.get(key.frame)?;
    let pose = frame.camera?.camera_from_world;
    let own = (!key.all.has_poses()).then(Pose::default);
    pose.or(own).filter(|_| key.all.has_depth(frame))
}

/// Places an evenly thinned sample of the pixels of all frames with depth and a posed camera.
///
/// Frames are read one after the other. A warning names those that cannot be read.
///
/// # Errors
///
/// Returns an error if the progress is stopped.
pub(crate) fn place_all(
    snapshot: &Snapshot,
    key: &AllPointsKey,
    progress: &Progress,
) -> Result<WithWarnings<DepthPixels>> {
    let placed = (key.all.frames.iter().enumerate())
        .filter(|(_, frame)| key.all.has_depth(frame))
        .filter_map(|(number, frame)| Some((number, frame, *frame.posed_camera()?.1)));
    let step = placed.clone().count().div_ceil(FRAMES).max(1);
    let mut thinned = Thinned::default();
    let mut unread = Vec::new();
    for (number, frame, camera_from_world) in placed.step_by(step) {
        progress.check()?;
        let source = PlacedPixels {
            store: &snapshot.store,
            frame,
            number,
            camera_from_world,
        };
        let read = source.each(SAMPLED, |position, color, pixel, spacing| {
            thinned.add(position, color, pixel, spacing);
        });
        if read.is_err() {
            unread.push(frame.name.as_str());
        }
    }
    let what = [
        "has an image or depth that cannot be read, and its points are not shown; check its files",
        "have an image or depth that cannot be read, and their points are not shown; check their files",
    ];
    Ok(WithWarnings {
        value: thinned.kept,
        warnings: naming(what, &unread).into_iter().collect(),
    })
}

/// A frame whose pixels are placed in space.
struct PlacedPixels<'a> {
    store: &'a FrameStore,
    frame: &'a Frame,
    number: usize,
    camera_from_world: Pose,
}

impl PlacedPixels<'_> {
    /// Passes at most about `most` evenly spaced pixels to `take`.
    ///
    /// It gets the position, the colour, the pixel, and the median spacing of the positions.
    fn each(
        &self,
        most: usize,
        mut take: impl FnMut(Vec3, [u8; 3], PixelOf, f32),
    ) -> Result<(), FrameError> {
        let (Some(camera), Some(depth)) = (self.frame.camera, self.store.depth(self.frame)?) else {
            return Ok(());
        };
        let image = self.store.image(self.frame)?;
        let known = depth.depths.iter().filter(|&&depth| depth > 0.0).count();
        let step = (known as f64 / most as f64).sqrt().ceil().max(1.0) as usize;
        let (width, height) = (depth.width as usize, depth.height as usize);
        let places = || {
            let rows = (step / 2..height).step_by(step);
            rows.flat_map(move |y| {
                (step / 2..width)
                    .step_by(step)
                    .map(move |x| (x, y, y * width + x))
            })
            .filter(|&(.., at)| depth.depths[at] > 0.0)
        };
        let mut depths: Vec<f32> = places().map(|(.., at)| depth.depths[at]).collect();
        let lens = camera.intrinsics;
        let spacing = upper_median(&mut depths).unwrap_or(0.0) * step as f32
            / (lens.focal_px.x as f32).max(f32::MIN_POSITIVE);
        let world_from_camera = self.camera_from_world.inverse();
        for (x, y, at) in places() {
            let ray = lens.unproject(DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
            let in_camera = ray.extend(1.0) * f64::from(depth.depths[at]);
            let pixel = PixelOf {
                frame: self.number,
                index: at as u32,
                size: [depth.width, depth.height],
            };
            let color = image.at(x as u32, y as u32);
            take(
                world_from_camera.transform(in_camera).as_vec3(),
                color,
                pixel,
                spacing,
            );
        }
        Ok(())
    }
}

/// Pixels of which one is kept in each cube of a grid that becomes coarser as needed.
#[derive(Default)]
struct Thinned {
    /// Side of the cubes; 0 before the first pixel.
    side: f32,
    taken: FxHashSet<[i32; 3]>,
    kept: DepthPixels,
}

impl Thinned {
    fn add(&mut self, position: Vec3, color: [u8; 3], pixel: PixelOf, spacing: f32) {
        if self.side == 0.0 {
            self.side = spacing;
        }
        if !position.is_finite() || !self.taken.insert(self.cube(position)) {
            return;
        }
        self.kept.push(position, color, pixel);
        while self.kept.positions.len() > POINTS_OF_ALL {
            self.coarsen();
        }
    }

    fn cube(&self, position: Vec3) -> [i32; 3] {
        (position / self.side)
            .to_array()
            .map(|along| along.floor() as i32)
    }

    fn coarsen(&mut self) {
        self.side *= 1.3;
        self.taken.clear();
        let before = std::mem::take(&mut self.kept);
        for (at, &position) in before.positions.iter().enumerate() {
            if self.taken.insert(self.cube(position)) {
                self.kept
                    .push(position, before.colors[at], before.pixels[at]);
            }
        }
    }
}

/// Labels the placed pixels by the masks, without reading images or depths.
///
/// # Errors
///
/// Returns an error if the progress is stopped.
pub(crate) fn label_points(key: &DepthPointsKey, progress: &Progress) -> Result<DepthPoints> {
    let mut masks: BTreeMap<usize, LabelMask> = BTreeMap::new();
    let mut cloud = LabelledCloud::default();
    for pixels in [&key.all, &key.shown].into_iter().flatten() {
        progress.check()?;
        let mut part = LabelledCloud::from_positions(pixels.positions.clone());
        part.colors.clone_from(&pixels.colors);
        for (label, pixel) in part.labels.iter_mut().zip(&pixels.pixels) {
            let Some(runs) = key.masks.get(&pixel.frame) else {
                continue;
            };
            let mask = masks.entry(pixel.frame).or_insert_with(|| runs.decode());
            if [mask.width, mask.height] == pixel.size {
                *label = mask.ids[pixel.index as usize];
            }
        }
        part.confidence.fill(1.0);
        cloud.append(&part);
    }
    Ok(DepthPoints {
        cloud: Arc::new(cloud),
        has_all: key.all.is_some(),
        in_world: key.frames.has_poses(),
    })
}

#[cfg(test)]
mod tests;
