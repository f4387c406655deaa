//! Borders of surfaces are put where colours change, the depths kept that other views agree with, on surfaces of some
//! size, and what several other views see before them, or where nothing is known, taken over.

mod complete;
mod consistency;
mod gaps;
mod options;
mod run;
mod snap;
mod speckles;

pub use complete::completed;
pub use consistency::{Match, Neighbour, Surface, UNSEEN};
pub use options::{Agreement, CompleteOptions, FilterOptions, SnapOptions};
pub use run::filter;
pub use snap::snapped;
