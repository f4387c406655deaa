//! Any tracker's masks checked against the keyframes' masks carried through geometry: what contradicts is corrected, and an
//! object that drifted away is given to the tracker again.

mod check_mask;
mod checked_pass;
mod tracker;

pub use check_mask::ConsistencyOptions;
pub use tracker::ConsistencyTracker;
