//! Traits from a labelled cloud: lengths, diameters, areas, volumes per label and instance, as a table.

mod angle;
#[cfg(test)]
mod angle_tests;
mod axis;
mod body;
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
