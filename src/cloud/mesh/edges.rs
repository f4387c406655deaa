use super::quadric::Quadric;
use super::weld::Welded;

/// How far a vertex may move.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Freedom {
    /// Inside one label's surface.
    Free,
    /// Along the border of labels or the open border that it lies on.
    Border,
    /// Not at all: borders meet or end in it, or more than two triangles meet in an edge.
    Fixed,
}

/// What a mesh's edges say about its vertices.
pub(super) struct Edges {
    /// Of each vertex.
    pub(super) freedom: Vec<Freedom>,
    /// Of each vertex: its triangles' planes, and at borders planes that stand on the border.
    pub(super) quadrics: Vec<Quadric>,
}

impl Edges {
    pub(super) fn of(mesh: &Welded) -> Self {
        let mut sides: Vec<([u32; 2], u32)> = Vec::with_capacity(mesh.triangles.len() * 3);
        for (at, &[a, b, c]) in mesh.triangles.iter().enumerate() {
            sides.extend([[a, b], [b, c], [c, a]].map(|[a, b]| ([a.min(b), a.max(b)], at as u32)));
        }
        sides.sort_unstable();
        let mut quadrics = plane_quadrics(mesh);
        let mut borders = vec![0u32; mesh.positions.len()];
        let mut fixed = vec![false; mesh.positions.len()];
        for same in sides.chunk_by(|one, other| one.0 == other.0) {
            let pair = same[0].0;
            let labels = || {
                same.iter()
                    .map(|&(_, triangle)| mesh.labels[triangle as usize])
            };
            if same.len() == 2 && labels().next() == labels().next_back() {
                continue;
            }
            for vertex in pair.map(|vertex| vertex as usize) {
                borders[vertex] += 1;
                fixed[vertex] |= same.len() > 2;
            }
            for &(_, triangle) in same {
                let standing = standing_quadric(mesh, pair, triangle as usize);
                pair.iter()
                    .for_each(|&vertex| quadrics[vertex as usize] += standing);
            }
        }
        let freedom = |(&borders, &fixed): (&u32, &bool)| match borders {
            0 => Freedom::Free,
            2 if !fixed => Freedom::Border,
            _ => Freedom::Fixed,
        };
        let freedom = borders.iter().zip(&fixed).map(freedom).collect();
        Self { freedom, quadrics }
    }
}

fn plane_quadrics(mesh: &Welded) -> Vec<Quadric> {
    let mut quadrics = vec![Quadric::default(); mesh.positions.len()];
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|vertex| mesh.positions[vertex as usize]);
        let cross = (b - a).cross(c - a);
        let plane = Quadric::of_plane(a, cross.normalize_or_zero(), cross.length() / 2.0);
        triangle
            .iter()
            .for_each(|&vertex| quadrics[vertex as usize] += plane);
    }
    quadrics
}

/// The plane through a border edge that stands on its triangle: it keeps the border's course.
fn standing_quadric(mesh: &Welded, [from, to]: [u32; 2], triangle: usize) -> Quadric {
    /// Against the planes of triangles, which weigh their area.
    const WEIGHT: f64 = 4.0;
    let [a, b, c] = mesh.triangles[triangle].map(|vertex| mesh.positions[vertex as usize]);
    let start = mesh.positions[from as usize];
    let along = mesh.positions[to as usize] - start;
    let normal = along.cross((b - a).cross(c - a)).normalize_or_zero();
    Quadric::of_plane(start, normal, WEIGHT * along.length_squared())
}
