use glam::{IVec3, Vec3};
use rustc_hash::FxHashMap;

/// Edge of the cells by which points hang together, in spacings of the cloud: gaps below one cell do not part a piece.
const CELL: f32 = 2.0;

/// The pieces of some points, by falling size, of equal ones the one with the first point first; points rise within a
/// piece. Points hang together when their cells touch, at a corner too (connected components of occupied voxels).
pub(super) fn pieces(positions: &[Vec3], spacing: f32, chosen: &[u32]) -> Vec<Vec<u32>> {
    let cell = |point: u32| {
        (positions[point as usize] / (CELL * spacing))
            .floor()
            .as_ivec3()
    };
    let mut cells: FxHashMap<IVec3, Vec<u32>> = FxHashMap::default();
    for &point in chosen {
        cells.entry(cell(point)).or_default().push(point);
    }
    let mut pieces: Vec<Vec<u32>> = Vec::new();
    for &point in chosen {
        let Some(first) = cells.remove(&cell(point)) else {
            continue;
        };
        let (mut piece, mut open) = (first, vec![cell(point)]);
        while let Some(at) = open.pop() {
            for step in around() {
                if let Some(members) = cells.remove(&(at + step)) {
                    piece.extend(members);
                    open.push(at + step);
                }
            }
        }
        piece.sort_unstable();
        pieces.push(piece);
    }
    pieces.sort_by(|a, b| b.len().cmp(&a.len()).then(a.cmp(b)));
    pieces
}

fn around() -> impl Iterator<Item = IVec3> {
    (0..27).map(|at| IVec3::new(at % 3, at / 3 % 3, at / 9) - IVec3::ONE)
}
