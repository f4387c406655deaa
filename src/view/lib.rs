//! Drawing of pictures, masks, clouds and surfaces; picking; PNG shots.
//!
//! On the GPU into textures of its own (`scene_view`), and on the CPU (`raster`, the twin that draws shots anywhere).
//! Screenshots are always drawn on the CPU, so that they are the same on every machine.

mod arrangement;
mod axes;
mod content;
mod frame_shapes;
mod layers;
mod mesh_raster;
mod orbit;
mod overlay;
mod paint;
mod pick;
mod pipelines;
mod point_blocks;
mod portrait;
mod raster;
mod scene_view;
mod shot;
mod style;
mod surface_chunks;
mod target;
mod view_camera;

pub use axes::{Axes, Bounds, Side};
pub use content::{Model, Scene3d};
pub use frame_shapes::{Line, PicturePlane, frustum_lines, link_lines};
pub use layers::{Layer, LayerPicture, draw_layer};
pub use mesh_raster::draw_mesh;
pub use orbit::Orbit;
pub use overlay::{OverlayStyle, hatch, overlay};
pub use pick::{Picking, pick_frustum, pick_point};
pub use portrait::Portrait;
pub use raster::draw_cloud;
pub use scene_view::SceneView;
pub use shot::{Shot, ViewError, default_view, write_png};
pub use style::{Appearance, Clip, Coloring, SceneStyle, ramp};
pub use view_camera::{Projection, ViewCamera};
