//! Traits from a labelled cloud: lengths, diameters, areas, volumes per label and instance, as a table.

mod angle;
#[cfg(test)]
mod angle_tests;
mod area;
mod axis;
mod body;
mod bridge;
mod bulk;
mod extent;
mod grid;
mod ground;
mod hull;
mod insertion;
mod medial;
mod meeting;
mod section;
mod table;
#[cfg(test)]
mod tests;
mod traits;
mod unit;
mod voxel_volume;

pub use angle::measure_angles;
pub use ground::GroundChoice;
pub use hull::hull_volume;
pub use table::{TraitRow, traits_csv};
pub use traits::{MeasureOptions, measure};
pub use unit::{Dimension, LengthUnit};
