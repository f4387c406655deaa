use rayon::prelude::*;

use super::dice::Dice;
use super::options::SensorNoise;
use super::view::RenderedView;
use ostra_frames::DepthMap;

/// Spoils exact colour and depth as a sensor would; the mask stays exact.
pub(super) fn spoil(view: &mut RenderedView, noise: &SensorNoise, seed: u64) {
    let width = view.image.width as usize;
    let exact = view.depth.clone();
    view.depth
        .depths
        .par_chunks_mut(width)
        .enumerate()
        .for_each(|(row, depths)| {
            let mut dice = Dice::new(seed, 1000 + 2 * row as u64);
            for (column, depth) in depths.iter_mut().enumerate() {
                *depth = measured_depth(&exact, (column, row), noise, &mut dice);
            }
        });
    view.image
        .pixels
        .par_chunks_mut(width)
        .enumerate()
        .for_each(|(row, pixels)| {
            let mut dice = Dice::new(seed, 1001 + 2 * row as u64);
            for pixel in pixels {
                *pixel =
                    pixel.map(|v| (f64::from(v) + noise.color_sigma * dice.normal()).round() as u8);
            }
        });
}

fn measured_depth(
    exact: &DepthMap,
    (column, row): (usize, usize),
    noise: &SensorNoise,
    dice: &mut Dice,
) -> f32 {
    let at = |x: usize, y: usize| f64::from(exact.depths[y * exact.width as usize + x]);
    let depth = at(column, row);
    if depth <= 0.0 {
        return 0.0;
    }
    let (right, below) = (
        (column + 1).min(exact.width as usize - 1),
        (row + 1).min(exact.height as usize - 1),
    );
    let around = [
        (column.saturating_sub(1), row),
        (right, row),
        (column, row.saturating_sub(1)),
        (column, below),
    ];
    let (low, high) = around
        .iter()
        .map(|&(x, y)| at(x, y))
        .fold((depth, depth), |(l, h), z| (l.min(z), h.max(z)));
    let draw = dice.range(0.0, 1.0);
    let mixed = match high - low > noise.edge_m {
        true if draw < noise.missing => return 0.0,
        true if draw < noise.missing + noise.flying => dice.range(low, high),
        _ => depth,
    };
    let deviation = noise.depth_base_m + noise.depth_growth * (mixed - 0.4).powi(2);
    let noisy = mixed + deviation * dice.normal();
    ((noisy / noise.step_m).round() * noise.step_m).max(0.0) as f32
}
