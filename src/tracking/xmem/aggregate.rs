use rayon::prelude::*;

/// Pixels that a thread takes at once.
const BLOCK: usize = 4096;

/// Soft aggregation (Oh et al.: "Video Object Segmentation using Space-Time Memory Networks", ICCV 2019): from the
/// probability of each object alone, `[objects][area]`, to that of nothing and of each among all, `[1 + objects][area]`,
/// which sum to 1.
pub(super) fn aggregated(alone: &[f32], area: usize) -> Vec<f32> {
    let maps = 1 + alone.len() / area;
    let firsts = (0..area).into_par_iter().step_by(BLOCK);
    let blocks: Vec<Vec<f32>> = firsts
        .map(|first| shares(alone, area, first, BLOCK.min(area - first)))
        .collect();
    let mut out = vec![0.0; maps * area];
    for (place, block) in blocks.iter().enumerate() {
        let count = block.len() / maps;
        for (map, shares) in block.chunks_exact(count).enumerate() {
            out[map * area + place * BLOCK..][..count].copy_from_slice(shares);
        }
    }
    out
}

/// Of `count` pixels `[1 + objects][count]`: odds of nothing and of each object, over their sum.
fn shares(alone: &[f32], area: usize, first: usize, count: usize) -> Vec<f32> {
    let maps = 1 + alone.len() / area;
    let odds = |p: f32| {
        let p = p.clamp(1e-7, 1.0 - 1e-7);
        p / (1.0 - p)
    };
    let mut out = vec![1.0; maps * count];
    for at in 0..count {
        let mut sum = 0.0;
        for map in 1..maps {
            let p = alone[(map - 1) * area + first + at];
            out[at] *= 1.0 - p;
            out[map * count + at] = odds(p);
            sum += out[map * count + at];
        }
        out[at] = odds(out[at]);
        sum += out[at];
        (0..maps).for_each(|map| out[map * count + at] /= sum);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn odds_are_shared() {
        // Odds: nothing 0.4 · 0.7 = 0.28 → 0.3889; 0.6 → 1.5; 0.3 → 0.4286. Then one that is sure.
        let found = aggregated(&[0.6, 1.0, 0.3, 0.0], 2);
        let sum = 0.388_888_9 + 1.5 + 0.428_571_4;
        let expected = [
            0.388_888_9 / sum,
            0.0,
            1.5 / sum,
            1.0,
            0.428_571_4 / sum,
            0.0,
        ];
        assert!(
            found
                .iter()
                .zip(expected)
                .all(|(found, expected)| (found - expected).abs() < 1e-6),
            "{found:?}"
        );
    }
}
