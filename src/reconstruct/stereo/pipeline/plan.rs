//! Selection of the views that get depth, their sources, and the outcomes of the others.

use std::collections::BTreeMap;

use super::images::ImagePyramids;
use super::outcome::ViewOutcome;
use crate::stereo::patchmatch::MAX_SOURCES;
use crate::stereo::raster::raster_camera;
use crate::stereo::{SelectOptions, StereoEngine, StereoError, select_sources};
use glam::DVec3;
use ostra_core::job::Progress;
use ostra_core::statistics::trimmed_range;
use ostra_frames::Frame;
use ostra_frames::cameras::SparsePoints;

/// Returns which pixels of a frame's raster are to be processed; `None` = all.
///
/// The raster is that of the given camera: `width · height` values, row by row.
pub type RasterMask<'a> = &'a (dyn Fn(usize, &ostra_geometry::Camera) -> Option<Vec<bool>> + Sync);

/// Input of depth estimation: frames, and which of them get depth.
#[derive(Clone, Copy)]
pub struct StereoRequest<'a> {
    /// All frames, by number.
    pub frames: &'a [Frame],
    /// Numbers of the frames that get depth, ascending.
    pub views: &'a [usize],
    /// Points with the keypoints that see them ([`crate::stereo::sparse_from_cameras`] where there are none).
    pub sparse: &'a SparsePoints,
    /// Pixels to process, for masked reconstruction.
    pub mask: RasterMask<'a>,
    /// Device that it runs on.
    pub engine: &'a StereoEngine,
}

/// Input from which a view's depth is computed.
#[derive(Debug, Clone)]
pub struct PlannedView {
    /// Its frame number.
    pub frame: usize,
    /// The frames that it is compared with, best first.
    pub sources: Vec<usize>,
    /// These, and further frames that see much of the same.
    pub around: Vec<usize>,
    /// Smallest and largest depth to search.
    pub depth_range: [f64; 2],
    /// Pixels (column, row, depth) of the raster whose depth is known from sparse points.
    pub seeds: Vec<(usize, usize, f32)>,
}

/// The views that get depth, and the outcomes of the others.
#[derive(Debug, Default)]
pub struct Planned {
    /// By ascending frame number.
    pub views: Vec<PlannedView>,
    /// By frame number.
    pub outcomes: BTreeMap<usize, ViewOutcome>,
}

/// Chooses sources and depth ranges; views that cannot be read or compared are listed separately.
///
/// Images in which points were seen are not read here, so that depth can begin at once. If such an
/// image turns out to be unreadable, its view gets no depth, and the others do without it.
///
/// # Errors
/// [`StereoError::Stopped`].
pub fn plan(
    request: &StereoRequest<'_>,
    images: &mut ImagePyramids<'_>,
    options: &SelectOptions,
    progress: &Progress,
) -> Result<Planned, StereoError> {
    let mut planned = Planned::default();
    let mut usable = Vec::new();
    for (done, &number) in request.views.iter().enumerate() {
        progress.step(done, request.views.len())?;
        let has_camera = request.frames[number].posed_camera().is_some();
        if has_camera && sees_points(number, request.sparse) {
            usable.push(number);
            continue;
        }
        match images.get(number) {
            Ok(_) => usable.push(number),
            Err(outcome) => {
                planned.outcomes.insert(number, outcome);
            }
        }
    }
    let around = select_sources(request.frames, &usable, request.sparse, options);
    for (&number, around) in usable.iter().zip(around) {
        let frame = &request.frames[number];
        let points = seen_points(frame, number, request.sparse);
        match depth_range(&points)
            .filter(|_| !around.is_empty())
            .zip(frame.posed_camera())
        {
            Some((depth_range, (lens, _))) => {
                let raster = raster_camera(lens, images.max_side());
                let seeds = points.iter().filter_map(|x_in_camera| {
                    let at_px = raster
                        .project(*x_in_camera)
                        .filter(|&at_px| raster.contains(at_px))?;
                    Some((at_px.x as usize, at_px.y as usize, x_in_camera.z as f32))
                });
                let around: Vec<usize> = around.iter().map(|source| source.frame).collect();
                let sources = around
                    .iter()
                    .take(options.sources.clamp(1, MAX_SOURCES))
                    .copied()
                    .collect();
                planned.views.push(PlannedView {
                    frame: number,
                    sources,
                    around,
                    depth_range,
                    seeds: seeds.collect(),
                });
            }
            None => {
                planned.outcomes.insert(
                    number,
                    ViewOutcome::NothingShared {
                        points: points.len(),
                    },
                );
            }
        }
    }
    Ok(planned)
}

/// Share of the points that may lie nearer, and farther, than the range before its margin.
const OUTSIDE: f64 = 0.01;
/// Share of its ends by which the range is extended.
const MARGIN: f64 = 0.25;
/// Minimum number of points for a range.
const LEAST: usize = 5;

/// Returns whether points were found in the image of a frame.
fn sees_points(number: usize, sparse: &SparsePoints) -> bool {
    let keypoints = sparse.keypoints.get(&number);
    keypoints.is_some_and(|found| found.iter().any(|keypoint| keypoint.point.is_some()))
}

/// Returns the sparse points that a frame sees, in its camera's axes: their z is above 0.
#[must_use]
fn seen_points(frame: &Frame, number: usize, sparse: &SparsePoints) -> Vec<DVec3> {
    let Some((_, pose)) = frame.posed_camera() else {
        return Vec::new();
    };
    let keypoints = sparse.keypoints.get(&number).into_iter().flatten();
    let points = keypoints.filter_map(|keypoint| {
        let point = sparse.points.get(keypoint.point? as usize)?;
        Some(pose.transform(point.position))
    });
    points
        .filter(|x_in_camera| x_in_camera.z > 0.0 && x_in_camera.is_finite())
        .collect()
}

/// Returns the smallest and largest depth to search, from those of sparse points.
///
/// The farthest off hundredth at either end is left out, and a margin added. `None` for too few
/// points.
#[must_use]
pub fn depth_range(points_in_camera: &[DVec3]) -> Option<[f64; 2]> {
    let mut depths: Vec<f64> = points_in_camera.iter().map(|x| x.z).collect();
    let off = (OUTSIDE * depths.len() as f64) as usize;
    let [near, far] = trimmed_range(&mut depths, off)?;
    (depths.len() >= LEAST).then_some([near * (1.0 - MARGIN), far * (1.0 + MARGIN)])
}
