use glam::{DMat3, DVec2, DVec3};

use crate::solvers::{Linearised, Problem, minimise};
use crate::{Camera, Pose};

/// Where one camera sees a point.
#[derive(Debug, Clone, Copy)]
pub struct Sighting<'a> {
    /// The camera's intrinsics.
    pub camera: &'a Camera,
    /// The camera's pose.
    pub camera_from_world: &'a Pose,
    /// Position in pixels.
    pub at_px: DVec2,
    /// The same on the plane z = 1, lens distortion removed.
    pub at_plane: DVec2,
}

impl Sighting<'_> {
    /// Direction of the ray in world space, length 1.
    pub(super) fn direction(&self) -> DVec3 {
        self.camera_from_world.rotation.conjugate() * self.at_plane.extend(1.0).normalize()
    }

    /// Squared distance in pixels between where a point is seen and where it would be, on the plane z = 1; infinite
    /// behind the camera.
    pub(super) fn error_squared(&self, position: DVec3) -> f64 {
        let x = self.camera_from_world.transform(position);
        if x.z > 0.0 {
            self.miss(x).length_squared()
        } else {
            f64::INFINITY
        }
    }

    fn miss(&self, x_in_camera: DVec3) -> DVec2 {
        (x_in_camera.truncate() / x_in_camera.z - self.at_plane) * self.camera.focal_px
    }
}

/// Steps of refinement.
const STEPS: usize = 5;
/// Below this share of the views, the smallest eigenvalue of the rays' equations means that the rays are parallel: the
/// square of about 1e-5 radians.
const PARALLEL: f64 = 1e-10;

/// The point nearest to all rays, then with the least squared reprojection error (R. Hartley, P. Sturm, *Triangulation*,
/// CVIU 1997, by Levenberg–Marquardt instead of a polynomial); errors are measured on the plane z = 1 in units of the
/// focal length. `None` for fewer than two views, for parallel rays, and where the point lies behind a camera.
#[must_use]
pub fn triangulate(views: &[Sighting]) -> Option<DVec3> {
    let start = nearest_to_rays(views)?;
    let end = minimise(
        Nearness {
            views,
            position: start,
        },
        STEPS,
    )
    .position;
    in_front(views, end).then_some(end)
}

fn in_front(views: &[Sighting], position: DVec3) -> bool {
    position.is_finite()
        && views
            .iter()
            .all(|view| view.camera_from_world.transform(position).z > 0.0)
}

/// The point with the least squared distance from all rays.
pub(super) fn nearest_to_rays(views: &[Sighting]) -> Option<DVec3> {
    let (mut across, mut towards) = (DMat3::ZERO, DVec3::ZERO);
    for view in views {
        let d = view.direction();
        let off = DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        across += off;
        towards += off * view.camera_from_world.centre();
    }
    // Two eigenvalues are near the number of views; the third is small for nearly parallel rays.
    let count = views.len() as f64;
    let parallel = across.determinant() <= PARALLEL * count * count * count;
    let position = across.inverse() * towards;
    (views.len() >= 2 && !parallel && in_front(views, position)).then_some(position)
}

struct Nearness<'a> {
    views: &'a [Sighting<'a>],
    position: DVec3,
}

impl Problem<3> for Nearness<'_> {
    fn linearise(&self) -> Linearised<3> {
        let mut sum = Linearised::ZERO;
        for view in self.views {
            let x = view.camera_from_world.transform(self.position);
            if x.z.is_nan() || x.z <= 0.0 {
                sum.cost = f64::INFINITY;
                return sum;
            }
            let miss = view.miss(x);
            sum.cost += miss.length_squared();
            let to_world = view.camera_from_world.rotation.conjugate();
            let f = view.camera.focal_px / x.z;
            let rows = [
                DVec3::new(f.x, 0.0, -f.x * x.x / x.z),
                DVec3::new(0.0, f.y, -f.y * x.y / x.z),
            ];
            for (residual, row) in miss.to_array().into_iter().zip(rows) {
                sum.add(residual, &(to_world * row).to_array(), 1.0);
            }
        }
        sum
    }

    fn moved(&self, step: &[f64; 3]) -> Self {
        Self {
            position: self.position + DVec3::from(*step),
            ..*self
        }
    }
}

/// The largest angle in radians under which a point sees two camera centres; 0 for fewer than two.
#[must_use]
pub fn largest_angle(position: DVec3, centres: &[DVec3]) -> f64 {
    let mut least: f64 = 1.0;
    let directions: Vec<DVec3> = centres
        .iter()
        .map(|&centre| (centre - position).normalize_or_zero())
        .collect();
    for (at, a) in directions.iter().enumerate() {
        least = directions[..at]
            .iter()
            .fold(least, |least, b| least.min(a.dot(*b)));
    }
    least.clamp(-1.0, 1.0).acos()
}
