//! Any tracker's masks held against the keyframes' masks carried through geometry: what contradicts is mended, and an
//! object that strayed is given to the tracker anew.

mod check_mask;
mod checked_pass;
mod tracker;

pub use check_mask::ConsistencyOptions;
pub use tracker::ConsistencyTracker;
