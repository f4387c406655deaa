use glam::DVec3;
use rand::RngExt;
use rand_pcg::Pcg32;
use rustc_hash::{FxHashMap, FxHashSet};

/// A face of the growing hull.
///
/// Its corners are counterclockwise seen from outside; `outside` lists the points outside of it.
struct HullFace {
    corners: [usize; 3],
    normal: DVec3,
    offset: f64,
    outside: Vec<usize>,
    alive: bool,
}

/// Maximum distance from a plane, as a share of the extent, of points without volume.
const FLAT: f64 = 1e-6;
/// Amplitude of the first perturbation of the points, as a share of their extent.
const JOGGLE: f64 = 1e-8;

/// Returns the volume of the convex hull, accurate to one part in a million.
///
/// The volume is 0 for fewer than four points or for coplanar points. Non-finite points are
/// excluded. The method is Quickhull with joggled input, so that no four points are coplanar
/// (Barber, Dobkin, Huhdanpaa, "The Quickhull algorithm for convex hulls", ACM Transactions on
/// Mathematical Software 1996).
#[must_use]
pub fn hull_volume(points: &[DVec3]) -> f64 {
    let points: Vec<DVec3> = points.iter().copied().filter(|x| x.is_finite()).collect();
    let extent = points
        .iter()
        .fold(DVec3::ZERO, |extent, x| extent.max((*x - points[0]).abs()))
        .max_element();
    let Some(corners) = first_tetrahedron(&points, FLAT * extent) else {
        return 0.0;
    };
    // A rare tie that rounding resolves wrongly disappears with a stronger perturbation.
    let attempt = |k: i32| {
        quickhull(
            &joggled(&points, JOGGLE * 10_f64.powi(k) * extent, k as u64),
            corners,
        )
    };
    (0..5).find_map(attempt).unwrap_or(0.0)
}

/// Returns the points relative to the first one, each perturbed randomly by up to `amount`.
fn joggled(points: &[DVec3], amount: f64, seed: u64) -> Vec<DVec3> {
    let mut dice = Pcg32::new(seed, 17);
    let mut shift = || amount * dice.random_range(-1.0..1.0);
    points
        .iter()
        .map(|&x| x - points[0] + DVec3::new(shift(), shift(), shift()))
        .collect()
}

/// Returns the volume of the hull grown from a tetrahedron.
///
/// Returns `None` if rounding broke its surface.
fn quickhull(points: &[DVec3], corners: [usize; 4]) -> Option<f64> {
    let mut faces = tetrahedron(points, corners);
    let (mut next, mut kept) = (0, faces.len());
    while let Some(face) = faces.get(next) {
        let height = |&k: &usize| face.height(points[k]);
        let farthest = face
            .outside
            .iter()
            .copied()
            .max_by(|a, b| height(a).total_cmp(&height(b)).then(b.cmp(a)));
        match farthest.filter(|_| face.alive) {
            Some(apex) => raise(&mut faces, points, apex)?,
            None => next += 1,
        }
        if faces.len() > 2 * kept + 64 {
            faces.retain(|face| face.alive);
            (next, kept) = (0, faces.len());
        }
    }
    let signed = |face: &HullFace| {
        let [a, b, c] = face.corners.map(|k| points[k]);
        a.dot(b.cross(c)) / 6.0
    };
    Some(faces.iter().filter(|face| face.alive).map(signed).sum())
}

/// Replaces the faces visible from `apex` by a cone from it to their horizon.
///
/// Returns `None` if the horizon is not one closed line.
fn raise(faces: &mut Vec<HullFace>, points: &[DVec3], apex: usize) -> Option<()> {
    let mut edges: FxHashSet<(usize, usize)> = FxHashSet::default();
    let mut order = Vec::new();
    let mut loose = Vec::new();
    for face in faces
        .iter_mut()
        .filter(|face| face.alive && face.height(points[apex]) > 0.0)
    {
        face.alive = false;
        loose.append(&mut face.outside);
        for k in 0..3 {
            let edge = (face.corners[k], face.corners[(k + 1) % 3]);
            edges.insert(edge);
            order.push(edge);
        }
    }
    let horizon: Vec<(usize, usize)> = order
        .into_iter()
        .filter(|&(a, b)| !edges.contains(&(b, a)))
        .collect();
    let ahead: FxHashMap<usize, usize> = horizon.iter().copied().collect();
    let start = horizon.first()?.0;
    let walked = 1 + std::iter::successors(ahead.get(&start), |at| ahead.get(at))
        .take_while(|&&at| at != start)
        .take(horizon.len())
        .count();
    if ahead.len() != horizon.len() || walked != horizon.len() {
        return None;
    }
    let first = faces.len();
    faces.extend(
        horizon
            .iter()
            .map(|&(a, b)| HullFace::new(points, [a, b, apex])),
    );
    share_out(
        &mut faces[first..],
        points,
        loose.into_iter().filter(|&k| k != apex),
    );
    Some(())
}

