//! Traits from a labelled cloud: lengths, diameters, areas, volumes per label and instance, as a table.
//!
//! May use: masks (the label tree), the cloud. Must not touch: files, Project, UI.

mod hull;
mod table;

pub use hull::hull_volume;
pub use table::{Dimension, TraitRow, traits_csv};
