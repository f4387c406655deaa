//! Registration of two clouds of the same place without an initial guess.
//!
//! The steps are descriptors, their matches, the pose that most matches agree on, and its
//! refinement on the surfaces themselves.

mod fpfh;
mod global;
mod icp;
mod levels;
mod matching;
mod oriented;
mod pairs;
mod refine;
#[cfg(test)]
mod tests;

pub use fpfh::DescribedCloud;
pub use global::{GlobalAlignment, GlobalOptions, GlobalRegistration, register_globally};
pub use oriented::OrientedCloud;
pub use refine::{RefineOptions, Refined, refine_registration};
