use glam::{DMat3, DVec2};
use pulp::Arch;

use crate::Camera;
use crate::camera::pixel_slope;
use crate::ransac::{Cutoff, LANES, within};

/// Eight matches for SIMD.
///
/// They are stored as rays in both cameras, with the squared size of a pixel on the plane z = 1.
/// Unused lanes hold NaN, which no model explains.
#[derive(Debug, Clone, Copy)]
pub(super) struct MatchLanes {
    pub x1: [f64; LANES],
    pub y1: [f64; LANES],
    pub x2: [f64; LANES],
    pub y2: [f64; LANES],
    pub pixel1: [f64; LANES],
    pub pixel2: [f64; LANES],
}

const EMPTY: MatchLanes = MatchLanes {
    x1: [f64::NAN; LANES],
    y1: [f64::NAN; LANES],
    x2: [f64::NAN; LANES],
    y2: [f64::NAN; LANES],
    pixel1: [f64::NAN; LANES],
    pixel2: [f64::NAN; LANES],
};

/// Matches between two views as rays, best supported first.
pub(super) struct Matched {
    pub pairs: Vec<[DVec2; 2]>,
    pub blocks: Vec<MatchLanes>,
    /// Index of each match in the caller's list.
    pub given: Vec<u32>,
    /// Squared threshold, square pixels.
    pub limit: f64,
    pub arch: Arch,
}

impl Matched {
    /// Converts all matches that both lenses cover to rays.
    pub fn new(cameras: [&Camera; 2], matches_px: &[[DVec2; 2]], max_error_px: f64) -> Self {
        let mut rows = Vec::with_capacity(matches_px.len());
        for index in by_support(cameras, matches_px) {
            let at_px = matches_px[index as usize];
            let rays = [0, 1].map(|side| cameras[side].unproject(at_px[side]));
            let pixels = [0, 1].map(|side| square_of_pixel(cameras[side], rays[side]));
            let finite =
                rays.iter().all(|ray| ray.is_finite()) && pixels.iter().all(|p| p.is_finite());
            if finite {
                rows.push((rays, pixels, index));
            }
        }
        Self::from_rows(&rows, max_error_px * max_error_px)
    }

    /// Returns the matches at given indices, in that order.
    pub fn chosen(&self, places: &[u32]) -> Self {
        let rows: Vec<RayMatch> = places
            .iter()
            .map(|&place| self.row(place as usize))
            .collect();
        Self::from_rows(&rows, self.limit)
    }

    fn row(&self, place: usize) -> RayMatch {
        let (block, lane) = (&self.blocks[place / LANES], place % LANES);
        (
            self.pairs[place],
            [block.pixel1[lane], block.pixel2[lane]],
            self.given[place],
        )
    }

    fn from_rows(rows: &[RayMatch], limit: f64) -> Self {
        let mut blocks = vec![EMPTY; rows.len().div_ceil(LANES)];
        for (place, (rays, pixels, _)) in rows.iter().enumerate() {
            let (block, lane) = (&mut blocks[place / LANES], place % LANES);
            (block.x1[lane], block.y1[lane]) = (rays[0].x, rays[0].y);
            (block.x2[lane], block.y2[lane]) = (rays[1].x, rays[1].y);
            (block.pixel1[lane], block.pixel2[lane]) = (pixels[0], pixels[1]);
        }
        let pairs = rows.iter().map(|row| row.0).collect();
        let given = rows.iter().map(|row| row.2).collect();
        Self {
            pairs,
            blocks,
            given,
            limit,
            arch: Arch::new(),
        }
    }

    /// Returns the sum of squared errors truncated at the limit; stops early above `enough`.
    pub fn cost(&self, enough: f64, errors: impl Fn(&MatchLanes) -> [f64; LANES]) -> f64 {
        self.arch.dispatch(Cutoff::new(
            &self.blocks,
            self.pairs.len(),
            [self.limit, enough],
            errors,
        ))
    }

    /// Returns the indices of matches whose squared error is below the limit, ascending.
    pub fn within(&self, errors: impl Fn(&MatchLanes) -> [f64; LANES]) -> Vec<u32> {
        within(&self.blocks, self.limit, errors)
    }
}

/// Rays, squared pixel sizes, and index in the caller's list.
type RayMatch = ([DVec2; 2], [f64; 2], u32);

/// Returns the area of a pixel on the plane z = 1; NaN where the lens covers nothing.
fn square_of_pixel(camera: &Camera, ray: DVec2) -> f64 {
    pixel_slope(camera, ray).map_or(f64::NAN, |slope| slope.determinant().recip())
}

/// Returns squared Sampson distances in pixels for `x2ᵀ m x1 = 0`.
///
/// P. Sampson, *Fitting conic sections to "very scattered" data*, CGIP 1982.
#[inline(always)]
pub(super) fn epipolar_errors(m: &DMat3, b: &MatchLanes) -> [f64; LANES] {
    let (c0, c1, c2) = (m.x_axis, m.y_axis, m.z_axis);
    let mut errors = [0.0; LANES];
    for (lane, error) in errors.iter_mut().enumerate() {
        let (x1, y1, x2, y2) = (b.x1[lane], b.y1[lane], b.x2[lane], b.y2[lane]);
        let line = [
            c0.x * x1 + c1.x * y1 + c2.x,
            c0.y * x1 + c1.y * y1 + c2.y,
            c0.z * x1 + c1.z * y1 + c2.z,
        ];
        let back = [c0.x * x2 + c0.y * y2 + c0.z, c1.x * x2 + c1.y * y2 + c1.z];
        let miss = x2 * line[0] + y2 * line[1] + line[2];
        let spread = b.pixel2[lane] * (line[0] * line[0] + line[1] * line[1])
            + b.pixel1[lane] * (back[0] * back[0] + back[1] * back[1]);
        *error = miss * miss / spread;
    }
    errors
}

