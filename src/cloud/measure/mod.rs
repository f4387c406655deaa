//! Traits of a labelled cloud as a table.
//!
//! The traits are lengths, diameters, areas, volumes, angles and heights, per label and instance.

mod angle;
#[cfg(test)]
mod angle_tests;
mod axis;
mod body;
mod enclosed_volume;
mod extent;
mod ground;
mod hull;
mod insertion;
mod medial;
mod point_sets;
mod section;
#[cfg(test)]
mod tests;
mod trait_table;
mod traits;

pub use angle::measure_angles;
pub use ground::GroundChoice;
pub use hull::hull_volume;
pub use trait_table::{Dimension, LengthUnit, TraitRow, traits_csv};
pub use traits::{MeasureOptions, measure};
