//! Fusion: the points of all frames in one grid, and the vote on them.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::coverage::Coverage;
use super::fused::{ChosenVoxel, FuseReport, Fused, finish, labelled, naming};
use super::lift::{Lift, LiftCount, Rays};
use super::views::{Views, check_size, nearest_corner, readable, two_digits};
use super::visibility::{measured_tolerance, posed_view};
use super::vote::{SeenPoints, VoteOptions, vote};
use super::voxel_grid::{Grid, GridPoints};
use crate::points::{OutlierOptions, outliers};
use crate::{LabelledCloud, SceneError};
use ostra_core::job::Progress;
use ostra_frames::{DepthMap, Image};
use ostra_geometry::{DepthTolerance, PosedCamera};
use ostra_masks::LabelTree;

/// How frames become a labelled cloud.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FuseOptions {
    /// Edge of a voxel in world units, above 0; every voxel that frames fill gives one point. `None` = what one pixel covers at the median depth, of the labelled pixels where there are
    /// some, or more where that gives more than about 4 million voxels.
    pub voxel: Option<f64>,
    /// Points whose label won a smaller share of the votes become unlabelled; 0–1.
    pub min_confidence: f32,
    /// Leave points without a label out (the noise suppression of OSTRA).
    pub drop_unlabelled: bool,
    /// Frames that must have measured a point, at least 1.
    pub min_views: u32,
    /// A pixel counts as one surface with a neighbour whose depth differs by at most this share of the depth; pixels
    /// with too few such neighbours fly between two surfaces and are left out. 0–1; 1 keeps every pixel.
    pub edge_tolerance: f32,
    /// A frame sees a point when their depths differ by at most this share of the depth, and one voxel; 0–1. `None` =
    /// measured: what nine tenths of the depths keep to.
    pub depth_tolerance: Option<f32>,
    /// Statistical outlier removal; `None` = off.
    pub outliers: Option<OutlierOptions>,
    /// Memory for the (frame, pixel) pairs that voted; beyond it they are not kept, and the report says so.
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

/// Voxels above which a size that nobody gave was chosen too small.
const MANY_VOXELS: usize = 8_000_000;
/// Voxels above which a given size is refused: they take about 10 GB.
const MAX_VOXELS: usize = 100_000_000;
/// Frames that see a place, on average, from which on the layers of a surface become one: noise of so many frames fills the
/// voxels before and behind it. Fewer frames make few layers, and thin parts lose by it.
const MANY_VIEWS: f64 = 10.0;
/// What a voxel size that was chosen too small is multiplied by.
const COARSER: f64 = 1.5;

/// Makes a labelled cloud from all frames with depth and camera, and lets every frame with a mask vote on it.
///
/// The same frames give the same bytes, whatever the number of threads. Frames without camera or depth are named in one
/// warning each and left out (without depth but with camera and mask a frame still votes).
///
/// # Errors
/// [`SceneError::Request`] for options out of range, no usable frame, a mask or depth of another size than its frame;
/// what reading a frame says; [`SceneError::Stopped`].
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
    let (voxel, expected) = match options.voxel {
        Some(voxel) => (voxel, 0),
        None => choose_voxel(views, &usable, &mut report, progress)?,
    };
    report.voxel = voxel;
    let points = loop {
        match make_points(views, &usable, options, expected, &mut report, progress)? {
            Some(points) => break points,
            // Few frames are looked at to choose; others may see much more.
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

/// The default voxel size, and about how many voxels there will be.
fn choose_voxel(
    views: &dyn Views,
    usable: &[usize],
    report: &mut FuseReport,
    progress: &Progress,
) -> Result<(f64, usize), SceneError> {
    let coverage = Coverage::measure(views, usable, false, progress)?.ok_or_else(|| {
        usable
            .first()
            .and_then(|&first| views.fault(first))
            .unwrap_or_else(no_depth)
    })?;
    report.chosen = Some(ChosenVoxel {
        footprint: coverage.footprint,
        views: coverage.views,
    });
    let voxel = coverage.point_voxel();
    Ok((voxel, (coverage.cells(voxel) as usize).min(MANY_VOXELS)))
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
            "{share} is no share; confidence and tolerances go from 0 to 1"
        ));
    }
    Ok(())
}

