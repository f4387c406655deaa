use std::sync::LazyLock;

/// Corners of a cell: corner `c` lies at (c & 1, c >> 1 & 1, c >> 2 & 1).
pub(super) const CORNERS: usize = 8;

/// An edge of a cell: from a corner one step along an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct CellEdge {
    /// The corner at which it begins.
    pub(super) corner: u8,
    /// 0 = x, 1 = y, 2 = z.
    pub(super) axis: u8,
}

/// For each set of corners behind the surface (bit `c` = corner `c`), the triangles that part them from the others, each
/// by three edges, counterclockwise seen from before the surface.
///
/// The triangles are found from the cell itself: on each face, every run of corners behind the surface is cut off by one
/// line; the lines of all faces close to loops. Two cells that share a face draw the same lines on it, so the surface has
/// no cracks. (W. Lorensen, H. Cline, *Marching Cubes*, SIGGRAPH 1987.)
pub(super) static CASES: LazyLock<Vec<Vec<[CellEdge; 3]>>> = LazyLock::new(|| {
    (0..1 << CORNERS)
        .map(|behind: u32| triangles(behind))
        .collect()
});

/// The corners of the six faces, counterclockwise seen from outside.
const FACES: [[u8; 4]; 6] = [
    [0, 4, 6, 2],
    [1, 3, 7, 5],
    [0, 1, 5, 4],
    [2, 6, 7, 3],
    [0, 2, 3, 1],
    [4, 5, 7, 6],
];

fn triangles(behind: u32) -> Vec<[CellEdge; 3]> {
    let mut lines: Vec<(CellEdge, CellEdge)> = FACES
        .iter()
        .flat_map(|face| lines_on(face, behind))
        .collect();
    let mut triangles = Vec::new();
    while let Some((first, mut last)) = lines.pop() {
        let mut corners = vec![first];
        while last != first {
            corners.push(last);
            let Some(next) = lines.iter().position(|line| line.0 == last) else {
                break;
            };
            last = lines.swap_remove(next).1;
        }
        triangles
            .extend((1..corners.len() - 1).map(|at| [corners[0], corners[at], corners[at + 1]]));
    }
    triangles
}

/// The lines that cut each run of corners behind the surface off a face.
fn lines_on(face: &[u8; 4], behind: u32) -> Vec<(CellEdge, CellEdge)> {
    let is_behind = |at: usize| behind >> face[at % 4] & 1 == 1;
    let begins = (0..4).filter(|&at| !is_behind(at) && is_behind(at + 1));
    begins
        .map(|begin| {
            let ahead = (1..4)
                .find(|ahead| !is_behind(begin + 1 + ahead))
                .unwrap_or(3);
            let end = begin + ahead;
            (
                edge(face[begin % 4], face[(begin + 1) % 4]),
                edge(face[end % 4], face[(end + 1) % 4]),
            )
        })
        .collect()
}

fn edge(a: u8, b: u8) -> CellEdge {
    CellEdge {
        corner: a.min(b),
        axis: (a ^ b).trailing_zeros() as u8,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_case_parts_its_corners_and_closes_over_the_faces() {
        for behind in 0..256u32 {
            let triangles = &CASES[behind as usize];
            let crossed = |edge: &CellEdge| {
                let other = edge.corner | 1 << edge.axis;
                (behind >> edge.corner ^ behind >> other) & 1 == 1
            };
            assert!(triangles.iter().flatten().all(crossed), "{behind:08b}");
            // Every crossed edge is a vertex of some triangle.
            let edges =
                (0..8u8).flat_map(|corner| (0..3u8).map(move |axis| CellEdge { corner, axis }));
            for edge in edges.filter(|edge| edge.corner >> edge.axis & 1 == 0 && crossed(edge)) {
                assert!(
                    triangles.iter().flatten().any(|used| *used == edge),
                    "{behind:08b} {edge:?}"
                );
            }
            // A side of a triangle is met by one the other way, or lies on a face of the cell.
            let sides: Vec<_> = triangles
                .iter()
                .flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)])
                .collect();
            for &(a, b) in &sides {
                let met = sides.contains(&(b, a));
                let shares_face = |a: CellEdge, b: CellEdge| {
                    (0..3u8).any(|axis| {
                        let flat = |edge: CellEdge| edge.axis != axis;
                        flat(a) && flat(b) && a.corner >> axis & 1 == b.corner >> axis & 1
                    })
                };
                assert!(met || shares_face(a, b), "{behind:08b}: {a:?} {b:?}");
            }
        }
    }

    #[test]
    fn the_surface_looks_away_from_what_is_behind_it() {
        let middle = |edge: CellEdge| {
            let at = |bit: u8| f32::from(edge.corner >> bit & 1);
            glam::Vec3::new(at(0), at(1), at(2)) + glam::Vec3::AXES[usize::from(edge.axis)] * 0.5
        };
        let [a, b, c] = CASES[1][0].map(middle);
        assert!(
            (b - a).cross(c - a).dot(glam::Vec3::ONE) > 0.0,
            "corner 0 is behind, the normal looks away from it"
        );
        assert_eq!(CASES[1].len(), 1);
        assert_eq!(CASES[0].len() + CASES[255].len(), 0);
    }
}
