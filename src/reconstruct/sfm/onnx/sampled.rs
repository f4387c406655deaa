use glam::DVec2;

use super::heat::CELL;

/// A coarse grid of rows of values, one per cell, read between the cells.
#[derive(Debug, Clone, PartialEq)]
pub struct Sampled {
    columns: usize,
    rows: usize,
    dim: usize,
    /// Cell by cell, `dim` values each.
    values: Vec<f32>,
}

impl Sampled {
    /// From a network's output, `[dim, rows, columns]`.
    #[must_use]
    pub fn new(planes: &[f32], dim: usize, columns: usize, rows: usize) -> Self {
        let cells = columns * rows;
        let mut values = vec![0.0; dim * cells];
        for (channel, plane) in planes.chunks_exact(cells).enumerate() {
            values[channel..]
                .iter_mut()
                .step_by(dim)
                .zip(plane)
                .for_each(|(value, &given)| *value = given);
        }
        Self {
            columns,
            rows,
            dim,
            values,
        }
    }

    /// With each cell's values scaled to length 1.
    #[must_use]
    pub fn normalised(mut self) -> Self {
        self.values.chunks_exact_mut(self.dim).for_each(normalise);
        self
    }

    /// Adds the values at a position in pixels (eight per cell) to `into`, bilinearly between the centres of the cells.
    pub fn read(&self, at: DVec2, into: &mut [f32]) {
        self.read_cells(at / CELL as f64 - 0.5, into);
    }

    /// As [`Self::read`], at a position in cells: the centre of the top-left cell at (0, 0).
    pub fn read_cells(&self, at: DVec2, into: &mut [f32]) {
        let (column, along_x) = between(at.x, self.columns);
        let (row, along_y) = between(at.y, self.rows);
        let (next_column, next_row) = (
            (column + 1).min(self.columns - 1),
            (row + 1).min(self.rows - 1),
        );
        let corners = [
            (column, row, (1.0 - along_x) * (1.0 - along_y)),
            (next_column, row, along_x * (1.0 - along_y)),
            (column, next_row, (1.0 - along_x) * along_y),
            (next_column, next_row, along_x * along_y),
        ];
        for (column, row, weight) in corners {
            let cell = &self.values[(row * self.columns + column) * self.dim..][..self.dim];
            into.iter_mut()
                .zip(cell)
                .for_each(|(value, given)| *value += weight * given);
        }
    }
}

/// Scales to length 1; zeros stay.
pub fn normalise(values: &mut [f32]) {
    let length = values.iter().map(|value| value * value).sum::<f32>().sqrt();
    if length > 0.0 {
        values.iter_mut().for_each(|value| *value /= length);
    }
}

/// Cell before a position, and the way towards the next, 0..1.
fn between(at: f64, cells: usize) -> (usize, f32) {
    let at = at.clamp(0.0, (cells - 1) as f64);
    (at as usize, at.fract() as f32)
}
