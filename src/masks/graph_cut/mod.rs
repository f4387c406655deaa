//! Segmenter without network weights: a graph cut over small regions, seeded by clicks and boxes.

mod appearance;
mod box_filter;
mod box_prompt;
mod bridges;
mod candidate_features;
mod candidates;
mod click_context;
mod depth_completion;
pub(crate) mod depth_surfaces;
mod edge_map;
mod graph;
mod local_correction;
mod over_segmentation;
mod prepared;
pub mod ranked_click;
pub mod ranking;
mod raster;
mod region_stats;
mod segmenter;
#[cfg(test)]
mod tests;

pub use depth_completion::settled;
pub use segmenter::BuiltinSegmenter;