/// Returns squared distances in pixels of the second view between `x2` and `h` applied to `x1`.
#[inline(always)]
pub(super) fn transfer_errors(h: &DMat3, b: &MatchLanes) -> [f64; LANES] {
    let (c0, c1, c2) = (h.x_axis, h.y_axis, h.z_axis);
    let mut errors = [0.0; LANES];
    for (lane, error) in errors.iter_mut().enumerate() {
        let (x1, y1) = (b.x1[lane], b.y1[lane]);
        let depth = (c0.z * x1 + c1.z * y1 + c2.z).recip();
        let dx = (c0.x * x1 + c1.x * y1 + c2.x) * depth - b.x2[lane];
        let dy = (c0.y * x1 + c1.y * y1 + c2.y) * depth - b.y2[lane];
        *error = (dx * dx + dy * dy) / b.pixel2[lane];
    }
    errors
}

/// Average number of matches in a cell of the first view.
const PER_CELL: f64 = 3.0;
/// Maximum number of cells along a side.
const MAX_CELLS: f64 = 64.0;
/// Maximum distance of neighbours in the second view, in cells of the first view's grid.
const REACH: f64 = 2.0;

/// Returns the indices of finite matches, best supported first.
///
/// A match is supported if its neighbours in the first view are neighbours in the second view too
/// (J. Bian et al., *GMS: Grid-based Motion Statistics for Fast, Ultra-robust Feature
/// Correspondence*, CVPR 2017). Here this only determines which matches are tried first.
pub(super) fn by_support(cameras: [&Camera; 2], matches_px: &[[DVec2; 2]]) -> Vec<u32> {
    let finite = |&i: &u32| matches_px[i as usize].iter().all(|at| at.is_finite());
    let mut order: Vec<u32> = (0..matches_px.len() as u32).filter(finite).collect();
    let grid = MatchGrid::new(cameras[0], matches_px, &order);
    let [w, h] = [cameras[1].width, cameras[1].height].map(f64::from);
    let reach = REACH * w.max(h) / grid.cells as f64;
    let support: Vec<u32> = (0..matches_px.len())
        .map(|i| {
            let [first, second] = matches_px[i];
            let near =
                |&j: &u32| matches_px[j as usize][1].distance_squared(second) < reach * reach;
            grid.around(first)
                .map(|cell| cell.iter().filter(|&j| near(j)).count() as u32)
                .sum()
        })
        .collect();
    order.sort_by_key(|&i| std::cmp::Reverse(support[i as usize]));
    order
}

/// Matches by their cell in the first view.
struct MatchGrid {
    cells: usize,
    cell_px: f64,
    starts: Vec<usize>,
    members: Vec<u32>,
}

impl MatchGrid {
    fn new(camera: &Camera, matches_px: &[[DVec2; 2]], chosen: &[u32]) -> Self {
        let cells = (chosen.len() as f64 / PER_CELL)
            .sqrt()
            .clamp(1.0, MAX_CELLS)
            .floor();
        let cell_px = f64::from(camera.width.max(camera.height)).max(1.0) / cells;
        let mut grid = Self {
            cells: cells as usize,
            cell_px,
            starts: Vec::new(),
            members: vec![0; chosen.len()],
        };
        let mut ends = vec![0; grid.cells * grid.cells + 1];
        let cell_of: Vec<usize> = chosen
            .iter()
            .map(|&i| grid.cell(matches_px[i as usize][0]))
            .collect();
        cell_of.iter().for_each(|&cell| ends[cell + 1] += 1);
        (1..ends.len()).for_each(|cell| ends[cell] += ends[cell - 1]);
        grid.starts.clone_from(&ends);
        for (&cell, &i) in cell_of.iter().zip(chosen) {
            grid.members[ends[cell]] = i;
            ends[cell] += 1;
        }
        grid
    }

    fn coordinates(&self, at_px: DVec2) -> [usize; 2] {
        // A position outside the image belongs to the cell at the border; a negative float becomes
        // 0.
        (at_px / self.cell_px)
            .to_array()
            .map(|v| (v as usize).min(self.cells - 1))
    }

    fn cell(&self, at_px: DVec2) -> usize {
        let [column, row] = self.coordinates(at_px);
        row * self.cells + column
    }

    /// Returns the matches in the cell of a position and in the eight cells around it.
    fn around(&self, at_px: DVec2) -> impl Iterator<Item = &[u32]> {
        let [column, row] = self.coordinates(at_px);
        let columns = column.saturating_sub(1)..=(column + 1).min(self.cells - 1);
        let rows = row.saturating_sub(1)..=(row + 1).min(self.cells - 1);
        rows.map(move |row| {
            let first = self.starts[row * self.cells + columns.start()];
            &self.members[first..self.starts[row * self.cells + columns.end() + 1]]
        })
    }
}
