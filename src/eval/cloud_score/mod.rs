//! Scores of a labelled cloud against the ground truth: labels, surface, and a text table.

mod cloud;
mod in_depth;
mod labels;
mod table;
#[cfg(test)]
mod tests;

pub use cloud::{CloudScore, CloudScoreOptions, SurfaceScore, inside_frusta, score_cloud};
pub use in_depth::FeatureViews;
pub use labels::{CloudLabelScore, Confusion, LabelIou, pair_labels};
pub use table::{TextTable, cloud_table};
