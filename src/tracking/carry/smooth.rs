/// How much of a value passes from a pixel to the next, for every pair of neighbours in a box: 1 on an even surface with
/// unlimited reach, less over edges.
#[derive(Debug, Clone)]
pub struct Passing {
    pub width: usize,
    /// From the pixel before in the row; the first of a row is unused.
    pub across: Vec<f32>,
    /// From the pixel above; the first row is unused.
    pub down: Vec<f32>,
}

impl Passing {
    /// The part in a smaller box, whose first pixel is in column `left`, row `top`.
    pub fn part(&self, left: usize, top: usize, width: usize, height: usize) -> Self {
        let rows = |all: &[f32]| -> Vec<f32> {
            let rows = all.chunks_exact(self.width).skip(top).take(height);
            rows.flat_map(|row| &row[left..left + width])
                .copied()
                .collect()
        };
        Self {
            width,
            across: rows(&self.across),
            down: rows(&self.down),
        }
    }
}

/// Rounds of the filter, each with half the reach of the one before.
pub const ROUNDS: i32 = 3;

/// Standard deviation of the first round over that of all rounds together.
pub fn first_round_share() -> f32 {
    3f32.sqrt() * 2f32.powi(ROUNDS - 1) / (4f32.powi(ROUNDS) - 1.0).sqrt()
}

/// Smooths pairs of values along what looks alike: the recursive filter of E. Gastal and M. Oliveira, *Domain transform for
/// edge-aware image and video processing*, SIGGRAPH 2011. `passing` is that of the first round.
pub fn smooth(values: &mut [[f32; 2]], mut passing: Passing) {
    for round in 0..ROUNDS {
        if round > 0 {
            // Half the reach: e^(−2d) is the square of e^(−d).
            passing
                .across
                .iter_mut()
                .chain(&mut passing.down)
                .for_each(|share| *share *= *share);
        }
        along_rows(values, &passing);
        along_columns(values, &passing);
    }
}

fn blend(to: &mut [f32; 2], from: [f32; 2], share: f32) {
    to[0] += share * (from[0] - to[0]);
    to[1] += share * (from[1] - to[1]);
}

fn along_rows(values: &mut [[f32; 2]], passing: &Passing) {
    for (row, share) in values
        .chunks_exact_mut(passing.width)
        .zip(passing.across.chunks_exact(passing.width))
    {
        for x in 1..row.len() {
            let from = row[x - 1];
            blend(&mut row[x], from, share[x]);
        }
        for x in (1..row.len()).rev() {
            let from = row[x];
            blend(&mut row[x - 1], from, share[x]);
        }
    }
}

fn along_columns(values: &mut [[f32; 2]], passing: &Passing) {
    let width = passing.width;
    let rows = values.len() / width;
    for y in 1..rows {
        let (above, below) = values.split_at_mut(y * width);
        for ((from, to), share) in above[(y - 1) * width..]
            .iter()
            .zip(below)
            .zip(&passing.down[y * width..])
        {
            blend(to, *from, *share);
        }
    }
    for y in (1..rows).rev() {
        let (above, below) = values.split_at_mut(y * width);
        for ((to, from), share) in above[(y - 1) * width..]
            .iter_mut()
            .zip(below)
            .zip(&passing.down[y * width..])
        {
            blend(to, *from, *share);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn even(width: usize, height: usize, share: f32) -> Passing {
        Passing {
            width,
            across: vec![share; width * height],
            down: vec![share; width * height],
        }
    }

    #[test]
    fn a_constant_stays_and_a_peak_spreads_to_all_sides() {
        let mut constant = vec![[2.0, -1.0]; 63];
        smooth(&mut constant, even(9, 7, 0.8));
        assert!(
            constant
                .iter()
                .all(|v| (v[0] - 2.0).abs() < 1e-5 && (v[1] + 1.0).abs() < 1e-5)
        );
        let mut peak = vec![[0.0, 0.0]; 81];
        peak[40] = [1.0, 0.0];
        smooth(&mut peak, even(9, 9, 0.5));
        assert!(peak[40][0] < 1.0 && peak.iter().all(|v| v[0] > 0.0));
        assert!((peak[39][0] / peak[41][0] - 1.0).abs() < 0.2);
    }

    #[test]
    fn nothing_passes_over_an_edge() {
        let mut values = vec![[0.0, 0.0]; 40];
        values[0] = [1.0, 1.0];
        let mut passing = even(10, 4, 0.9);
        passing
            .across
            .iter_mut()
            .skip(5)
            .step_by(10)
            .for_each(|share| *share = 0.0);
        smooth(&mut values, passing);
        assert!((0..40).all(|i| (values[i][0] > 0.0) == (i % 10 < 5)));
    }
}
