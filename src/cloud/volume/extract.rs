//! Extraction of triangles from the volume, by the signs of a cell's corners.

use std::sync::LazyLock;

use glam::{DVec3, IVec3, Vec3};
use rayon::prelude::*;

use super::block::{EDGE, ROWS, Signs, SignsAround, TsdfVoxel, VoxelBlock, lanes_in, voxel_at};
use super::frame_measurements::Facing;
use super::sparse_volume::Volume;
use ostra_core::job::{Progress, Stopped};

/// Maximum change of distance between neighbouring voxels at a surface, in voxels.
///
/// The distance changes by more where an occluded region ends next to free space; there is no
/// surface there.
const STEEPEST: f32 = 2.0;

/// A surface as extracted from a volume: vertices by block and edge, triangles by cell.
#[derive(Debug, Default)]
pub(super) struct Raw {
    pub(super) positions: Vec<Vec3>,
    pub(super) colors: Vec<[u8; 3]>,
    /// How well each vertex was seen: the sum of the weights of frames.
    pub(super) weights: Vec<f32>,
    pub(super) triangles: Vec<[u32; 3]>,
}

/// The vertices on the edges that belong to one block.
struct Vertices {
    /// Edges with a vertex, in ascending order: three per voxel, each in two layers.
    edges: Vec<u16>,
    positions: Vec<Vec3>,
    colors: Vec<[u8; 3]>,
    weights: Vec<f32>,
}

/// A sample in its two layers.
type Layers = [Option<TsdfVoxel>; 2];

/// A block and those after it, by the number of their corner.
struct NeighbourBlocks<'a> {
    numbers: [Option<usize>; 8],
    blocks: [Option<&'a VoxelBlock>; 8],
    /// The first corner of the block in world space.
    corner: DVec3,
}

/// One side of the surface in a cell: for each corner, the layer and its sample.
type Side = [(usize, TsdfVoxel); CORNERS];

impl Volume {
    /// Extracts the surface between voxels in front of it and behind it.
    ///
    /// A cell contributes triangles if all its corners were seen, and the surface often enough. The
    /// same volume gives the same triangles for any number of threads.
    pub(super) fn extract(self, progress: &Progress) -> Result<Raw, Stopped> {
        let signs: Vec<Signs> = self.blocks.par_iter().map(VoxelBlock::signs).collect();
        let vertices: Vec<Vertices> = self
            .blocks
            .par_iter()
            .map(|block| {
                progress.check()?;
                Ok(self.vertices_of(block, &signs))
            })
            .collect::<Result<_, Stopped>>()?;
        let mut first = vec![0u32];
        for block in &vertices {
            first.push(first[first.len() - 1] + block.edges.len() as u32);
        }
        let triangles: Vec<Vec<[u32; 3]>> = self
            .blocks
            .par_iter()
            .map(|block| {
                progress.check()?;
                Ok(self.triangles_of(block, &signs, &vertices, &first))
            })
            .collect::<Result<_, Stopped>>()?;
        // The volume is by far the largest allocation.
        drop((self, signs));
        let count = first[first.len() - 1] as usize;
        let mut raw = Raw {
            positions: Vec::with_capacity(count),
            colors: Vec::with_capacity(count),
            weights: Vec::with_capacity(count),
            triangles: Vec::with_capacity(triangles.iter().map(Vec::len).sum()),
        };
        for block in vertices {
            raw.positions.extend(block.positions);
            raw.colors.extend(block.colors);
            raw.weights.extend(block.weights);
        }
        triangles
            .into_iter()
            .for_each(|of_block| raw.triangles.extend(of_block));
        Ok(raw)
    }

