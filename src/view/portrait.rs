use std::sync::{Arc, OnceLock};

use super::arrangement::Arrangement;
use super::raster::draw_arranged;
use super::{Model, Orbit, SceneStyle, Shot, draw_mesh};

/// A model as it is looked at, to be drawn on the CPU in any size and turned. The window and the command line pass it to a
/// job as a closure: the session knows no drawing, and this crate no jobs.
#[derive(Clone)]
pub struct Portrait {
    /// What is drawn; of a wireframe, its triangles.
    model: Model,
    /// Where it is seen from.
    orbit: Orbit,
    /// How it is drawn.
    style: SceneStyle,
    /// Rows of the view that the style's sizes in pixels are meant for, above 0; they grow with the picture.
    rows: u32,
    /// Of a cloud, made for the first picture.
    arrangement: OnceLock<Arc<Arrangement>>,
}

impl Portrait {
    /// `rows`: of the view that the style's sizes in pixels are meant for, above 0; they grow with the picture. Of a
    /// wireframe, triangles are drawn.
    #[must_use]
    pub fn new(model: Model, orbit: Orbit, style: SceneStyle, rows: u32) -> Self {
        Self {
            model,
            orbit,
            style,
            rows,
            arrangement: OnceLock::new(),
        }
    }

    /// Draws `size` columns and rows, with the scene turned to the right by `turned` radians; `transparent` leaves the
    /// background out of what is smoothed.
    #[must_use]
    pub fn draw(&self, size: (u32, u32), turned: f32, transparent: bool) -> Shot {
        let mut orbit = self.orbit;
        orbit.turn(turned);
        let point_px = self.style.point_px * size.1 as f32 / self.rows.max(1) as f32;
        let style = SceneStyle {
            point_px,
            ..self.style.clone()
        };
        match &self.model {
            Model::Cloud(cloud) => {
                let arrangement = self
                    .arrangement
                    .get_or_init(|| Arc::new(Arrangement::of(&cloud.positions)));
                draw_arranged(cloud, arrangement, &orbit.camera(size.0, size.1), &style)
            }
            // Each pixel is the mean of four.
            Model::Surface(mesh) | Model::Wireframe(mesh) => {
                draw_mesh(mesh, &orbit.camera(size.0 * 2, size.1 * 2), &style).halved(transparent)
            }
        }
    }
}
