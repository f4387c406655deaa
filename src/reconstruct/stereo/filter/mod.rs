//! Borders of surfaces are put where colours change, the depths kept that other views agree with, on surfaces of some
//! size, and what several other views see before them, or where nothing is known, taken over.

mod complete;
mod consistency;
mod depth_filter;
mod snap;

pub use complete::{CompleteOptions, FilterOptions, completed};
pub use consistency::{Agreement, Match, Neighbour, Surface, UNSEEN};
pub use depth_filter::filter;
pub use snap::{SnapOptions, snapped};