    fn around(&self, block: &VoxelBlock) -> NeighbourBlocks<'_> {
        let numbers = std::array::from_fn(|next| self.block(block.place + corner(next as i32)));
        let blocks = numbers.map(|number| number.map(|number| &self.blocks[number]));
        NeighbourBlocks {
            numbers,
            blocks,
            corner: self.corner(block.place),
        }
    }

    fn vertices_of(&self, block: &VoxelBlock, signs: &[Signs]) -> Vertices {
        let mut found = Vertices {
            edges: Vec::new(),
            positions: Vec::new(),
            colors: Vec::new(),
            weights: Vec::new(),
        };
        let around = self.around(block);
        let crossings = around.signs(signs);
        for row in 0..ROWS {
            let edges = crossings.edges(row);
            for x in lanes_in(u32::from(edges[0] | edges[1] | edges[2])) {
                for axis in (0..3).filter(|&axis| edges[axis] >> x & 1 != 0) {
                    self.vertices_on(&around, row * EDGE + x, axis, &mut found);
                }
            }
        }
        found
    }

    /// Adds the vertices, in up to two layers, between a voxel and the next along an axis.
    fn vertices_on(
        &self,
        around: &NeighbourBlocks<'_>,
        voxel: usize,
        axis: usize,
        found: &mut Vertices,
    ) {
        let place = place_of(voxel);
        let after = around.at(place + IVec3::AXES[axis]);
        for (layer, here) in around.at(place).into_iter().enumerate() {
            let Some(here) = here else { continue };
            let Some((_, there)) = same_side(after, here.normal) else {
                continue;
            };
            let share = here.distance / (here.distance - there.distance);
            let weight = here.weight + (there.weight - here.weight) * share;
            let crosses = (here.distance < 0.0) != (there.distance < 0.0);
            let is_jump =
                (here.distance - there.distance).abs() > STEEPEST / self.options.truncation;
            if !crosses || is_jump || weight < self.options.min_weight {
                continue;
            }
            let at = place.as_dvec3() + DVec3::AXES[axis] * f64::from(share);
            let color = here.color().lerp(there.color(), share);
            found.edges.push(((voxel * 3 + axis) * 2 + layer) as u16);
            found
                .positions
                .push((around.corner + at * self.options.voxel).as_vec3());
            found.weights.push(weight);
            found
                .colors
                .push(color.to_array().map(|channel| channel.round() as u8));
        }
    }

    fn triangles_of(
        &self,
        block: &VoxelBlock,
        signs: &[Signs],
        vertices: &[Vertices],
        first: &[u32],
    ) -> Vec<[u32; 3]> {
        let around = self.around(block);
        let crossings = around.signs(signs);
        let mut triangles = Vec::new();
        for row in 0..ROWS {
            for x in lanes_in(u32::from(crossings.cells(row))) {
                let place = place_of(row * EDGE + x);
                for side in around.sides_of_cell(place).into_iter().flatten() {
                    let is_behind = |at: usize| usize::from(side[at].1.distance < 0.0) << at;
                    let behind: usize = (0..CORNERS).map(is_behind).sum();
                    let vertex = |edge: CellEdge| {
                        let layer = side[usize::from(edge.corner)].0;
                        let (owner, edge) = around.edge(place, edge, layer)?;
                        Some(first[owner] + vertices[owner].edges.binary_search(&edge).ok()? as u32)
                    };
                    for triangle in &CASES[behind] {
                        if let [Some(a), Some(b), Some(c)] = triangle.map(vertex) {
                            triangles.push([a, b, c]);
                        }
                    }
                }
            }
        }
        triangles
    }
}

/// Returns the corner of a cube that is encoded by the three bits of `number`.
fn corner(number: i32) -> IVec3 {
    IVec3::new(number & 1, number >> 1 & 1, number >> 2)
}

/// Returns the number of the block that contains a voxel, and the voxel's index in it.
///
/// `place` is relative to the first voxel of the first block.
fn split(place: IVec3) -> (usize, usize) {
    let [x, y, z] = place.to_array().map(|along| along as usize);
    (
        (x / EDGE) | ((y / EDGE) << 1) | ((z / EDGE) << 2),
        voxel_at(x % EDGE, y % EDGE, z % EDGE),
    )
}

