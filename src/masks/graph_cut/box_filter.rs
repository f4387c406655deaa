//! Box filters over Lab planes, with rows in parallel.

use rayon::prelude::*;

/// Returns the mean over a `(2 · radius + 1)²` window, clipped at the image border.
///
/// Two passes with running sums compute it.
pub(super) fn box_mean<const N: usize>(
    values: &[[f32; N]],
    width: usize,
    height: usize,
    radius: usize,
) -> Vec<[f32; N]> {
    let mut rows = vec![[0.0; N]; values.len()];
    rows.par_chunks_exact_mut(width)
        .zip(values.par_chunks_exact(width))
        .for_each(|(out, row)| {
            running_mean(row, out, radius);
        });
    column_mean(&rows, width, height, radius)
}

fn running_mean<const N: usize>(row: &[[f32; N]], out: &mut [[f32; N]], radius: usize) {
    let mut sum = [0.0; N];
    let mut count = 0.0;
    for value in &row[..radius.min(row.len())] {
        add(&mut sum, value, 1.0);
        count += 1.0;
    }
    for at in 0..row.len() {
        if let Some(value) = row.get(at + radius) {
            add(&mut sum, value, 1.0);
            count += 1.0;
        }
        if at > radius {
            add(&mut sum, &row[at - radius - 1], -1.0);
            count -= 1.0;
        }
        out[at] = sum.map(|channel| channel / count);
    }
}

fn add<const N: usize>(sum: &mut [f32; N], value: &[f32; N], sign: f32) {
    for (sum, value) in sum.iter_mut().zip(value) {
        *sum += sign * value;
    }
}

/// Averages along columns in bands of rows, each with its own running sum.
fn column_mean<const N: usize>(
    rows: &[[f32; N]],
    width: usize,
    height: usize,
    radius: usize,
) -> Vec<[f32; N]> {
    const BAND: usize = 32;
    let mut out = vec![[0.0; N]; rows.len()];
    out.par_chunks_mut(width * BAND)
        .enumerate()
        .for_each(|(band, out)| {
            let top = band * BAND;
            let mut sums = vec![[0.0; N]; width];
            let add_row = |sums: &mut [[f32; N]], y: usize, sign: f32| {
                for (sum, value) in sums.iter_mut().zip(&rows[y * width..(y + 1) * width]) {
                    add(sum, value, sign);
                }
            };
            for y in top.saturating_sub(radius)..(top + radius).min(height) {
                add_row(&mut sums, y, 1.0);
            }
            for (step, out) in out.chunks_exact_mut(width).enumerate() {
                let y = top + step;
                if y + radius < height {
                    add_row(&mut sums, y + radius, 1.0);
                }
                if step > 0 && y > radius {
                    add_row(&mut sums, y - radius - 1, -1.0);
                }
                let count = ((y + radius).min(height - 1) - y.saturating_sub(radius) + 1) as f32;
                for (out, sum) in out.iter_mut().zip(&sums) {
                    *out = sum.map(|channel| channel / count);
                }
            }
        });
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn box_mean_matches_a_direct_sum() {
        let (width, height) = (37usize, 71usize);
        let values: Vec<[f32; 1]> = (0..width * height)
            .map(|at| [(at * 31 % 97) as f32])
            .collect();
        for radius in [1, 3, 40] {
            let fast = box_mean(&values, width, height, radius);
            for (at, found) in fast.iter().enumerate() {
                let (x, y) = (at % width, at / width);
                let columns = x.saturating_sub(radius)..(x + radius + 1).min(width);
                let rows = y.saturating_sub(radius)..(y + radius + 1).min(height);
                let count = (columns.len() * rows.len()) as f32;
                let sum: f32 = rows
                    .flat_map(|y| columns.clone().map(move |x| (x, y)))
                    .map(|(x, y)| values[y * width + x][0])
                    .sum();
                assert!(
                    (found[0] - sum / count).abs() < 1e-2,
                    "radius {radius}, pixel {at}"
                );
            }
        }
    }
}
