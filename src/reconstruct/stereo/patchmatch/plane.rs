use glam::Vec3;

/// A slanted plane as a view sees it: inverse depth is linear over the picture, `w(x + dx, y + dy) = w + a·dx + b·dy`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Plane {
    /// Inverse depth at the pixel's centre, per world unit; 0 = none.
    pub inverse_depth: f32,
    /// Change of inverse depth per pixel to the right and down.
    pub slope: [f32; 2],
}

/// A pinhole camera on the raster: positions are pixel indices, the centre of the top-left pixel is (0, 0).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Raster {
    /// Focal lengths in pixels.
    pub focal: [f32; 2],
    /// Principal point in pixel indices.
    pub principal: [f32; 2],
}

impl Raster {
    /// The viewing ray through a pixel's centre, with z = 1.
    #[inline(always)]
    pub fn ray(&self, x: f32, y: f32) -> Vec3 {
        let [per_x, per_y] = self.focal.map(|focal| 1.0 / focal);
        Vec3::new(
            (x - self.principal[0]) * per_x,
            (y - self.principal[1]) * per_y,
            1.0,
        )
    }
}

impl Plane {
    /// The same plane told at a pixel `(dx, dy)` further on.
    #[inline(always)]
    pub fn moved(self, dx: f32, dy: f32) -> Self {
        let [a, b] = self.slope;
        Self {
            inverse_depth: self.inverse_depth + a * dx + b * dy,
            ..self
        }
    }

    /// The plane of a coarse pixel at a fine one, in a picture twice the size.
    #[inline(always)]
    pub fn enlarged(self, (x, y): (usize, usize), (column, row): (usize, usize)) -> Self {
        let off = |fine: usize, coarse: usize| 0.5 * (fine as f32 - 0.5) - coarse as f32;
        let [a, b] = self.slope;
        Self {
            slope: [0.5 * a, 0.5 * b],
            ..self.moved(off(x, column), off(y, row))
        }
    }

    /// The vector `m` with `m · X = 1` on the plane (camera space); it points away from the camera.
    #[inline(always)]
    pub fn vector(self, raster: &Raster, x: f32, y: f32) -> Vec3 {
        let [a, b] = self.slope;
        let at_axis =
            self.inverse_depth + a * (raster.principal[0] - x) + b * (raster.principal[1] - y);
        Vec3::new(a * raster.focal[0], b * raster.focal[1], at_axis)
    }

    /// Unit normal towards the camera, in camera space.
    pub fn normal(self, raster: &Raster, x: f32, y: f32) -> Vec3 {
        -self.vector(raster, x, y).normalize_or_zero()
    }

    /// The plane through the point at `depth` of a pixel with this normal (camera space, towards the camera); facing the
    /// camera where the normal is zero or seen edge-on.
    pub fn from_normal(depth: f32, normal: Vec3, raster: &Raster, x: f32, y: f32) -> Self {
        let along = normal.dot(raster.ray(x, y));
        let inverse_depth = 1.0 / depth;
        if along > -0.02 {
            return Self {
                inverse_depth,
                slope: [0.0; 2],
            };
        }
        let scale = inverse_depth / along;
        Self {
            inverse_depth,
            slope: [
                normal.x * scale / raster.focal[0],
                normal.y * scale / raster.focal[1],
            ],
        }
    }

    /// Whether the cosine of the angle between the normal and the viewing ray is at least this.
    #[inline(always)]
    pub fn is_facing(self, raster: &Raster, (x, y): (f32, f32), least: f32) -> bool {
        let ray = raster.ray(x, y);
        let ray_squared = 1.0 + ray.x * ray.x + ray.y * ray.y;
        self.inverse_depth
            >= least * (self.vector(raster, x, y).length_squared() * ray_squared).sqrt()
    }
}
