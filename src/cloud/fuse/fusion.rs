//! Fusion: collects the points of all frames in one grid and votes on their labels.

use serde::{Deserialize, Serialize};

use super::coverage::Coverage;
use super::fused::{ChosenVoxel, FuseReport, Fused, finish, labelled, naming};
use super::lift::{DepthUnprojection, FramePixels, LiftCount, Rays};
use super::views::{Views, check_size, nearest_corner, readable, two_digits};
use super::visibility::{measured_tolerance, posed_view};
use super::vote::{SeenPoints, VoteOptions, vote};
use super::voxel_grid::{GridPoints, VoxelGrid};
use crate::points::{OutlierOptions, outliers};
use crate::{LabelledCloud, SceneError};
use ostra_core::job::Progress;
use ostra_geometry::{DepthTolerance, PosedCamera};
use ostra_masks::LabelTree;

/// Options of a fusion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FuseOptions {
    /// Voxel edge length in world units, above 0. Each voxel that frames fill gives one point.
    ///
    /// With `None`, it is the width of a pixel at the median depth, of the labelled pixels if there
    /// are any. It is larger if that would give more than about 4 million voxels.
    pub voxel: Option<f64>,
    /// Minimum share of the votes for a label, 0–1. Points below it become unlabelled.
    pub min_confidence: f32,
    /// Whether unlabelled points are dropped (OSTRA's noise suppression).
    pub drop_unlabelled: bool,
    /// Number of frames that must have measured a point, at least 1.
    pub min_views: u32,
    /// Maximum depth difference between neighbouring pixels of one surface.
    ///
    /// It is a share of the depth, from 0 to 1. Pixels with too few neighbours within this
    /// tolerance are flying pixels between two surfaces and are left out; 1 keeps every pixel.
    pub edge_tolerance: f32,
    /// Maximum depth difference between a frame and a point that it sees, as a share of the depth.
    ///
    /// One voxel is added to it. Ranges from 0 to 1. With `None` it is measured so that nine tenths
    /// of the depths are within it.
    pub depth_tolerance: Option<f32>,
    /// Statistical outlier removal; `None` disables it.
    pub outliers: Option<OutlierOptions>,
    /// Memory budget in bytes for the (frame, pixel) pairs that voted.
    ///
    /// Beyond it the pairs are discarded, and the report says so.
    pub pair_budget_bytes: usize,
}

impl Default for FuseOptions {
    fn default() -> Self {
        Self {
            voxel: None,
            min_confidence: 0.0,
            drop_unlabelled: false,
            min_views: 1,
            edge_tolerance: 0.02,
            depth_tolerance: None,
            outliers: None,
            pair_budget_bytes: 512 << 20,
        }
    }
}

/// Number of voxels above which an automatically chosen voxel size is increased.
const MANY_VOXELS: usize = 8_000_000;
/// Number of voxels above which a given voxel size is refused: they take about 10 GB.
const MAX_VOXELS: usize = 100_000_000;
/// Average number of frames per surface place from which layers of a surface are merged.
///
/// The noise of that many frames fills the voxels in front of and behind a surface. Fewer frames
/// make few layers, and merging would damage thin parts.
const MANY_VIEWS: f64 = 10.0;
/// Factor by which an automatically chosen voxel size that was too small is increased.
const COARSER: f64 = 1.5;

