use std::collections::BTreeMap;

use super::outcome::ViewOutcome;
use super::pictures::Pictures;
use super::plan::{Planned, plan};
use super::store::{DepthStore, Stage};
use super::work::Work;
use crate::stereo::filter::FilterOptions;
use crate::stereo::patchmatch::PatchMatchOptions;
use crate::stereo::{Engine, SelectOptions, StereoError};
use ostra_core::job::Progress;
use ostra_frames::cameras::SparsePoints;
use ostra_frames::{Frame, FrameStore};

/// How depth is made of posed pictures.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default)]
pub struct StereoOptions {
    /// Longer side of the raster that depth is found on, 32–8192 pixels; pictures are never enlarged.
    pub max_side: u32,
    /// Rounds with geometric consistency, 0–4.
    pub rounds: u32,
    /// Memory for pictures being worked on.
    pub picture_budget_bytes: usize,
    /// Which views are compared.
    pub select: SelectOptions,
    /// How planes are searched.
    pub patchmatch: PatchMatchOptions,
    /// What is kept.
    pub filter: FilterOptions,
}

impl Default for StereoOptions {
    fn default() -> Self {
        Self {
            max_side: 1600,
            rounds: 2,
            picture_budget_bytes: 96 << 20,
            select: SelectOptions::default(),
            patchmatch: PatchMatchOptions::default(),
            filter: FilterOptions::default(),
        }
    }
}

/// Which pixels of a frame's raster (its camera's `width · height`, row by row) are to be worked on; `None` = all.
pub type RasterMask<'a> = &'a (dyn Fn(usize, &ostra_geometry::Camera) -> Option<Vec<bool>> + Sync);

/// Frames, and which of them get depth.
#[derive(Clone, Copy)]
pub struct StereoRequest<'a> {
    /// All frames, by number.
    pub frames: &'a [Frame],
    /// Numbers of the frames that get depth, ascending.
    pub views: &'a [usize],
    /// Points with the keypoints that see them ([`crate::stereo::sparse_from_cameras`] where there are none).
    pub sparse: &'a SparsePoints,
    /// Masked reconstruction.
    pub mask: RasterMask<'a>,
    /// What it runs on.
    pub engine: &'a Engine,
}

/// Depth of every view that can have one: PatchMatch by the pictures alone, rounds with geometric consistency, filtering,
/// completion.
/// Some views are worked on at once, by threads of their own that share rayon's global pool. Each view's result goes to
/// `depths` in its turn; what is there already and sound is not made again. Gives what became of each view.
///
/// # Errors
/// [`StereoError::Scene`] where `depths` fails, [`StereoError::Gpu`], [`StereoError::Stopped`]; what was kept until then stays.
pub fn estimate_depths(
    request: &StereoRequest<'_>,
    store: &FrameStore,
    depths: &dyn DepthStore,
    options: &StereoOptions,
    progress: &Progress,
) -> Result<BTreeMap<usize, ViewOutcome>, StereoError> {
    let coarsest = (options.max_side, options.patchmatch.coarsest_px);
    let mut pictures = Pictures::new(
        request.frames,
        store,
        coarsest,
        options.picture_budget_bytes,
    );
    progress.stage("choose views")?;
    let Planned {
        views,
        mut outcomes,
    } = plan(request, &mut pictures, &options.select, progress)?;
    let work = Work::new((request, views), depths, options, progress)?;
    let mut make = |name: &str, stage: Stage| {
        progress.stage(name)?;
        work.make(stage, &mut pictures)
    };
    for round in 0..=options.rounds {
        make(
            if round == 0 {
                "depth"
            } else {
                "consistent depth"
            },
            Stage::Round(round),
        )?;
        if round > 0 {
            depths.forget(Stage::Round(round - 1))?;
        }
    }
    make("filter", Stage::Filtered)?;
    depths.forget(Stage::Round(options.rounds))?;
    make("complete", Stage::Complete)?;
    depths.forget(Stage::Filtered)?;
    outcomes.extend(work.outcomes()?);
    Ok(outcomes)
}
