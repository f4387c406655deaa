//! Verbs on bare points: neighbours, spacing, outliers, normals, thinning.

mod downsample;
mod neighbours;
mod normals;
mod outliers;

pub use downsample::downsample;
pub use neighbours::{Neighbours, spacing};
pub use normals::{NormalOptions, estimate_normals};
pub use outliers::{OutlierOptions, outliers};
