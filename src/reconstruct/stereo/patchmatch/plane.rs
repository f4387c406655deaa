//! Planes of pixels, the fields that hold them, and their projection to other cameras.

use glam::Vec3;

/// Cost of a hypothesis that cannot be compared.
pub const WORST: f32 = 2.0;

/// A slanted plane in a view: inverse depth is linear over the image, `w(x + dx, y + dy) = w + a·dx + b·dy`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Plane {
    /// Inverse depth at the pixel's centre, per world unit; 0 = none.
    pub inverse_depth: f32,
    /// Change of inverse depth per pixel to the right and down.
    pub slope: [f32; 2],
}

/// A plane as the hypothesis of a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hypothesis {
    /// The plane.
    pub plane: Plane,
    /// Column of the pixel.
    pub x: f32,
    /// Row of the pixel.
    pub y: f32,
}

/// A pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pixel {
    /// Column.
    pub x: usize,
    /// Row.
    pub y: usize,
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
    /// Returns the viewing ray through a pixel's centre, with z = 1.
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
    /// Returns the same plane, expressed at a pixel `(dx, dy)` further on.
    #[inline(always)]
    pub fn moved(self, dx: f32, dy: f32) -> Self {
        let [a, b] = self.slope;
        Self {
            inverse_depth: self.inverse_depth + a * dx + b * dy,
            ..self
        }
    }

    /// Converts the plane of a coarse pixel to a fine one, in an image twice the size.
    #[inline(always)]
    pub fn enlarged(self, fine: Pixel, coarse: Pixel) -> Self {
        let off = |fine: usize, coarse: usize| 0.5 * (fine as f32 - 0.5) - coarse as f32;
        let [a, b] = self.slope;
        Self {
            slope: [0.5 * a, 0.5 * b],
            ..self.moved(off(fine.x, coarse.x), off(fine.y, coarse.y))
        }
    }

    /// Returns the vector `m` with `m · X = 1` on the plane (camera space); it points away from the camera.
    #[inline(always)]
    pub fn vector(self, raster: &Raster, x: f32, y: f32) -> Vec3 {
        let [a, b] = self.slope;
        let at_axis =
            self.inverse_depth + a * (raster.principal[0] - x) + b * (raster.principal[1] - y);
        Vec3::new(a * raster.focal[0], b * raster.focal[1], at_axis)
    }

    /// Returns the unit normal towards the camera, in camera space.
    pub fn normal(self, raster: &Raster, x: f32, y: f32) -> Vec3 {
        -self.vector(raster, x, y).normalize_or_zero()
    }

    /// Returns the plane through the point at `depth` of a pixel with this normal (camera space, towards the camera).
    ///
    /// The plane faces the camera if the normal is zero or seen edge-on.
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

    /// Returns whether the cosine of the angle between the normal and the viewing ray is at least `least`.
    #[inline(always)]
    pub fn is_facing(self, raster: &Raster, x: f32, y: f32, least: f32) -> bool {
        let ray = raster.ray(x, y);
        let ray_squared = 1.0 + ray.x * ray.x + ray.y * ray.y;
        self.inverse_depth
            >= least * (self.vector(raster, x, y).length_squared() * ray_squared).sqrt()
    }
}

/// Hypotheses and costs of an image.
///
/// The two colours of the checkerboard are stored separately, so that one can be updated while the
/// other is read.
#[derive(Debug, Clone)]
pub struct Field {
    /// Columns of the image.
    pub width: usize,
    /// Rows of the image.
    pub height: usize,
    /// Red, then black.
    pub colors: [Color; 2],
}

/// The pixels of one colour, `⌈width / 2⌉` a row.
#[derive(Debug, Clone)]
pub struct Color {
    /// The best hypothesis so far.
    pub planes: Vec<Plane>,
    /// Its cost, 0–2.
    pub costs: Vec<f32>,
}

impl Field {
    /// Creates a field with the same hypothesis everywhere, at the highest cost.
    pub fn new(width: usize, height: usize) -> Self {
        let count = width.div_ceil(2) * height;
        let color = Color {
            planes: vec![Plane::default(); count],
            costs: vec![WORST; count],
        };
        Self {
            width,
            height,
            colors: [color.clone(), color],
        }
    }

    /// Returns the number of pixels of one colour in a row.
    #[inline(always)]
    pub fn half(&self) -> usize {
        self.width.div_ceil(2)
    }

    /// Returns the hypothesis and cost of a pixel.
    pub fn at(&self, x: usize, y: usize) -> (Plane, f32) {
        let color = &self.colors[(x + y) % 2];
        let at = y * self.half() + x / 2;
        (color.planes[at], color.costs[at])
    }

    /// Sets the hypothesis and cost of a pixel.
    pub fn set(&mut self, x: usize, y: usize, plane: Plane, cost: f32) {
        let at = y * self.half() + x / 2;
        let color = &mut self.colors[(x + y) % 2];
        (color.planes[at], color.costs[at]) = (plane, cost);
    }
}

/// Transfer of pixels of one view to another.
///
/// `(x, y, 1)` at inverse depth `w` is seen at `matrix · (x, y, 1) + w · offset`, in homogeneous
/// pixel indices.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Transfer {
    /// Columns of the matrix.
    pub matrix: [[f32; 3]; 3],
    /// Projection of the viewing camera's centre.
    pub offset: [f32; 3],
}

impl Transfer {
    /// Returns the homogeneous position of a pixel at inverse depth `w`.
    #[inline(always)]
    pub fn apply(&self, x: f32, y: f32, w: f32) -> [f32; 3] {
        let [a, b, c] = &self.matrix;
        std::array::from_fn(|i| c[i] + a[i] * x + b[i] * y + self.offset[i] * w)
    }

    /// Returns the plane's homography around a pixel: position, and change per pixel to the right and down.
    #[inline(always)]
    pub(super) fn homography(&self, plane: Plane, x: f32, y: f32) -> [[f32; 3]; 3] {
        let [a, b] = plane.slope;
        let right = std::array::from_fn(|i| self.matrix[0][i] + a * self.offset[i]);
        let down = std::array::from_fn(|i| self.matrix[1][i] + b * self.offset[i]);
        [self.apply(x, y, plane.inverse_depth), right, down]
    }
}
