// The counterpart of `stereo/patchmatch` on a graphics card: the same hypotheses in the same order, the same random
// numbers, sums in the same order, ties broken the same way. One thread works on one pixel of one colour of the
// checkerboard.
//
// WGSL lets compilers reorder sums and fuse products into them. Here and on the processor, mixed sums begin with a term
// that is not a product: compilers bring others into that order, and leave these. If a card fuses, depths differ by
// rounding, so that some pixels without texture get another result.

const MAX_SOURCES: u32 = 8u;
// Hypotheses compared when views are chosen.
const COMPARED: u32 = 10u;
// Vectors of four taps.
const QUARTERS: u32 = 6u;
// Stands for infinity, which WGSL does not guarantee.
const NEVER: f32 = 1e30;

// A source view: the transfer there and back (columns of a matrix, offset), columns and rows, its first texel.
struct Source {
    matrix: array<vec4f, 3>,
    offset: vec4f,
    back: array<vec4f, 3>,
    back_offset: vec4f,
    size: vec2u,
    first: u32,
    has_found: u32,
}

// Constants of the processor's modules, which have the same names in capitals.
struct Constants {
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

struct Level {
    sources: array<Source, MAX_SOURCES>,
    dx: array<vec4f, QUARTERS>,
    dy: array<vec4f, QUARTERS>,
    near: array<vec4f, QUARTERS>,
    alike: array<vec4f, 64>,
    alike_chroma: array<vec4f, 64>,
    constants: Constants,
    focal: vec2f,
    per_focal: vec2f,
    principal: vec2f,
    // Smallest and largest inverse depth.
    range: vec2f,
    size: vec2u,
    source_count: u32,
    best_views: u32,
    min_facing: f32,
    min_variance: f32,
    geometric_weight: f32,
    max_geometric_px: f32,
    // Change of inverse depth below which hypotheses count as the same.
    near_depth: f32,
    seed: u32,
    has_guides: u32,
    // How much hints pull flat patches, at most, and per inverse depth.
    pull: f32,
    per_pull_reach: f32,
}

struct Turn {
    color: u32,
    // Rows that this dispatch works on.
    first_row: u32,
    end_row: u32,
    visit: u32,
    draws: u32,
    good: f32,
    // Maximum random change of inverse depth, and of slope as a share.
    depth: f32,
    slope: f32,
    // Steps of the parabola in inverse depth and in slope.
    by_depth: f32,
    by_slope: f32,
}

// A hypothesis: inverse depth, and its change per pixel to the right and down; then, in fields, its cost.
@group(0) @binding(0) var<uniform> level: Level;
@group(0) @binding(1) var<uniform> turn: Turn;
// Four neighbouring greys per element.
@group(0) @binding(2) var<storage, read> picture: array<u32>;
// The same of all sources, one after the other.
@group(0) @binding(3) var<storage, read> texels: array<u32>;
// For each pixel a hypothesis from elsewhere (none = inverse depth 0), and flags for being processed (1), and for a
// surface known from the surroundings (2).
@group(0) @binding(4) var<storage, read> guides: array<vec4f>;
// Planes that an earlier round found in the sources, at the indices of their texels.
@group(0) @binding(5) var<storage, read> found_depth: array<f32>;
@group(0) @binding(6) var<storage, read> found_right: array<f32>;
@group(0) @binding(7) var<storage, read> found_down: array<f32>;
// Two bytes of chroma per pixel: the image's, then the sources', at the indices of their texels.
@group(0) @binding(8) var<storage, read> chromas: array<u32>;
// Red pixels, then black ones.
@group(0) @binding(9) var<storage, read_write> field: array<vec4f>;

// The pixel, and its surroundings in the reference image.
var<private> pixel: vec2f;
var<private> weights: array<vec4f, QUARTERS>;
var<private> weighted: array<vec4f, QUARTERS>;
var<private> variance: f32;
var<private> patch_chroma: vec2f;
var<private> color_weight: f32;
var<private> flatness: f32;
// The inverse depth that a flat patch is pulled to.
var<private> pulled_to: f32;
