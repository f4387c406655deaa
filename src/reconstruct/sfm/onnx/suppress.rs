use rayon::prelude::*;

/// Rounds in which values return that only a suppressed one had suppressed.
const ROUNDS: usize = 2;

/// Which values of a picture, row by row, are the largest within `radius` pixels, and of those that only such pixels exceed
/// that are themselves near a larger one, again the largest: an approximation of suppression in order of the values, as the
/// authors of SuperPoint use it. Equal neighbours both stay.
pub fn suppressed(values: &[f32], width: usize, radius: usize) -> Vec<bool> {
    let mut kept: Vec<bool> = is_largest(values, &largest_around(values, width, radius));
    for _ in 0..ROUNDS {
        let near: Vec<f32> = kept
            .par_iter()
            .map(|&kept| f32::from(u8::from(kept)))
            .collect();
        let near = largest_around(&near, width, radius);
        let left: Vec<f32> = values
            .par_iter()
            .zip(&near)
            .map(|(&value, &near)| if near > 0.0 { 0.0 } else { value })
            .collect();
        let again = is_largest(&left, &largest_around(&left, width, radius));
        kept.par_iter_mut()
            .zip(again)
            .zip(&near)
            .for_each(|((kept, again), &near)| *kept |= again && near == 0.0);
    }
    kept
}

fn is_largest(values: &[f32], largest: &[f32]) -> Vec<bool> {
    values
        .par_iter()
        .zip(largest)
        .map(|(value, largest)| value == largest)
        .collect()
}

/// The largest value within `radius` pixels along both axes.
fn largest_around(values: &[f32], width: usize, radius: usize) -> Vec<f32> {
    let height = values.len() / width;
    let mut along = vec![0.0; values.len()];
    along
        .par_chunks_exact_mut(width)
        .zip(values.par_chunks_exact(width))
        .for_each(|(into, row)| {
            for (x, into) in into.iter_mut().enumerate() {
                let near = &row[x.saturating_sub(radius)..(x + radius + 1).min(width)];
                *into = near.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            }
        });
    let mut around = vec![f32::NEG_INFINITY; values.len()];
    around
        .par_chunks_exact_mut(width)
        .enumerate()
        .for_each(|(y, into)| {
            for row in along[y.saturating_sub(radius) * width..(y + radius + 1).min(height) * width]
                .chunks_exact(width)
            {
                into.iter_mut()
                    .zip(row)
                    .for_each(|(into, &value)| *into = into.max(value));
            }
        });
    around
}
