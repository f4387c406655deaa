/// A piece with fewer points than this share of the largest piece's is a speck.
const SPECK: f64 = 0.01;
/// Where specks hold more of the points than this share, they are no strays: the thing is made of small pieces.
const MOST_STRAY: f64 = 0.05;

/// Of pieces that hang together, the largest first: the points of all but stray specks, by rising index. `points`: in all.
pub(super) fn bulk(pieces: &[Vec<usize>], points: usize) -> Vec<usize> {
    let largest = pieces.first().map_or(0, Vec::len);
    let is_speck = |piece: &&Vec<usize>| (piece.len() as f64) < SPECK * largest as f64;
    let stray: usize = pieces.iter().filter(is_speck).map(Vec::len).sum();
    if stray == 0 || stray as f64 > MOST_STRAY * points as f64 {
        return (0..points).collect();
    }
    let mut kept: Vec<usize> = pieces
        .iter()
        .filter(|piece| !is_speck(piece))
        .flatten()
        .copied()
        .collect();
    kept.sort_unstable();
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How many points are kept of pieces with so many.
    fn kept(sizes: &[usize]) -> usize {
        let mut next = 0..;
        let pieces: Vec<Vec<usize>> = sizes
            .iter()
            .map(|&size| next.by_ref().take(size).collect())
            .collect();
        bulk(&pieces, sizes.iter().sum()).len()
    }

    #[test]
    fn specks_are_left_out_and_small_pieces_that_are_the_thing_are_not() {
        assert_eq!(kept(&[1000, 500, 9, 1]), 1500);
        assert_eq!(kept(&[1000, 10]), 1010, "1 % is no speck");
        assert_eq!(kept(&[3; 300]), 900, "grains");
        assert_eq!(
            kept(&[vec![1000], vec![9; 50]].concat()),
            1450,
            "a third of the thing"
        );
        assert_eq!(kept(&[]), 0);
    }
}
