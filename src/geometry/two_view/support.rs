use glam::DVec2;

use crate::Camera;

/// Matches that a cell of the first view holds on average.
const PER_CELL: f64 = 3.0;
/// Cells along a side at most.
const MAX_CELLS: f64 = 64.0;
/// How far apart neighbours may be in the second view, in cells of the first view's grid.
const REACH: f64 = 2.0;

/// Indices of the matches that are finite, those first whose neighbours in the first view are neighbours in the second
/// view too (J. Bian et al., *GMS: Grid-based Motion Statistics for Fast, Ultra-robust Feature Correspondence*, CVPR
/// 2017, here only to decide which are tried first).
pub(super) fn by_support(cameras: [&Camera; 2], matches_px: &[[DVec2; 2]]) -> Vec<u32> {
    let finite = |&i: &u32| matches_px[i as usize].iter().all(|at| at.is_finite());
    let mut order: Vec<u32> = (0..matches_px.len() as u32).filter(finite).collect();
    let grid = Grid::new(cameras[0], matches_px, &order);
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

/// Matches by the cell of the first view that they are in.
struct Grid {
    cells: usize,
    cell_px: f64,
    starts: Vec<usize>,
    members: Vec<u32>,
}

impl Grid {
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
        // A position outside the picture counts to the cell at the edge; a negative float becomes 0.
        (at_px / self.cell_px)
            .to_array()
            .map(|v| (v as usize).min(self.cells - 1))
    }

    fn cell(&self, at_px: DVec2) -> usize {
        let [column, row] = self.coordinates(at_px);
        row * self.cells + column
    }

    /// Members of the cell of a position and of the eight around it.
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