/// Fuses all frames with depth and camera into a cloud, and labels it by a vote of all masks.
///
/// The same frames give the same bytes, whatever the number of threads. Frames without a camera,
/// and those without a depth, are left out and named in one warning each. A frame without depth
/// still votes if it has a camera and a mask.
///
/// # Errors
///
/// Returns [`SceneError::Request`] if options are out of range, if no frame is usable, or if the
/// size of a mask or depth differs from that of its frame. Returns the error of a frame that cannot
/// be read. Returns [`SceneError::Stopped`] if the job is stopped.
pub fn fuse(
    views: &dyn Views,
    tree: &LabelTree,
    options: &FuseOptions,
    progress: &Progress,
) -> Result<Fused, SceneError> {
    check_options(options)?;
    let mut report = FuseReport::default();
    let usable = usable_frames(views, &mut report)?;
    progress.stage("fuse")?;
    let fusion = Fusion {
        views,
        usable: &usable,
        options,
        progress,
    };
    let (voxel, expected) = match options.voxel {
        Some(voxel) => (voxel, 0),
        None => fusion.choose_voxel(&mut report)?,
    };
    report.voxel = voxel;
    let points = loop {
        match fusion.make_points(expected, &mut report)? {
            Some(points) => break points,
            // The size was chosen from a few frames; the others may see much more.
            None if options.voxel.is_none() => report.voxel = two_digits(report.voxel * COARSER),
            None => return Err(too_many(report.voxel)),
        }
    };
    report.depth_tolerance = match options.depth_tolerance {
        Some(share) => f64::from(share),
        None => measured_tolerance(&points.positions, views, &usable, report.voxel)?,
    };
    let vote_options = VoteOptions {
        tolerance: DepthTolerance {
            absolute: report.voxel,
            relative: report.depth_tolerance,
        },
        radius: report.voxel,
        min_confidence: options.min_confidence,
        pair_budget_bytes: options.pair_budget_bytes,
    };
    let voted = vote(
        &points.positions,
        &SeenPoints::new(),
        views,
        &vote_options,
        progress,
    )?;
    report.frames_voted = voted.frames;
    let mut cloud = LabelledCloud::from_positions(points.positions);
    (cloud.normals, cloud.colors) = (points.normals, points.colors);
    Ok(finish(
        labelled(cloud, &voted.votes, tree),
        voted.votes,
        options.drop_unlabelled,
        report,
    ))
}

fn too_many(voxel: f64) -> SceneError {
    let millions = MAX_VOXELS / 1_000_000;
    let what = format!(
        "a voxel size of {voxel} gives more than {millions} million voxels; give a larger one, or none"
    );
    SceneError::Request(what)
}

fn check_options(options: &FuseOptions) -> Result<(), SceneError> {
    let refuse = |what: String| Err(SceneError::Request(what));
    if let Some(voxel) = options
        .voxel
        .filter(|voxel| !(voxel.is_finite() && *voxel > 0.0))
    {
        return refuse(format!(
            "a voxel size of {voxel} is not possible; give a length above 0"
        ));
    }
    let shares = [
        options.min_confidence,
        options.edge_tolerance,
        options.depth_tolerance.unwrap_or(0.0),
    ];
    if let Some(share) = shares.iter().find(|share| !(0.0..=1.0).contains(*share)) {
        return refuse(format!(
            "confidence and tolerances must be between 0 and 1, got {share}"
        ));
    }
    Ok(())
}

fn no_depth() -> SceneError {
    SceneError::Request(
        "no frame has both a depth and a camera with a pose; add depth and cameras first".into(),
    )
}

/// Returns the frames that contribute points; the warnings name the others.
fn usable_frames(views: &dyn Views, report: &mut FuseReport) -> Result<Vec<usize>, SceneError> {
    let (mut usable, mut no_camera, mut no_depth_names) = (Vec::new(), Vec::new(), Vec::new());
    for (index, frame) in views.frames().iter().enumerate() {
        match (frame.posed_camera().is_some(), views.has_depth(index)) {
            (true, true) => usable.push(index),
            (true, false) => no_depth_names.push(frame.name.as_str()),
            (false, _) => no_camera.push(frame.name.as_str()),
        }
    }
    report.warnings.extend(naming(
        [
            "has no camera and is left out",
            "have no camera and are left out",
        ],
        &no_camera,
    ));
    report.warnings.extend(naming(
        [
            "has no depth and gives no points",
            "have no depth and give no points",
        ],
        &no_depth_names,
    ));
    if usable.is_empty() {
        Err(no_depth())
    } else {
        Ok(usable)
    }
}

fn load(views: &dyn Views, index: usize) -> Result<Option<FramePixels>, SceneError> {
    let frame = &views.frames()[index];
    let (image, depth) = rayon::join(|| views.image(index), || views.depth(index));
    let (Some(image), Some(depth)) = (readable(image)?, depth?) else {
        return Ok(None);
    };
    check_size(frame, "picture", image.width, image.height)?;
    check_size(frame, "depth", depth.width, depth.height)?;
    Ok(Some(FramePixels { image, depth }))
}

/// One fusion: its frames, options and progress.
struct Fusion<'a> {
    views: &'a dyn Views,
    /// The frames that contribute points.
    usable: &'a [usize],
    options: &'a FuseOptions,
    progress: &'a Progress,
}

