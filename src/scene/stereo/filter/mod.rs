//! Which depths are kept: those that other views agree with, on surfaces of some size.

mod consistency;
mod gaps;
mod options;
mod run;
mod speckles;

pub use consistency::{Agreement, Match, Neighbour};
pub use options::FilterOptions;
pub use run::filter;
