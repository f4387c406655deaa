use std::cmp::Ordering;

/// An entry of the frontier of a search for cheapest ways. Out of a heap comes the least cost first, of equal ones the
/// lowest number. Costs are numbers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reached {
    /// What orders the entries: the way so far, or with what is left of it at least.
    pub cost: f32,
    /// Number of the pixel or region reached.
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
