//! Two clouds of the same place, seen apart → the pose between them, without a guess: descriptors, their matches, the
//! pose that most matches agree on, and its refinement on the surfaces themselves.

mod align;
mod brightness;
mod described;
mod evidence;
mod fast;
mod fpfh;
mod global;
mod icp;
mod levels;
mod matching;
mod options;
mod oriented;
mod pairs;
mod refine;
mod sampled;
#[cfg(test)]
mod tests;

pub use described::DescribedCloud;
pub use global::{GlobalAlignment, register_globally};
pub use options::{GlobalOptions, GlobalRegistration, RefineOptions};
pub use oriented::OrientedCloud;
pub use refine::{Refined, refine_registration};
