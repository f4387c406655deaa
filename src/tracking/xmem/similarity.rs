use std::cmp::Ordering;

use nalgebra::{DMatrix, DMatrixView};

/// Memory keys, prepared for comparison with those of images.
pub(super) struct Lookup {
    /// Length of a key.
    width: usize,
    /// Components of all keys, squared and plain: `[2 · width][elements]`.
    parts: Vec<f32>,
    /// Shrinkage of each element divided by √width.
    scales: Vec<f32>,
}

impl Lookup {
    /// Prepares keys `[elements][width]` and shrinkages `[elements]` of consecutive stores.
    pub fn new(width: usize, stores: &[(&[f32], &[f32])]) -> Self {
        let count = stores
            .iter()
            .map(|(_, shrinkages)| shrinkages.len())
            .sum::<usize>();
        let (mut parts, mut scales) = (vec![0.0; 2 * width * count], Vec::with_capacity(count));
        for (keys, shrinkages) in stores {
            for (at, key) in keys.chunks_exact(width).enumerate() {
                for (part, &value) in key.iter().enumerate() {
                    parts[part * count + scales.len() + at] = value * value;
                    parts[(width + part) * count + scales.len() + at] = value;
                }
            }
            scales.extend(
                shrinkages
                    .iter()
                    .map(|shrinkage| shrinkage / (width as f32).sqrt()),
            );
        }
        Self {
            width,
            parts,
            scales,
        }
    }

    /// Returns the number of memory elements.
    pub fn len(&self) -> usize {
        self.scales.len()
    }

    /// Returns the similarity of every element (row) to every query (column).
    ///
    /// It is −s · Σ e · (k − q)² / √width. `keys` q and `selections` e are `[queries][width]`.
    pub fn similarities(&self, keys: &[f32], selections: &[f32]) -> DMatrix<f32> {
        let (width, count) = (self.width, keys.len() / self.width);
        // −s (Σ e k² − 2 Σ e k q + Σ e q²): one matrix product computes the first two sums of all
        // pairs.
        let mut requested = Vec::with_capacity(2 * width * count);
        let mut own = Vec::with_capacity(count);
        for (key, selection) in keys.chunks_exact(width).zip(selections.chunks_exact(width)) {
            requested.extend(selection.iter().map(|e| -e));
            requested.extend(key.iter().zip(selection).map(|(q, e)| 2.0 * q * e));
            own.push(
                key.iter()
                    .zip(selection)
                    .map(|(q, e)| e * q * q)
                    .sum::<f32>(),
            );
        }
        let parts = DMatrixView::from_slice(&self.parts, self.len(), 2 * width);
        let mut similar = DMatrix::zeros(self.len(), count);
        similar.gemm(
            1.0,
            &parts,
            &DMatrixView::from_slice(&requested, 2 * width, count),
            0.0,
        );
        for (mut column, own) in similar.column_iter_mut().zip(own) {
            column
                .iter_mut()
                .zip(&self.scales)
                .for_each(|(value, scale)| *value = (*value - own) * scale);
        }
        similar
    }
}

/// A memory element and its share in a query's result.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Match {
    pub element: usize,
    pub share: f32,
}

/// Returns the `count` most similar elements with shares that sum to 1 (softmax).
///
/// Of equal elements, the first ones are chosen.
pub(super) fn best(similar: &[f32], count: usize) -> Vec<Match> {
    let mut kept: Vec<Match> = Vec::with_capacity(2 * count);
    let mut least = f32::NEG_INFINITY;
    for (element, &share) in similar.iter().enumerate() {
        if kept.len() < count || share > least {
            kept.push(Match { element, share });
            if kept.len() == 2 * count {
                least = cut(&mut kept, count);
            }
        }
    }
    if kept.len() > count {
        cut(&mut kept, count);
    }
    kept.sort_unstable_by_key(|one| one.element);
    let most = kept
        .iter()
        .map(|one| one.share)
        .fold(f32::NEG_INFINITY, f32::max);
    kept.iter_mut()
        .for_each(|one| one.share = (one.share - most).exp());
    let sum: f32 = kept.iter().map(|one| one.share).sum();
    kept.iter_mut().for_each(|one| one.share /= sum);
    kept
}

/// Keeps the `count` most similar matches and returns the least similarity among them.
fn cut(kept: &mut Vec<Match>, count: usize) -> f32 {
    kept.select_nth_unstable_by(count - 1, more_alike);
    kept.truncate(count);
    kept[count - 1].share
}

fn more_alike(a: &Match, b: &Match) -> Ordering {
    b.share.total_cmp(&a.share).then(a.element.cmp(&b.element))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matrix_product_equals_the_weighted_distance() {
        let width = 8;
        let made = |seed: usize, count: usize| -> Vec<f32> {
            (0..count)
                .map(|at| ((at * 37 + seed * 101) % 97) as f32 / 50.0 - 1.0)
                .collect()
        };
        let (first, second, queries) = (made(1, 5 * width), made(2, 7 * width), made(3, 4 * width));
        let selections: Vec<f32> = made(4, 4 * width).iter().map(|value| value.abs()).collect();
        let shrinkages: Vec<f32> = made(5, 12)
            .iter()
            .map(|value| 1.0 + value * value)
            .collect();
        let lookup = Lookup::new(
            width,
            &[(&first, &shrinkages[..5]), (&second, &shrinkages[5..])],
        );
        let found = lookup.similarities(&queries, &selections);
        assert_eq!(found.shape(), (12, 4));
        let keys: Vec<&[f32]> = first.chunks(width).chain(second.chunks(width)).collect();
        for (element, key) in keys.iter().enumerate() {
            for query in 0..4 {
                let part = |at: usize| {
                    selections[query * width + at] * (key[at] - queries[query * width + at]).powi(2)
                };
                let distance: f32 = (0..width).map(part).sum();
                let expected = -shrinkages[element] * distance / 8.0f32.sqrt();
                assert!(
                    (found[(element, query)] - expected).abs() < 1e-5,
                    "{element} {query}"
                );
            }
        }
    }

    #[test]
    fn most_similar_elements_are_found_among_many() {
        let similar: Vec<f32> = (0..1000)
            .map(|at| -(((at * 389) % 1000) as f32) / 100.0)
            .collect();
        let found = best(&similar, 7);
        let mut order: Vec<usize> = (0..1000).collect();
        order.sort_by(|&a, &b| similar[b].total_cmp(&similar[a]));
        let mut expected = order[..7].to_vec();
        expected.sort_unstable();
        assert_eq!(
            found.iter().map(|one| one.element).collect::<Vec<_>>(),
            expected
        );
        assert!((found.iter().map(|one| one.share).sum::<f32>() - 1.0).abs() < 1e-6);
        let sum: f32 = order[..7].iter().map(|&at| similar[at].exp()).sum();
        for one in found {
            assert!((one.share - similar[one.element].exp() / sum).abs() < 1e-6);
        }
    }

    #[test]
    fn few_equal_and_distant_elements_are_handled() {
        assert_eq!(
            best(&[-1.0], 30),
            [Match {
                element: 0,
                share: 1.0
            }]
        );
        let equal: Vec<usize> = best(&[0.5; 50], 3).iter().map(|one| one.element).collect();
        assert_eq!(equal, [0, 1, 2]);
        // exp(−500) is 0: without subtracting the maximum, shares would be 0 / 0.
        assert_eq!(
            best(&[-500.0, -500.0], 2)
                .iter()
                .map(|one| one.share)
                .collect::<Vec<_>>(),
            [0.5, 0.5]
        );
    }
}
