use std::cmp::Ordering;

/// An element of memory and how much a query takes of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Match {
    pub element: usize,
    pub share: f32,
}

/// The `count` elements that are most alike, with shares that sum to 1 (softmax over them); of equals the first.
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

/// Leaves the most alike; gives the least of what is left.
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
    fn most_alike_are_found_among_many() {
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
    fn few_equals_and_remote_elements_are_no_trouble() {
        assert_eq!(
            best(&[-1.0], 30),
            [Match {
                element: 0,
                share: 1.0
            }]
        );
        let equal: Vec<usize> = best(&[0.5; 50], 3).iter().map(|one| one.element).collect();
        assert_eq!(equal, [0, 1, 2]);
        // exp(−500) is 0: without taking away the greatest, shares would be 0 / 0.
        assert_eq!(
            best(&[-500.0, -500.0], 2)
                .iter()
                .map(|one| one.share)
                .collect::<Vec<_>>(),
            [0.5, 0.5]
        );
    }
}
