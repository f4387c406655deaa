//! The segmenter that needs no weights: a graph cut over small regions, seeded by clicks and boxes.

mod alike;
mod apart;
mod appearance;
mod boxes;
mod bridges;
mod candidates;
mod choice;
mod complete;
mod depth_edges;
mod edges;
mod energy;
mod filter;
#[cfg(test)]
mod fitting;
mod geodesic;
mod graph;
mod mend;
mod prepared;
mod query;
mod raster;
mod regions;
mod segmenter;
mod situation;
mod surface;
#[cfg(test)]
mod tests;
mod traits;

pub use apart::standing_apart;
pub use complete::settled;
pub use segmenter::BuiltinSegmenter;
