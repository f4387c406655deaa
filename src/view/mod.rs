//! Drawing of pictures, masks and clouds; picking; PNG shots.
//!
//! On the GPU into textures of its own (`cloud_view`), and on the CPU (`raster`, the twin that draws shots anywhere).
//! May use: scene, masks, frames, geometry, engine::gpu. Must not touch: egui, Session.

mod bounds;
mod cloud_view;
mod coloring;
mod error;
mod layers;
mod lines;
mod mesh_raster;
mod orbit;
mod overlay;
mod pick;
mod pipelines;
mod points;
mod raster;
mod shot;

pub use bounds::Bounds;
pub use cloud_view::{CloudView, Scene3d};
pub use coloring::{Coloring, ramp};
pub use error::ViewError;
pub use layers::{Layer, LayerPicture, draw_layer};
pub use lines::{Line, frustum_lines};
pub use mesh_raster::draw_mesh;
pub use orbit::{Orbit, ViewCamera};
pub use overlay::{OverlayStyle, overlay};
pub use pick::{pick_frustum, pick_point};
pub use raster::{RasterStyle, draw_cloud};
pub use shot::{ShotOptions, default_view, shot, shot_mesh, write_png};
