use glam::DVec3;
use rustc_hash::FxHashMap;

/// A face of the growing hull: corners anticlockwise seen from outside, and the points outside of it.
struct Face {
    corners: [usize; 3],
    normal: DVec3,
    offset: f64,
    outside: Vec<usize>,
    alive: bool,
}

/// Volume of the convex hull; 0 for fewer than four points or points in one plane. Quickhull (Barber, Dobkin,
/// Huhdanpaa, "The Quickhull algorithm for convex hulls", ACM Transactions on Mathematical Software 1996). Points that
/// are not finite are left out.
#[must_use]
pub fn hull_volume(points: &[DVec3]) -> f64 {
    let points: Vec<DVec3> = points.iter().copied().filter(|x| x.is_finite()).collect();
    let extent = points.iter().fold(DVec3::ZERO, |extent, x| extent.max((*x - points[0]).abs())).max_element();
    let tolerance = 1e-10 * extent;
    let Some(faces) = quickhull(&points, tolerance) else { return 0.0 };
    let origin = points[0];
    let signed = |face: &Face| {
        let [a, b, c] = face.corners.map(|k| points[k] - origin);
        a.dot(b.cross(c)) / 6.0
    };
    faces.iter().filter(|face| face.alive).map(signed).sum()
}

fn quickhull(points: &[DVec3], tolerance: f64) -> Option<Vec<Face>> {
    let mut faces = first_tetrahedron(points, tolerance)?;
    let mut next = 0;
    while next < faces.len() {
        let face = &faces[next];
        let height = |&k: &usize| points[k].dot(face.normal) - face.offset;
        let farthest = face.outside.iter().copied().max_by(|a, b| height(a).total_cmp(&height(b)).then(b.cmp(a)));
        match farthest.filter(|_| face.alive) {
            Some(apex) => raise(&mut faces, points, apex, tolerance),
            None => next += 1,
        }
    }
    Some(faces)
}

/// Replaces the faces that `apex` sees by a cone from it to their horizon.
fn raise(faces: &mut Vec<Face>, points: &[DVec3], apex: usize, tolerance: f64) {
    let mut edges: FxHashMap<(usize, usize), usize> = FxHashMap::default();
    let mut order = Vec::new();
    let mut loose = Vec::new();
    for face in faces.iter_mut().filter(|face| face.alive) {
        if points[apex].dot(face.normal) - face.offset > tolerance {
            face.alive = false;
            loose.append(&mut face.outside);
            for k in 0..3 {
                let edge = (face.corners[k], face.corners[(k + 1) % 3]);
                edges.insert(edge, order.len());
                order.push(edge);
            }
        }
    }
    let first = faces.len();
    for &(a, b) in order.iter().filter(|(a, b)| !edges.contains_key(&(*b, *a))) {
        faces.push(Face::new(points, [a, b, apex]));
    }
    for k in loose.into_iter().filter(|&k| k != apex) {
        let sees = |face: &&mut Face| points[k].dot(face.normal) - face.offset > tolerance;
        if let Some(face) = faces[first..].iter_mut().find(sees) {
            face.outside.push(k);
        }
    }
}

fn first_tetrahedron(points: &[DVec3], tolerance: f64) -> Option<Vec<Face>> {
    let farthest = |distance: &dyn Fn(DVec3) -> f64| {
        let best = (0..points.len()).max_by(|&a, &b| distance(points[a]).total_cmp(&distance(points[b])))?;
        (distance(points[best]) > tolerance).then_some(best)
    };
    let a = (0..points.len()).min_by(|&a, &b| points[a].x.total_cmp(&points[b].x))?;
    let b = farthest(&|x| x.distance(points[a]))?;
    let line = (points[b] - points[a]).normalize();
    let c = farthest(&|x| (x - points[a]).reject_from_normalized(line).length())?;
    let normal = line.cross(points[c] - points[a]).normalize();
    let d = farthest(&|x| (x - points[a]).dot(normal).abs())?;
    let below = (points[d] - points[a]).dot(normal) < 0.0;
    let [a, b, c] = if below { [a, b, c] } else { [a, c, b] };
    let mut faces: Vec<Face> =
        [[a, b, c], [a, d, b], [b, d, c], [c, d, a]].into_iter().map(|f| Face::new(points, f)).collect();
    for (k, point) in points.iter().enumerate() {
        let sees = |face: &&mut Face| point.dot(face.normal) - face.offset > tolerance;
        if let Some(face) = faces.iter_mut().find(sees) {
            face.outside.push(k);
        }
    }
    Some(faces)
}

impl Face {
    fn new(points: &[DVec3], corners: [usize; 3]) -> Self {
        let [a, b, c] = corners.map(|k| points[k]);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        Self { corners, normal, offset: normal.dot(a), outside: Vec::new(), alive: true }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cube_and_sphere() {
        let cube: Vec<DVec3> =
            (0..27).map(|k| DVec3::new(f64::from(k % 3), f64::from(k / 3 % 3), f64::from(k / 9))).collect();
        assert!((hull_volume(&cube) - 8.0).abs() < 1e-9);
        let sphere: Vec<DVec3> = (0..4000)
            .map(|k| {
                let z = 1.0 - 2.0 * (f64::from(k) + 0.5) / 4000.0;
                let angle = 2.399_963 * f64::from(k);
                DVec3::new((1.0 - z * z).sqrt() * angle.cos(), (1.0 - z * z).sqrt() * angle.sin(), z) + 5.0
            })
            .collect();
        let exact = 4.0 / 3.0 * std::f64::consts::PI;
        assert!((hull_volume(&sphere) / exact - 1.0).abs() < 0.005);
    }

    #[test]
    fn degenerate_sets_have_no_volume() {
        assert_eq!(hull_volume(&[]), 0.0);
        assert_eq!(hull_volume(&[DVec3::ONE; 9]), 0.0);
        let plane: Vec<DVec3> = (0..50).map(|k| DVec3::new(f64::from(k % 7), f64::from(k / 7), 3.0)).collect();
        assert_eq!(hull_volume(&plane), 0.0);
        assert_eq!(hull_volume(&[DVec3::NAN, DVec3::X]), 0.0);
    }
}
