/// Divides `budget` in proportion to weights (above 0) among takers, none of whom takes more than `most`; what some
/// cannot take goes to the others. Everyone gets 1 at least.
pub(super) fn shares(takers: &[(usize, f32)], budget: usize) -> Vec<usize> {
    let mut by_need: Vec<usize> = (0..takers.len()).collect();
    let need = |&taker: &usize| takers[taker].0 as f32 / takers[taker].1;
    by_need.sort_by(|a, b| need(a).total_cmp(&need(b)));
    let mut shares = vec![0; takers.len()];
    let (mut left, mut weights) = (
        budget as f64,
        takers.iter().map(|taker| f64::from(taker.1)).sum::<f64>(),
    );
    for taker in by_need {
        let (most, weight) = (takers[taker].0, f64::from(takers[taker].1));
        let fair = left * weight / weights.max(weight);
        shares[taker] = most.min((fair as usize).max(1));
        left = (left - shares[taker] as f64).max(0.0);
        weights -= weight;
    }
    shares
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_some_cannot_take_goes_to_the_others_by_weight() {
        assert_eq!(
            shares(&[(100, 1.0), (10, 5.0), (100, 2.0)], 100),
            [30, 10, 60]
        );
        assert_eq!(
            shares(&[(100, 1.0), (10, 5.0)], 1000),
            [100, 10],
            "no more than there is"
        );
        assert_eq!(
            shares(&[(100, 1e-9), (100, 1.0)], 50),
            [1, 49],
            "no one is left out"
        );
        assert!(shares(&[], 50).is_empty());
    }
}
