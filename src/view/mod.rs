//! Drawing of pictures, masks, clouds and surfaces; picking; PNG shots.
//!
//! On the GPU into textures of its own (`scene_view`), and on the CPU (`raster`, the twin that draws shots anywhere).
//! May use: scene, masks, frames, geometry, engine::gpu. Must not touch: egui, Session.

mod bounds;
mod coloring;
mod content;
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
mod scene_view;
mod shot;
mod surface_chunks;
mod target;

pub use bounds::Bounds;
pub use coloring::{Coloring, ramp};
pub use content::Model;
pub use error::ViewError;
pub use layers::{Layer, LayerPicture, draw_layer};
pub use lines::{Line, frustum_lines, link_lines};
pub use mesh_raster::draw_mesh;
pub use orbit::{Orbit, ViewCamera};
pub use overlay::{OverlayStyle, overlay};
pub use pick::{pick_frustum, pick_point};
pub use raster::{RasterStyle, draw_cloud};
pub use scene_view::{Scene3d, SceneView};
pub use shot::{ShotOptions, default_view, shot, shot_mesh, write_png};
