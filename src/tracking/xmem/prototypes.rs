use nalgebra::{DMatrix, DMatrixView};

use super::elements::Elements;
use super::similarity::Lookup;

/// The most used of candidates for long-term memory, each with the value and shrinkage that all candidates which look
/// like it have on average.
pub(super) fn prototypes(candidates: &Elements, count: usize) -> Elements {
    let chosen = most_used(&candidates.usages(), count);
    let widths = candidates.widths;
    let of = |part: fn(&Elements, usize) -> &[f32]| -> Vec<f32> {
        chosen
            .iter()
            .flat_map(|&element| part(candidates, element))
            .copied()
            .collect()
    };
    let (keys, selections) = (of(Elements::key), of(Elements::selection));
    let lookup = Lookup::new(widths.key, &[(&candidates.keys, &candidates.shrinkages)]);
    let mut shares = lookup.similarities(&keys, &selections);
    for mut column in shares.column_iter_mut() {
        let most = column.max();
        column.apply(|value| *value = (*value - most).exp());
        column /= column.sum();
    }
    let mut made = Elements::new(widths, candidates.values.len());
    made.keys = keys;
    made.shrinkages = mean(&candidates.shrinkages, 1, &shares);
    made.values = candidates
        .values
        .iter()
        .map(|values| mean(values, widths.value, &shares))
        .collect();
    made
}

/// By column of `shares` the mean of rows `[elements][width]`.
fn mean(rows: &[f32], width: usize, shares: &DMatrix<f32>) -> Vec<f32> {
    let mut out = DMatrix::zeros(width, shares.ncols());
    out.gemm(
        1.0,
        &DMatrixView::from_slice(rows, width, shares.nrows()),
        shares,
        0.0,
    );
    out.data.into()
}

/// The `count` most used, the most used first; of equals the first.
fn most_used(usages: &[f32], count: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..usages.len()).collect();
    order.sort_by(|&a, &b| usages[b].total_cmp(&usages[a]));
    order.truncate(count);
    order
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::xmem::elements::Widths;

    #[test]
    fn prototype_has_the_mean_of_what_looks_like_it() {
        // Two that look alike, and one far from them.
        let mut candidates = Elements::new(Widths { key: 1, value: 2 }, 1);
        let mut all = candidates.clone();
        (all.keys, all.shrinkages, all.selections) =
            (vec![0.0, 0.0, 9.0], vec![1.0, 3.0, 2.0], vec![1.0; 3]);
        all.values = vec![vec![1.0, 0.0, 3.0, 4.0, 50.0, 60.0]];
        candidates.add(&all);
        candidates.live();
        candidates.use_of(1, 0.6);
        candidates.use_of(2, 0.5);
        let made = prototypes(&candidates, 2);
        assert_eq!(made.keys, [0.0, 9.0], "the most used first");
        let expected = [2.0, 2.0, 50.0, 60.0];
        assert!(
            made.values[0]
                .iter()
                .zip(expected)
                .all(|(value, expected)| (value - expected).abs() < 1e-4)
        );
        assert!((made.shrinkages[0] - 2.0).abs() < 1e-4 && made.selections.is_empty());
        assert_eq!(prototypes(&candidates, 9).len(), 3);
    }
}
