//! Drawing of clouds, meshes and masks; picking; screenshots.
//!
//! A [`SceneModel`] is a labelled cloud or mesh. It is drawn with a [`ViewCamera`], usually that of an
//! [`Orbit`], and a [`SceneStyle`]. [`SceneView`] draws on the GPU into a texture of its own, a
//! bounded batch per call, so that the window stays responsive for clouds of any size.
//! [`draw_cloud`] and [`draw_mesh`] are its CPU twins. They return a [`Shot`], which [`write_png`]
//! saves. Screenshots are always drawn on the CPU, so that they are the same on every machine.
//! [`RenderRequest`] draws a model at any size and rotation.
//!
//! [`draw_layer`] renders the image, depth, normals or confidence of a frame. [`overlay`] and
//! [`hatch`] render masks and regions as translucent pixels. [`pick_point`] and [`pick_frustum`]
//! return what is under the pointer.
//!
//! Cameras use OpenCV axes (x right, y down, z forward), and the centre of the top-left pixel is at
//! (0.5, 0.5). Colours are sRGB with 8 bits per channel, opacity is straight alpha. Lengths are in
//! world units, and sizes on the screen are in pixels.
//!
//! # Example
//!
//! ```rust
//! use glam::Vec3;
//! use ostra_cloud::LabelledCloud;
//! use ostra_view::{SceneStyle, default_view, draw_cloud};
//!
//! let cloud = LabelledCloud::from_positions(vec![Vec3::ZERO, Vec3::X, Vec3::Y]);
//! let view = default_view(&cloud, &[], 1.0).expect("the cloud has points");
//! let shot = draw_cloud(&cloud, &view.camera(64, 64), &SceneStyle::default());
//! assert_eq!(shot.image.pixels.len(), 64 * 64);
//! assert!(shot.opacity.iter().any(|&opacity| opacity > 0));
//! ```

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
mod point_lod;
mod point_spacing;
mod raster;
mod render_request;
mod scene_view;
mod shot;
mod spread_order;
mod style;
mod surface_chunks;
mod target;
mod view_camera;

pub use axes::{Axes, Bounds, Side};
pub use content::{PointsOver, Scene3d, SceneModel};
pub use frame_shapes::{ImagePlane, LineVertex, frustum_lines, link_lines};
pub use layers::{Layer, LayerImage, draw_layer};
pub use mesh_raster::draw_mesh;
pub use orbit::Orbit;
pub use overlay::{OverlayStyle, contrast, hatch, overlay, relative_luminance};
pub use pick::{PickRequest, Picking, is_any_in_view, pick_frustum, pick_point};
pub use raster::draw_cloud;
pub use render_request::RenderRequest;
pub use scene_view::SceneView;
pub use shot::{Shot, ViewError, default_view, write_png};
pub use style::{Appearance, Clip, Coloring, SceneStyle, ramp};
pub use view_camera::{Projection, ViewCamera};
