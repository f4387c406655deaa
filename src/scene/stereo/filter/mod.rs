//! Borders of surfaces are put where colours change, and the depths kept that other views agree with, on surfaces of some
//! size.

mod consistency;
mod gaps;
mod options;
mod run;
mod snap;
mod speckles;

pub use consistency::{Match, Neighbour};
pub use options::{Agreement, FilterOptions, SnapOptions};
pub use run::filter;
pub use snap::snapped;
