use rayon::prelude::*;

/// How much of each keypoint of one picture goes to each of another, or to nobody.
///
/// Scaling rows and columns in turn (Sinkhorn, Knopp: "Concerning Nonnegative Matrices and Doubly Stochastic Matrices",
/// Pacific Journal of Mathematics 1967) until each keypoint has given one and nobody the rest.
#[derive(Debug, Clone, PartialEq)]
pub struct Transport {
    /// Keypoints of the second picture and nobody.
    columns: usize,
    /// Row by row, the last row and column for nobody; each divided by the scales of its row and column.
    kernel: Vec<f32>,
    of_rows: Vec<f64>,
    of_columns: Vec<f64>,
}

/// Columns that one thread adds up at a time.
const BAND: usize = 128;

impl Transport {
    /// From how well each two agree, `[rows][columns]`, and the agreement `alone` with nobody.
    pub fn new(agreement: &[f32], columns: usize, alone: f32, rounds: usize) -> Self {
        let rows = agreement.len() / columns;
        let mut kernel = Vec::with_capacity((rows + 1) * (columns + 1));
        for row in agreement.chunks_exact(columns) {
            kernel.extend_from_slice(row);
            kernel.push(alone);
        }
        kernel.resize((rows + 1) * (columns + 1), alone);
        exponentials(&mut kernel, columns + 1);
        let share = |others: usize, count: usize| {
            let mut shares = vec![1.0; count + 1];
            shares[count] = others as f64;
            shares
        };
        let mut transport = Self {
            columns: columns + 1,
            kernel,
            of_rows: share(columns, rows),
            of_columns: share(rows, columns),
        };
        transport.balance(rounds);
        transport
    }

    /// Scales that make rows and columns sum to what `of_rows` and `of_columns` ask for.
    fn balance(&mut self, rounds: usize) {
        let (wanted_rows, wanted_columns) = (self.of_rows.clone(), self.of_columns.clone());
        let columns = self.columns;
        self.of_columns.fill(1.0);
        for _ in 0..rounds {
            let (kernel, of_columns) = (&self.kernel, &self.of_columns);
            self.of_rows
                .par_iter_mut()
                .enumerate()
                .for_each(|(row, scale)| {
                    let row_of = &kernel[row * columns..][..columns];
                    let sum: f64 = row_of
                        .iter()
                        .zip(of_columns)
                        .map(|(&value, scale)| f64::from(value) * scale)
                        .sum();
                    *scale = wanted_rows[row] / sum;
                });
            let of_rows = &self.of_rows;
            self.of_columns
                .par_chunks_mut(BAND)
                .enumerate()
                .for_each(|(band, scales)| {
                    let start = band * BAND;
                    scales.fill(0.0);
                    for (row, by) in kernel.chunks_exact(columns).zip(of_rows) {
                        let values = &row[start..start + scales.len()];
                        scales
                            .iter_mut()
                            .zip(values)
                            .for_each(|(sum, &value)| *sum += by * f64::from(value));
                    }
                    let wanted = &wanted_columns[start..start + scales.len()];
                    scales
                        .iter_mut()
                        .zip(wanted)
                        .for_each(|(scale, wanted)| *scale = wanted / *scale);
                });
        }
    }

    /// Pairs of which each is to the other what goes to it most, with more than `least` of it; ascending by the first.
    pub fn mutual(&self, least: f64) -> Vec<(u32, u32)> {
        let (rows, columns) = (self.of_rows.len() - 1, self.columns - 1);
        let mut best_of_column = vec![(0.0, 0); columns];
        let mut best_of_row = vec![(0.0, 0); rows];
        for (row, best) in best_of_row.iter_mut().enumerate() {
            let values = &self.kernel[row * self.columns..][..columns];
            for (column, (&value, of_column)) in values.iter().zip(&mut best_of_column).enumerate()
            {
                let share = f64::from(value) * self.of_rows[row] * self.of_columns[column];
                if share > best.0 {
                    *best = (share, column);
                }
                if share > of_column.0 {
                    *of_column = (share, row);
                }
            }
        }
        let sure = best_of_row
            .iter()
            .enumerate()
            .filter(|&(row, &(share, column))| share > least && best_of_column[column].1 == row);
        sure.map(|(row, &(_, column))| (row as u32, column as u32))
            .collect()
    }
}

/// Exponentials of all values, each less the largest of its row and then of its column: what that takes away the scales
/// give back, and nothing overflows.
fn exponentials(values: &mut [f32], columns: usize) {
    values.par_chunks_exact_mut(columns).for_each(|row| {
        let largest = row.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        row.iter_mut().for_each(|value| *value -= largest);
    });
    let mut largest = vec![f32::NEG_INFINITY; columns];
    for row in values.chunks_exact(columns) {
        largest
            .iter_mut()
            .zip(row)
            .for_each(|(largest, &value)| *largest = largest.max(value));
    }
    values.par_chunks_exact_mut(columns).for_each(|row| {
        row.iter_mut()
            .zip(&largest)
            .for_each(|(value, &largest)| *value = (*value - largest).exp());
    });
}
