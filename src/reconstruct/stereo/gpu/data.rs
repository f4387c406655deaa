use std::ops::Range;

use bytemuck::{Pod, Zeroable};

use crate::stereo::patchmatch::{
    LevelSource, MAX_SOURCES, SearchLevel, SweepState, Transfer, constants,
};

/// Taps of the window, four to a vector.
const QUARTERS: usize = constants::TAPS / 4;

/// `Constants` of `data.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct ConstantsData {
    worst: f32,
    bad: f32,
    noise: f32,
    far: f32,
    color_weight: f32,
    color_variance: f32,
    same_chroma: f32,
    per_chroma_range: f32,
    flat_below: f32,
    flat_variance: f32,
    flat_cost: f32,
    unlike_cost: f32,
}

const CONSTANTS: ConstantsData = ConstantsData {
    worst: constants::WORST,
    bad: constants::BAD,
    noise: constants::NOISE,
    far: constants::FAR,
    color_weight: constants::COLOR_WEIGHT,
    color_variance: constants::COLOR_VARIANCE,
    same_chroma: constants::SAME_CHROMA,
    per_chroma_range: 1.0 / constants::CHROMA_RANGE,
    flat_below: constants::FLAT_BELOW,
    flat_variance: constants::FLAT_VARIANCE,
    flat_cost: constants::FLAT_COST,
    unlike_cost: constants::UNLIKE_COST,
};

/// `Source` of `data.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct SourceData {
    there: [[f32; 4]; 4],
    back: [[f32; 4]; 4],
    size: [u32; 2],
    first: u32,
    has_found: u32,
}

/// `Level` of `data.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct LevelData {
    sources: [SourceData; MAX_SOURCES],
    dx: [[f32; 4]; QUARTERS],
    dy: [[f32; 4]; QUARTERS],
    near: [[f32; 4]; QUARTERS],
    alike: [[f32; 4]; 64],
    alike_chroma: [[f32; 4]; 64],
    constants: ConstantsData,
    focal: [f32; 2],
    per_focal: [f32; 2],
    principal: [f32; 2],
    range: [f32; 2],
    size: [u32; 2],
    source_count: u32,
    best_views: u32,
    min_facing: f32,
    min_variance: f32,
    geometric_weight: f32,
    max_geometric_px: f32,
    near_depth: f32,
    seed: u32,
    has_guides: u32,
    pull: f32,
    per_pull_reach: f32,
    padding: [u32; 3],
}

/// `SweepState` of `data.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct TurnData {
    pub color: u32,
    pub first_row: u32,
    pub end_row: u32,
    pub visit: u32,
    pub random_samples: u32,
    pub good: f32,
    pub depth: f32,
    pub slope: f32,
    pub by_depth: f32,
    pub by_slope: f32,
}

/// `Sizes` of `enlarge.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct SizesData {
    fine: [u32; 2],
    coarse: [u32; 2],
    worst: f32,
    padding: u32,
}

impl SizesData {
    /// Stores columns and rows of a finer field, and of the coarser one that it is made from.
    pub fn new(fine: [u32; 2], coarse: [u32; 2]) -> Self {
        Self {
            fine,
            coarse,
            worst: constants::WORST,
            padding: 0,
        }
    }
}

impl LevelData {
    /// Collects the input of the passes except images and fields; `firsts` holds the first texel of each source.
    pub fn new(level: &SearchLevel<'_>, firsts: &[usize]) -> Self {
        let mut sources = [SourceData::zeroed(); MAX_SOURCES];
        for ((data, source), &first) in sources.iter_mut().zip(&level.sources).zip(firsts) {
            *data = SourceData::new(source, first);
        }
        let (options, window, raster) = (level.options, level.window, &level.raster);
        Self {
            sources,
            dx: quarters(&window.dx),
            dy: quarters(&window.dy),
            near: quarters(&window.near),
            alike: quarters(&window.alike),
            alike_chroma: quarters(&window.alike_chroma),
            constants: CONSTANTS,
            focal: raster.focal,
            per_focal: raster.focal.map(|focal| 1.0 / focal),
            principal: raster.principal,
            range: level.range,
            size: [level.image.width as u32, level.image.height as u32],
            source_count: level.sources.len() as u32,
            best_views: options.best_views as u32,
            min_facing: options.min_facing,
            min_variance: options.min_variance,
            geometric_weight: options.geometric_weight,
            max_geometric_px: options.max_geometric_px,
            near_depth: options.alike_px * level.step,
            seed: options.seed,
            has_guides: u32::from(level.allowed.is_some() || !level.hints.is_empty()),
            pull: level.pull,
            per_pull_reach: 1.0 / level.pull_reach(),
            padding: [0; 3],
        }
    }
}

impl SourceData {
    fn new(source: &LevelSource, first: usize) -> Self {
        Self {
            there: columns(&source.transfer),
            back: source
                .found
                .as_ref()
                .map_or([[0.0; 4]; 4], |found| columns(&found.back)),
            size: [source.texture.width as u32, source.texture.height as u32],
            first: first as u32,
            has_found: u32::from(source.found.is_some()),
        }
    }
}

impl TurnData {
    /// Describes the scoring of some rows of one colour.
    pub fn scoring(color: u32, rows: Range<u32>) -> Self {
        Self {
            color,
            first_row: rows.start,
            end_row: rows.end,
            ..Self::zeroed()
        }
    }

    /// Describes some rows of one colour in an iteration.
    pub fn new(level: &SearchLevel<'_>, turn: SweepState, color: u32, rows: Range<u32>) -> Self {
        let changes = turn.changes(level);
        Self {
            visit: 2 * turn.visit + color,
            random_samples: turn.random_samples,
            good: turn.good(),
            depth: changes.depth,
            slope: changes.slope,
            by_depth: changes.by_depth,
            by_slope: changes.by_slope,
            ..Self::scoring(color, rows)
        }
    }
}

fn columns(transfer: &Transfer) -> [[f32; 4]; 4] {
    let [a, b, c] = transfer.matrix;
    [a, b, c, transfer.offset].map(|[x, y, z]| [x, y, z, 0.0])
}

fn quarters<const N: usize>(values: &[f32]) -> [[f32; 4]; N] {
    std::array::from_fn(|k| std::array::from_fn(|i| values[4 * k + i]))
}
