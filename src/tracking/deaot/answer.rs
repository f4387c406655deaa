use rayon::prelude::*;

use super::network::OBJECTS;
use ostra_compute::nn::Tensor;

/// Bounds of probabilities where groups of objects are brought together.
const SURE: (f32, f32) = (1e-5, 1.0 - 1e-5);

/// Probabilities `[1 + objects][height][width]` of nothing and of every object at a picture's size of (columns, rows),
/// from the logits of every group of ten. Where there are several groups, nothing is where none sees an object, and
/// objects compete by their odds (soft aggregation).
pub(super) fn probabilities(groups: &[&Tensor], objects: usize, size: (usize, usize)) -> Vec<f32> {
    let (width, height) = size;
    let mut values = vec![0.0; (objects + 1) * width * height];
    let mut rows: Vec<Vec<&mut [f32]>> = (0..height)
        .map(|_| Vec::with_capacity(objects + 1))
        .collect();
    for plane in values.chunks_exact_mut(width * height) {
        rows.iter_mut()
            .zip(plane.chunks_exact_mut(width))
            .for_each(|(row, line)| row.push(line));
    }
    let enlarged: Vec<Enlarged<'_>> = groups
        .iter()
        .map(|logits| Enlarged::new(logits, size))
        .collect();
    rows.into_par_iter().enumerate().for_each(|(y, mut row)| {
        let (nothing, row) = row.split_at_mut(1);
        nothing[0].fill(1.0);
        for (group, lines) in enlarged.iter().zip(row.chunks_mut(OBJECTS)) {
            group.probabilities(y, nothing[0], lines);
        }
        if groups.len() > 1 {
            together(nothing[0], row);
        }
    });
    values
}

/// The logits of a group, read at the size of a picture, corners on corners.
struct Enlarged<'a> {
    logits: &'a [f32],
    from: (usize, usize),
    columns: Vec<(usize, f32)>,
    rows: Vec<(usize, f32)>,
}

impl<'a> Enlarged<'a> {
    fn new(logits: &'a Tensor, (width, height): (usize, usize)) -> Self {
        let from = (logits.shape()[3], logits.shape()[2]);
        Self {
            logits: logits.as_floats(),
            from,
            columns: places(from.0, width),
            rows: places(from.1, height),
        }
    }

    fn line(&self, channel: usize, y: usize, out: &mut [f32]) {
        let (columns, rows) = self.from;
        let (row, share) = self.rows[y];
        let plane = &self.logits[channel * columns * rows..][..columns * rows];
        let (above, below) = (
            &plane[row * columns..],
            &plane[(row + 1).min(rows - 1) * columns..],
        );
        for (out, &(at, aside)) in out.iter_mut().zip(&self.columns) {
            let next = (at + 1).min(columns - 1);
            let between = |line: &[f32]| (1.0 - aside) * line[at] + aside * line[next];
            *out = (1.0 - share) * between(above) + share * between(below);
        }
    }

    /// Of row `y`: multiplies the probability of nothing, writes those of the group's objects.
    fn probabilities(&self, y: usize, nothing: &mut [f32], objects: &mut [&mut [f32]]) {
        let mut own = vec![0.0; nothing.len()];
        self.line(0, y, &mut own);
        objects
            .iter_mut()
            .enumerate()
            .for_each(|(at, line)| self.line(at + 1, y, line));
        for (x, (nothing, own)) in nothing.iter_mut().zip(own).enumerate() {
            let most = objects.iter().map(|line| line[x]).fold(own, f32::max);
            let own = (own - most).exp();
            let mut sum = own;
            for line in objects.iter_mut() {
                line[x] = (line[x] - most).exp();
                sum += line[x];
            }
            *nothing *= own / sum;
            objects.iter_mut().for_each(|line| line[x] /= sum);
        }
    }
}

/// For each of `to` samples, the one of `from` before it and how far it lies beyond.
fn places(from: usize, to: usize) -> Vec<(usize, f32)> {
    let scale = if to > 1 {
        (from - 1) as f32 / (to - 1) as f32
    } else {
        0.0
    };
    let one = |at: usize| {
        let place = at as f32 * scale;
        let first = (place as usize).min(from - 1);
        (first, place - first as f32)
    };
    (0..to).map(one).collect()
}

/// Turns what the groups say of one row into odds, and these into probabilities.
fn together(nothing: &mut [f32], objects: &mut [&mut [f32]]) {
    let odds = |value: f32| {
        let sure = value.clamp(SURE.0, SURE.1);
        sure / (1.0 - sure)
    };
    for (x, nothing) in nothing.iter_mut().enumerate() {
        *nothing = odds(*nothing);
        let mut sum = *nothing;
        for line in objects.iter_mut() {
            line[x] = odds(line[x]);
            sum += line[x];
        }
        *nothing /= sum;
        objects.iter_mut().for_each(|line| line[x] /= sum);
    }
}

/// For every pixel the number of the most probable; the lower of equals.
pub(super) fn winners(probabilities: &[f32], pixels: usize) -> Vec<usize> {
    let of = |at: usize| {
        let values = probabilities[at..].iter().step_by(pixels);
        values
            .enumerate()
            .fold((0, f32::MIN), |best, (number, &value)| {
                if value > best.1 {
                    (number, value)
                } else {
                    best
                }
            })
            .0
    };
    (0..pixels).into_par_iter().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn logits(of: [[f32; 2]; 3]) -> Tensor {
        let mut values = vec![0.0; (OBJECTS + 1) * 2];
        values[..6].copy_from_slice(of.as_flattened());
        Tensor::floats(&[1, OBJECTS + 1, 1, 2], values).unwrap()
    }

    #[test]
    fn corners_lie_on_corners_and_unused_channels_do_not_count() {
        let found = probabilities(&[&logits([[0.0, 0.0], [2.0, 0.0], [9.0, 9.0]])], 1, (3, 1));
        let sigmoid = |value: f32| 1.0 / (1.0 + (-value).exp());
        let expected = [2.0, 1.0, 0.0].map(sigmoid);
        for (x, expected) in expected.into_iter().enumerate() {
            assert!(
                (found[3 + x] - expected).abs() < 1e-6
                    && (found[x] + found[3 + x] - 1.0).abs() < 1e-6
            );
        }
    }

    #[test]
    fn groups_compete_by_their_odds() {
        let first = logits([[0.0; 2], [1.0; 2], [0.0; 2]]);
        let second = logits([[0.0; 2], [2.0; 2], [0.0; 2]]);
        let found = probabilities(&[&first, &second], 11, (2, 1));
        let sum: f32 = found.iter().step_by(2).sum();
        assert!((sum - 1.0).abs() < 1e-5);
        // Ten objects with logits 1, 0 … 0 beside nothing, one with 2 beside nothing.
        let (of_first, of_second) = (
            1f64.exp() / (10.0 + 1f64.exp()),
            2f64.exp() / (1.0 + 2f64.exp()),
        );
        let odds = |value: f64| value / (1.0 - value);
        let expected = odds(of_second) / odds(of_first);
        assert!((f64::from(found[22] / found[2]) / expected - 1.0).abs() < 1e-4);
        assert_eq!(winners(&found, 2), [11, 11]);
    }
}