impl Fusion<'_> {
    /// Chooses the default voxel size and estimates the number of voxels.
    fn choose_voxel(&self, report: &mut FuseReport) -> Result<(f64, usize), SceneError> {
        let coverage = Coverage::measure(self.views, self.usable, false, self.progress)?
            .ok_or_else(|| {
                self.usable
                    .first()
                    .and_then(|&first| self.views.fault(first))
                    .unwrap_or_else(no_depth)
            })?;
        report.chosen = Some(ChosenVoxel {
            footprint: coverage.footprint,
            views: coverage.views,
        });
        let voxel = coverage.point_voxel();
        Ok((voxel, (coverage.cells(voxel) as usize).min(MANY_VOXELS)))
    }

    /// Adds all usable frames to the grid, decoding each frame while the previous one is added.
    ///
    /// Returns `None` if there are too many voxels.
    fn make_points(
        &self,
        expected: usize,
        report: &mut FuseReport,
    ) -> Result<Option<GridPoints>, SceneError> {
        let Self {
            views,
            usable,
            options,
            progress,
        } = *self;
        (report.frames_fused, report.pixels, report.dropped) = Default::default();
        let most = if options.voxel.is_some() {
            MAX_VOXELS
        } else {
            MANY_VOXELS
        };
        let mut grid = VoxelGrid::new(nearest_corner(views, usable), report.voxel, expected);
        let mut rays: Option<Rays> = None;
        let mut unreadable = Vec::new();
        let mut next = load(views, usable[0])?;
        for (done, &index) in usable.iter().enumerate() {
            progress.step(done, usable.len())?;
            let current = next.take();
            if current.is_none() {
                unreadable.push(views.frames()[index].name.as_str());
            }
            let Some(view) = posed_view(&views.frames()[index])? else {
                continue;
            };
            let (added, loaded) = rayon::join(
                || {
                    current
                        .map(|pixels| self.add_frame(&mut grid, &mut rays, &view, &pixels))
                        .transpose()
                },
                || {
                    usable
                        .get(done + 1)
                        .map_or(Ok(None), |&index| load(views, index))
                },
            );
            next = loaded?;
            if let Some(count) = added? {
                report.frames_fused += 1;
                report.pixels += count.measured;
                report.dropped.flying_pixels += count.flying;
                report.dropped.far_pixels += count.beyond;
            }
            if grid.voxels() > most {
                return Ok(None);
            }
        }
        let warning = naming(
            [
                "cannot be read (image or depth) and gives no points",
                "cannot be read (image or depth) and give no points",
            ],
            &unreadable,
        );
        if let (0, Some(warning)) = (report.frames_fused, &warning) {
            let unknown = || {
                SceneError::Request(format!(
                    "no frame can be read: {warning}; check images and depths"
                ))
            };
            return Err(views.fault(usable[0]).unwrap_or_else(unknown));
        }
        report.warnings.extend(warning);
        let one_layer = report
            .chosen
            .is_some_and(|chosen| chosen.views >= MANY_VIEWS);
        let points = grid.into_points(options.min_views, one_layer, progress)?;
        (report.dropped.few_views, report.dropped.layers) = (points.few_views, points.merged);
        self.keep_inliers(points, report).map(Some)
    }

    /// Adds one frame to the grid, with the rays of the previous frame if its camera is the same.
    fn add_frame(
        &self,
        grid: &mut VoxelGrid,
        rays: &mut Option<Rays>,
        view: &PosedCamera,
        pixels: &FramePixels,
    ) -> Result<LiftCount, SceneError> {
        let rays = match rays.take_if(|rays| !rays.fit(&view.camera)) {
            Some(_) => rays.insert(Rays::new(&view.camera)),
            None => rays.get_or_insert_with(|| Rays::new(&view.camera)),
        };
        let lift = DepthUnprojection::new(
            view,
            rays,
            pixels,
            grid.frame(),
            self.options.edge_tolerance,
        );
        Ok(grid.add(&lift, pixels.depth.height, self.progress)?)
    }

    fn keep_inliers(
        &self,
        points: GridPoints,
        report: &mut FuseReport,
    ) -> Result<GridPoints, SceneError> {
        let Some(outlier_options) = &self.options.outliers else {
            return Ok(points);
        };
        let far = outliers(&points.positions, outlier_options, self.progress)?;
        report.dropped.outliers = far.iter().filter(|&&far| far).count();
        let near: Vec<usize> = (0..far.len()).filter(|&index| !far[index]).collect();
        Ok(GridPoints {
            positions: near.iter().map(|&index| points.positions[index]).collect(),
            normals: near.iter().map(|&index| points.normals[index]).collect(),
            colors: near.iter().map(|&index| points.colors[index]).collect(),
            few_views: points.few_views,
            merged: points.merged,
        })
    }
}
