use super::{Model, Orbit, SceneStyle, Shot, draw_cloud, draw_mesh};

/// A model as it is looked at, to be drawn on the CPU in any size and turned.
#[derive(Debug, Clone)]
pub struct Portrait {
    /// What is drawn; of a wireframe, its triangles.
    pub model: Model,
    /// Where it is seen from.
    pub orbit: Orbit,
    /// How it is drawn.
    pub style: SceneStyle,
    /// Rows of the view that the style's sizes in pixels are meant for, above 0; they grow with the picture.
    pub rows: u32,
}

impl Portrait {
    /// Draws `size` columns and rows, with the scene turned to the right by `turned` radians; `transparent` leaves the
    /// background out of what is smoothed.
    #[must_use]
    pub fn draw(&self, size: (u32, u32), turned: f32, transparent: bool) -> Shot {
        let mut orbit = self.orbit;
        orbit.turn(turned);
        let point_px = self.style.point_px * size.1 as f32 / self.rows.max(1) as f32;
        let style = SceneStyle { point_px, ..self.style.clone() };
        match &self.model {
            Model::Cloud(cloud) => draw_cloud(cloud, &orbit.camera(size.0, size.1), &style),
            // Each pixel is the mean of four.
            Model::Surface(mesh) | Model::Wireframe(mesh) => {
                draw_mesh(mesh, &orbit.camera(size.0 * 2, size.1 * 2), &style).halved(transparent)
            }
        }
    }
}