fn place_of(voxel: usize) -> IVec3 {
    IVec3::new(
        (voxel % EDGE) as i32,
        (voxel / EDGE % EDGE) as i32,
        (voxel / (EDGE * EDGE)) as i32,
    )
}

/// Returns the layer whose normal agrees best with `normal`.
///
/// Returns `None` if no layer can be the same side of the surface.
fn same_side(layers: Layers, normal: Facing) -> Option<(usize, TsdfVoxel)> {
    let agreement =
        |layer: Option<TsdfVoxel>| layer.map_or(i32::MIN, |layer| layer.normal.dot(normal));
    let [first, second] = layers.map(agreement);
    let best = usize::from(second >= first);
    (first.max(second) > Facing::SAME_SIDE).then_some((best, layers[best]?))
}

impl NeighbourBlocks<'_> {
    fn signs(&self, signs: &[Signs]) -> SignsAround {
        SignsAround::new(
            self.numbers
                .map(|number| number.map(|number| &signs[number])),
        )
    }

    /// Returns the layers of a sample, whose position is relative to the first voxel.
    fn at(&self, place: IVec3) -> Layers {
        let (next, voxel) = split(place);
        self.blocks[next].map_or([None; 2], |block| block.sides(voxel))
    }

    /// Returns the block that owns an edge of a cell, and the number of that edge.
    ///
    /// The cell is at `place`. The number identifies the edge within the block and the layer.
    fn edge(&self, place: IVec3, edge: CellEdge, layer: usize) -> Option<(usize, u16)> {
        let (next, voxel) = split(place + corner(i32::from(edge.corner)));
        Some((
            self.numbers[next]?,
            ((voxel * 3 + usize::from(edge.axis)) * 2 + layer) as u16,
        ))
    }

    /// Returns the sides of the surface that all corners of a cell have seen.
    fn sides_of_cell(&self, place: IVec3) -> [Option<Side>; 2] {
        let mut corners = [[None; 2]; CORNERS];
        for (layers, number) in corners.iter_mut().zip(0..) {
            *layers = self.at(place + corner(number));
        }
        let side = |begin: Option<TsdfVoxel>| -> Option<Side> {
            let normal = begin?.normal;
            let mut side = [(0, begin?); CORNERS];
            for (chosen, layers) in side.iter_mut().zip(corners) {
                *chosen = same_side(layers, normal)?;
            }
            Some(side)
        };
        let [first, second] = corners[0].map(side);
        // If both layers of the first corner lead to the same layers at another corner, there is
        // only one side.
        let is_other = |second: &Side| {
            first.is_none_or(|first| (1..CORNERS).all(|at| first[at].0 != second[at].0))
        };
        [first, second.filter(is_other)]
    }
}

/// Corners of a cell: corner `c` is at (c & 1, c >> 1 & 1, c >> 2 & 1).
const CORNERS: usize = 8;

/// An edge of a cell: one step along an axis from a corner.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct CellEdge {
    /// The corner where the edge starts.
    corner: u8,
    /// 0 = x, 1 = y, 2 = z.
    axis: u8,
}

/// Triangles for each set of corners behind the surface (bit `c` = corner `c`).
///
/// The triangles separate these corners from the others. Each is given by three edges,
/// counterclockwise seen from in front of the surface.
///
/// They are derived from the cell itself. On each face, every run of corners behind the surface is
/// cut off by one line; the lines of all faces form closed loops. Two cells that share a face have
/// the same lines on it, so the surface has no cracks. (W. Lorensen, H. Cline, *Marching Cubes*,
/// SIGGRAPH 1987.)
static CASES: LazyLock<Vec<Vec<[CellEdge; 3]>>> = LazyLock::new(|| {
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

/// Returns the lines that cut each run of corners behind the surface off a face.
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
    fn every_case_separates_its_corners_without_cracks() {
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
            // A triangle side is matched by one in the opposite direction, or lies on a face of the
            // cell.
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
    fn triangle_normals_point_away_from_corners_behind() {
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