/// Assigns each point to the first face that it is outside of, if any.
fn share_out(faces: &mut [HullFace], points: &[DVec3], numbers: impl Iterator<Item = usize>) {
    for k in numbers {
        if let Some(face) = faces.iter_mut().find(|face| face.height(points[k]) > 0.0) {
            face.outside.push(k);
        }
    }
}

/// Returns four points far apart, or `None` if all are within `tolerance` of one plane.
fn first_tetrahedron(points: &[DVec3], tolerance: f64) -> Option<[usize; 4]> {
    let farthest = |distance: &dyn Fn(DVec3) -> f64| {
        let best = (0..points.len())
            .max_by(|&a, &b| distance(points[a]).total_cmp(&distance(points[b])))?;
        (distance(points[best]) > tolerance).then_some(best)
    };
    let a = (0..points.len()).min_by(|&a, &b| points[a].x.total_cmp(&points[b].x))?;
    let b = farthest(&|x| x.distance(points[a]))?;
    let line = (points[b] - points[a]).normalize();
    let c = farthest(&|x| (x - points[a]).reject_from_normalized(line).length())?;
    let normal = line.cross(points[c] - points[a]).normalize();
    let d = farthest(&|x| (x - points[a]).dot(normal).abs())?;
    Some([a, b, c, d])
}

fn tetrahedron(points: &[DVec3], [a, b, c, d]: [usize; 4]) -> Vec<HullFace> {
    let below = HullFace::new(points, [a, b, c]).height(points[d]) < 0.0;
    let [a, b, c] = if below { [a, b, c] } else { [a, c, b] };
    let mut faces: Vec<HullFace> = [[a, b, c], [a, d, b], [b, d, c], [c, d, a]]
        .into_iter()
        .map(|f| HullFace::new(points, f))
        .collect();
    share_out(
        &mut faces,
        points,
        (0..points.len()).filter(|k| ![a, b, c, d].contains(k)),
    );
    faces
}

impl HullFace {
    fn new(points: &[DVec3], corners: [usize; 3]) -> Self {
        let [a, b, c] = corners.map(|k| points[k]);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        Self {
            corners,
            normal,
            offset: normal.dot(a),
            outside: Vec::new(),
            alive: true,
        }
    }

    /// Returns the signed height of a point above the face, positive outside.
    fn height(&self, x: DVec3) -> f64 {
        self.normal.dot(x) - self.offset
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hull_volume_of_cube_and_sphere() {
        let cube: Vec<DVec3> = (0..27)
            .map(|k| DVec3::new(f64::from(k % 3), f64::from(k / 3 % 3), f64::from(k / 9)))
            .collect();
        assert!((hull_volume(&cube) - 8.0).abs() < 1e-5);
        let sphere: Vec<DVec3> = (0..4000)
            .map(|k| {
                let z = 1.0 - 2.0 * (f64::from(k) + 0.5) / 4000.0;
                let angle = 2.399_963 * f64::from(k);
                DVec3::new(
                    (1.0 - z * z).sqrt() * angle.cos(),
                    (1.0 - z * z).sqrt() * angle.sin(),
                    z,
                ) + 5.0
            })
            .collect();
        let exact = 4.0 / 3.0 * std::f64::consts::PI;
        assert!((hull_volume(&sphere) / exact - 1.0).abs() < 0.005);
    }

    #[test]
    fn hull_volume_of_lattices_with_coplanar_points() {
        let lattice = |count: i32| {
            (0..count * count * count).map(move |k| {
                DVec3::new(
                    f64::from(k % count),
                    f64::from(k / count % count),
                    f64::from(k / count / count),
                )
            })
        };
        let turned: Vec<DVec3> = lattice(24)
            .map(|x| {
                (glam::DQuat::from_rotation_z(0.3) * (x / 23.0))
                    .as_vec3()
                    .as_dvec3()
            })
            .collect();
        assert!((hull_volume(&turned) - 1.0).abs() < 1e-5);
        assert!((hull_volume(&lattice(20).collect::<Vec<_>>()) - 6859.0).abs() < 0.01);
    }

    #[test]
    fn degenerate_sets_have_zero_volume() {
        assert_eq!(hull_volume(&[]), 0.0);
        assert_eq!(hull_volume(&[DVec3::ONE; 9]), 0.0);
        let plane: Vec<DVec3> = (0..50)
            .map(|k| DVec3::new(f64::from(k % 7), f64::from(k / 7), 3.0))
            .collect();
        assert_eq!(hull_volume(&plane), 0.0);
        assert_eq!(hull_volume(&[DVec3::NAN, DVec3::X]), 0.0);
    }
}
