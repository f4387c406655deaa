//! A permutation with evenly spread prefixes.

/// A permutation of `0..count` in which every prefix is spread evenly over the whole range.
///
/// It consists of multiples of the golden section. It needs no stored shuffle, and any number of
/// points of a block can be drawn.
#[derive(Debug, Clone, Copy)]
pub(super) struct SpreadOrder {
    count: u64,
    stride: u64,
}

impl SpreadOrder {
    pub(super) fn new(count: usize) -> Self {
        let count = count as u64;
        let mut stride = ((count as f64 * 0.618_033_988_75) as u64).max(1);
        while gcd(stride, count) > 1 {
            stride += 1;
        }
        Self { count, stride }
    }

    /// Returns the element at `place`.
    pub(super) fn at(&self, place: usize) -> usize {
        (place as u64 * self.stride % self.count.max(1)) as usize
    }
}

fn gcd(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { gcd(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spread_order_visits_every_point_once() {
        for count in [1, 2, 7, 100, 4096, 99_991] {
            let order = SpreadOrder::new(count);
            let mut seen = vec![false; count];
            for place in 0..count {
                assert!(
                    !std::mem::replace(&mut seen[order.at(place)], true),
                    "{count}"
                );
            }
        }
    }
}
