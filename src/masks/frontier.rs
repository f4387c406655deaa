use std::cmp::Ordering;

/// An entry of the frontier of a shortest-path search.
///
/// A heap returns the lowest cost first, and the lowest number among equal costs. Costs must not be
/// NaN.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reached {
    /// Cost that orders the entries.
    ///
    /// It is the cost of the path so far, optionally plus a lower bound of the rest.
    pub cost: f32,
    /// Index of the reached pixel or region.
    pub at: u32,
}

impl Ord for Reached {
    fn cmp(&self, other: &Self) -> Ordering {
        other
            .cost
            .total_cmp(&self.cost)
            .then(other.at.cmp(&self.at))
    }
}

impl PartialOrd for Reached {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Reached {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Reached {}
