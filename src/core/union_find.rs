//! Disjoint sets (union–find).

/// Disjoint sets of the numbers from 0 on, with path halving.
///
/// R. Tarjan, J. van Leeuwen, *Worst-case analysis of set union algorithms*, Journal of the ACM
/// 1984.
///
/// The smallest member of a set is its root, whatever the order in which sets are united. Results
/// that follow the order of roots therefore need no sorting.
#[derive(Debug, Clone)]
pub struct DisjointSets {
    parents: Vec<u32>,
}

impl DisjointSets {
    /// Creates `count` sets of one member each.
    #[must_use]
    pub fn new(count: usize) -> Self {
        Self {
            parents: (0..count as u32).collect(),
        }
    }

    /// Returns the number of members of all sets.
    #[must_use]
    pub fn len(&self) -> usize {
        self.parents.len()
    }

    /// Returns whether there are no members.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.parents.is_empty()
    }

    /// Returns the smallest member of the set that `member` belongs to.
    #[inline]
    pub fn root(&mut self, mut member: u32) -> u32 {
        while self.parents[member as usize] != member {
            let above = self.parents[self.parents[member as usize] as usize];
            self.parents[member as usize] = above;
            member = above;
        }
        member
    }

    /// Unites the sets of two members.
    #[inline]
    pub fn unite(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.parents[a.max(b) as usize] = a.min(b);
    }

    /// Returns the root of each number.
    #[must_use]
    pub fn into_roots(mut self) -> Vec<u32> {
        (0..self.parents.len() as u32)
            .map(|member| self.root(member))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smallest_member_is_the_root_in_any_order() {
        let pairs = [(7, 3), (5, 6), (3, 5), (1, 2)];
        for rotated in 0..pairs.len() {
            let mut sets = DisjointSets::new(8);
            for at in 0..pairs.len() {
                let (a, b) = pairs[(at + rotated) % pairs.len()];
                sets.unite(b, a);
            }
            assert_eq!(sets.into_roots(), [0, 1, 1, 3, 4, 3, 3, 3]);
        }
    }

    #[test]
    fn long_chain_is_one_set() {
        let mut sets = DisjointSets::new(1000);
        for member in (1..1000).rev() {
            sets.unite(member, member - 1);
        }
        assert!((0..1000).all(|member| sets.root(member) == 0));
        assert!(sets.len() == 1000 && DisjointSets::new(0).is_empty());
    }
}
