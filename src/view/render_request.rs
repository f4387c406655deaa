use std::sync::{Arc, OnceLock};

use super::point_lod::PointLod;
use super::raster::draw_arranged;
use super::{Orbit, SceneModel, SceneStyle, Shot, draw_mesh};

/// A model with a view and a style, for drawing on the CPU at any size and rotation.
///
/// The window and the command line pass it to a job as a closure: the session does not depend on
/// drawing, and this crate does not depend on jobs.
#[derive(Clone)]
pub struct RenderRequest {
    /// The model; a wireframe is drawn as triangles.
    model: SceneModel,
    /// The view.
    orbit: Orbit,
    /// Colours, clip box, sizes and background.
    style: SceneStyle,
    /// Rows of the view for which sizes in pixels are given, above 0; sizes scale with the image.
    rows: u32,
    /// Arrangement of a cloud, computed for the first image.
    point_lod: OnceLock<Arc<PointLod>>,
}

impl RenderRequest {
    /// Creates a portrait; a wireframe is drawn as triangles.
    ///
    /// `rows` (above 0) is the height of the view for which sizes in pixels are given. Point sizes
    /// scale with the image.
    #[must_use]
    pub fn new(model: SceneModel, orbit: Orbit, style: SceneStyle, rows: u32) -> Self {
        Self {
            model,
            orbit,
            style,
            rows,
            point_lod: OnceLock::new(),
        }
    }

    /// Draws the model at a size in pixels, with the scene turned right by `turned` radians.
    ///
    /// With `transparent`, smoothing of a mesh ignores the background.
    #[must_use]
    pub fn draw(&self, width: u32, height: u32, turned: f32, transparent: bool) -> Shot {
        let mut orbit = self.orbit;
        orbit.turn(turned);
        let point_px = self.style.point_px * height as f32 / self.rows.max(1) as f32;
        let style = SceneStyle {
            point_px,
            ..self.style.clone()
        };
        match &self.model {
            SceneModel::Cloud(cloud) => {
                let point_lod = self
                    .point_lod
                    .get_or_init(|| Arc::new(PointLod::of(&cloud.positions)));
                draw_arranged(cloud, point_lod, &orbit.camera(width, height), &style)
            }
            // Each pixel is the mean of four, which smooths edges.
            SceneModel::Surface(mesh) | SceneModel::Wireframe(mesh) => {
                draw_mesh(mesh, &orbit.camera(width * 2, height * 2), &style).halved(transparent)
            }
        }
    }
}