fn no_depth() -> SceneError {
    SceneError::Request(
        "no frame has both a depth and a camera with a pose; add depth and cameras first".into(),
    )
}

/// The frames that give points; the others are named in the warnings.
fn usable_frames(views: &dyn Views, report: &mut FuseReport) -> Result<Vec<usize>, SceneError> {
    let (mut usable, mut no_camera, mut no_depth_names) = (Vec::new(), Vec::new(), Vec::new());
    for (index, frame) in views.frames().iter().enumerate() {
        match (frame.posed_camera().is_some(), views.has_depth(index)) {
            (true, true) => usable.push(index),
            (true, false) => no_depth_names.push(frame.name.as_str()),
            (false, _) => no_camera.push(frame.name.as_str()),
        }
    }
    report
        .warnings
        .extend(naming("have no camera and are left out", &no_camera));
    report
        .warnings
        .extend(naming("have no depth and give no points", &no_depth_names));
    if usable.is_empty() {
        Err(no_depth())
    } else {
        Ok(usable)
    }
}

/// The pixels of a frame.
type Pixels = (Arc<Image>, Arc<DepthMap>);

fn load(views: &dyn Views, index: usize) -> Result<Option<Pixels>, SceneError> {
    let frame = &views.frames()[index];
    let (image, depth) = rayon::join(|| views.image(index), || views.depth(index));
    let (Some(image), Some(depth)) = (readable(image)?, depth?) else {
        return Ok(None);
    };
    check_size(frame, "picture", image.width, image.height)?;
    check_size(frame, "depth", depth.width, depth.height)?;
    Ok(Some((image, depth)))
}

/// Streams all usable frames through the grid; while one is added the next is decoded. `None` where there are too many voxels.
fn make_points(
    views: &dyn Views,
    usable: &[usize],
    options: &FuseOptions,
    expected: usize,
    report: &mut FuseReport,
    progress: &Progress,
) -> Result<Option<GridPoints>, SceneError> {
    (report.frames_fused, report.pixels, report.dropped) = Default::default();
    let most = if options.voxel.is_some() {
        MAX_VOXELS
    } else {
        MANY_VOXELS
    };
    let mut grid = Grid::new(nearest_corner(views, usable), report.voxel, expected);
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
                    .map(|pixels| {
                        add_frame(&mut grid, &mut rays, &view, &pixels, options, progress)
                    })
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
        "cannot be read (image or depth) and give no points",
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
    keep_inliers(points, options, report, progress).map(Some)
}

fn add_frame(
    grid: &mut Grid,
    rays: &mut Option<Rays>,
    view: &PosedCamera,
    (image, depth): &Pixels,
    options: &FuseOptions,
    progress: &Progress,
) -> Result<LiftCount, SceneError> {
    let rays = match rays.take_if(|rays| !rays.fit(&view.camera)) {
        Some(_) => rays.insert(Rays::new(&view.camera)),
        None => rays.get_or_insert_with(|| Rays::new(&view.camera)),
    };
    let lift = Lift::new(
        view,
        rays,
        image,
        depth,
        grid.frame(),
        options.edge_tolerance,
    );
    Ok(grid.add(&lift, depth.height, progress)?)
}

fn keep_inliers(
    points: GridPoints,
    options: &FuseOptions,
    report: &mut FuseReport,
    progress: &Progress,
) -> Result<GridPoints, SceneError> {
    let Some(outlier_options) = &options.outliers else {
        return Ok(points);
    };
    let far = outliers(&points.positions, outlier_options, progress)?;
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
