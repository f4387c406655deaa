//! Two views of a synthetic room, and of two rooms that have nothing in common.

mod descriptors;
mod recovery;
mod refinement;
mod room;
mod thinning;
