use super::rows::Rows;

/// A picture whose longer side is at most `longest` pixels, and how many of the original's pixels one of its pixels
/// spans in x and y.
pub(super) fn shrunk(
    grey: &[f32],
    width: usize,
    height: usize,
    longest: usize,
) -> (Rows, [f32; 2]) {
    let side = width.max(height);
    if side <= longest {
        return (Rows::from_grey(grey, width, height), [1.0; 2]);
    }
    let scaled = |size: usize| ((size * longest + side / 2) / side).max(1);
    let (narrow, low) = (scaled(width), scaled(height));
    let across = weights(width, narrow);
    let rows: Vec<f32> = grey
        .chunks_exact(width)
        .flat_map(|row| across.iter().map(|w| w.of(row, 1)))
        .collect();
    let down = weights(height, low);
    let pixels = down
        .iter()
        .flat_map(|w| (0..narrow).map(|x| w.of(&rows[x..], narrow)));
    let small: Vec<f32> = pixels.collect();
    (
        Rows::from_grey(&small, narrow, low),
        [width as f32 / narrow as f32, height as f32 / low as f32],
    )
}

/// Weights of the samples from `first` on that make one sample of a smaller row.
struct Weights {
    first: usize,
    values: Vec<f32>,
}

impl Weights {
    fn of(&self, samples: &[f32], step: usize) -> f32 {
        let from = samples[self.first * step..].iter().step_by(step);
        from.zip(&self.values)
            .map(|(sample, weight)| sample * weight)
            .sum()
    }
}

/// Tent filters as wide as two of the smaller row's samples, so that nothing finer is left to alias.
fn weights(from: usize, to: usize) -> Vec<Weights> {
    let ratio = from as f32 / to as f32;
    let one = |k: usize| {
        let centre = (k as f32 + 0.5) * ratio - 0.5;
        let first = (centre - ratio).ceil().max(0.0) as usize;
        let last = ((centre + ratio).floor() as usize).min(from - 1);
        let tent = |at: usize| (1.0 - (at as f32 - centre).abs() / ratio).max(0.0);
        let sum: f32 = (first..=last).map(tent).sum();
        Weights {
            first,
            values: (first..=last).map(|at| tent(at) / sum).collect(),
        }
    };
    (0..to).map(one).collect()
}
