//! How good a labelled cloud is against a true one: labels, surface, and a table to read.

mod cloud;
mod frusta;
mod in_depth;
mod labels;
mod pairing;
mod picture;
mod sightings;
mod surface;
mod table;
#[cfg(test)]
mod tests;

pub use cloud::{CloudScore, CloudScoreOptions, score_cloud};
pub use frusta::inside_frusta;
pub use labels::{Confusion, LabelIou, LabelScore};
pub use pairing::pair_labels;
pub use sightings::FeatureViews;
pub use surface::SurfaceScore;
pub use table::{Table, cloud_table};
