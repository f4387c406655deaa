//! Drawing of pictures, masks, clouds and surfaces; picking; PNG shots.
//!
//! On the GPU into textures of its own (`scene_view`), and on the CPU (`raster`, the twin that draws shots anywhere).

mod appearance;
mod arrangement;
mod arranging;
mod axes;
mod bounds;
mod clip;
mod coloring;
mod content;
mod error;
mod eye;
mod eye_dome;
mod frustum;
mod growths;
mod hatch;
mod label_colors;
mod layers;
mod lines;
mod mesh_raster;
mod orbit;
mod overlay;
mod paint;
mod pick;
mod picking;
mod pipelines;
mod planes;
mod point_blocks;
mod points;
mod portrait;
mod raster;
mod scene_view;
mod shares;
mod shot;
mod spacing;
mod style;
mod surface_chunks;
mod target;
#[cfg(test)]
mod tests;
mod upright;
mod view_camera;
mod z_order;

pub use appearance::Appearance;
pub use axes::{Axes, Side};
pub use bounds::Bounds;
pub use clip::Clip;
pub use coloring::{Coloring, ramp};
pub use content::Model;
pub use error::ViewError;
pub use hatch::hatch;
pub use layers::{Layer, LayerPicture, draw_layer};
pub use lines::{Line, frustum_lines, link_lines};
pub use mesh_raster::draw_mesh;
pub use orbit::Orbit;
pub use overlay::{OverlayStyle, overlay};
pub use pick::{pick_frustum, pick_point};
pub use picking::Picking;
pub use planes::PicturePlane;
pub use portrait::Portrait;
pub use raster::draw_cloud;
pub use scene_view::{Scene3d, SceneView};
pub use shot::{Shot, default_view, write_png};
pub use style::SceneStyle;
pub use view_camera::{Projection, ViewCamera};
