use glam::{IVec3, Vec3};
use rayon::prelude::*;

use super::block::{Block, EDGE, VOXELS, Voxel, voxel_at};
use super::blocks::Volume;
use super::cases::{CASES, CORNERS, CellEdge};
use crate::engine::job::{Progress, Stopped};

/// Samples along an edge of a block with those of the next blocks that its cells need.
const SPAN: usize = EDGE + 1;

/// Voxels by which the distance changes at most from one voxel to the next where a surface is. It changes by more where what
/// is hidden behind something ends beside what is seen free: there is none.
const STEEPEST: f32 = 2.0;

/// A surface as it comes out of a volume: vertices by block and edge, triangles by cell.
#[derive(Debug, Default)]
pub(super) struct Raw {
    pub(super) positions: Vec<Vec3>,
    pub(super) colors: Vec<[u8; 3]>,
    pub(super) triangles: Vec<[u32; 3]>,
}

/// The vertices on one block's own edges.
struct Vertices {
    /// Edges that have one, rising: three a voxel, each in two layers.
    edges: Vec<u16>,
    positions: Vec<Vec3>,
    colors: Vec<[u8; 3]>,
}

/// A sample in its two layers.
type Layers<'a> = [Option<&'a Voxel>; 2];

/// The samples of a block and of the first layers of those after it.
struct Samples<'a> {
    values: Vec<Layers<'a>>,
}

/// One side of the surface in a cell: the layer of each corner, and the corner's sample there.
type Side<'a> = [(usize, &'a Voxel); CORNERS];

impl Volume {
    /// The surface between voxels before and behind it, where all corners of a cell were seen and the surface often enough.
    /// The same volume gives the same triangles for any number of threads.
    pub(super) fn extract(&self, progress: &Progress) -> Result<Raw, Stopped> {
        let vertices: Vec<Vertices> = self
            .blocks
            .par_iter()
            .map(|block| {
                progress.check()?;
                Ok(self.vertices_of(block, &self.samples(block)))
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
                Ok(self.triangles_of(block, &vertices, &first))
            })
            .collect::<Result<_, Stopped>>()?;
        Ok(Raw {
            positions: vertices.iter().flat_map(|block| &block.positions).copied().collect(),
            colors: vertices.iter().flat_map(|block| &block.colors).copied().collect(),
            triangles: triangles.concat(),
        })
    }

    fn samples<'a>(&'a self, block: &'a Block) -> Samples<'a> {
        let around: Vec<Option<&Block>> =
            (0..8).map(|next: i32| self.block(block.place + corner(next)).map(|index| &self.blocks[index])).collect();
        let value = |at: usize| {
            let place = [at % SPAN, at / SPAN % SPAN, at / (SPAN * SPAN)];
            let next = place.iter().enumerate().map(|(axis, along)| (along / EDGE) << axis).sum::<usize>();
            let [x, y, z] = place.map(|along| along % EDGE);
            around[next].map_or([None; 2], |block| block.sides(voxel_at(x, y, z)))
        };
        Samples { values: (0..SPAN * SPAN * SPAN).map(value).collect() }
    }

    fn vertices_of(&self, block: &Block, samples: &Samples<'_>) -> Vertices {
        let mut found = Vertices { edges: Vec::new(), positions: Vec::new(), colors: Vec::new() };
        let begin = self.corner(block.place);
        for voxel in 0..VOXELS {
            let place = place_of(voxel);
            for (edge, axis) in (voxel * 3..).zip(0..3) {
                let after = samples.at(place + IVec3::AXES[axis]);
                for (layer, here) in samples.at(place).iter().enumerate() {
                    let Some(here) = here else { continue };
                    let Some((_, there)) = same_side(after, here.normal()) else { continue };
                    let share = here.distance / (here.distance - there.distance);
                    let weight = here.weight + (there.weight - here.weight) * share;
                    let crosses = (here.distance < 0.0) != (there.distance < 0.0);
                    let is_jump = (here.distance - there.distance).abs() > STEEPEST / self.options.truncation;
                    if !crosses || is_jump || weight < self.options.min_weight {
                        continue;
                    }
                    let at = place.as_dvec3() + glam::DVec3::AXES[axis] * f64::from(share);
                    let color = here.color().lerp(there.color(), share);
                    found.edges.push((edge * 2 + layer) as u16);
                    found.positions.push((begin + at * self.options.voxel).as_vec3());
                    found.colors.push(color.to_array().map(|channel| channel.round() as u8));
                }
            }
        }
        found
    }

    fn triangles_of(&self, block: &Block, vertices: &[Vertices], first: &[u32]) -> Vec<[u32; 3]> {
        let samples = self.samples(block);
        let owners: Vec<Option<usize>> = (0..8).map(|next| self.block(block.place + corner(next))).collect();
        let mut triangles = Vec::new();
        for voxel in 0..VOXELS {
            let place = place_of(voxel);
            for side in samples.sides(place).into_iter().flatten() {
                let is_behind = |at: usize| usize::from(side[at].1.distance < 0.0) << at;
                let behind: usize = (0..CORNERS).map(is_behind).sum();
                let vertex = |edge: CellEdge| {
                    let at = place + corner(i32::from(edge.corner));
                    let (next, inside) = (at / EDGE as i32, at % EDGE as i32);
                    let owner = owners[(next.x | next.y << 1 | next.z << 2) as usize]?;
                    let voxel = voxel_at(inside.x as usize, inside.y as usize, inside.z as usize);
                    let layer = side[usize::from(edge.corner)].0;
                    let edge = ((voxel * 3 + usize::from(edge.axis)) * 2 + layer) as u16;
                    Some(first[owner] + vertices[owner].edges.binary_search(&edge).ok()? as u32)
                };
                for triangle in &CASES[behind] {
                    if let [Some(a), Some(b), Some(c)] = triangle.map(vertex) {
                        triangles.push([a, b, c]);
                    }
                }
            }
        }
        triangles
    }
}

/// The corner of a cube that a number's three bits name.
fn corner(number: i32) -> IVec3 {
    IVec3::new(number & 1, number >> 1 & 1, number >> 2)
}

fn place_of(voxel: usize) -> IVec3 {
    IVec3::new((voxel % EDGE) as i32, (voxel / EDGE % EDGE) as i32, (voxel / (EDGE * EDGE)) as i32)
}

/// The layer that looks most to where a normal does, if one may be the same side of the surface.
fn same_side<'a>(layers: Layers<'a>, normal: Vec3) -> Option<(usize, &'a Voxel)> {
    let agreeing = layers.into_iter().enumerate().filter_map(|(at, layer)| Some((at, layer?)));
    let agreeing = agreeing.filter(|(_, layer)| layer.agrees(normal));
    agreeing.max_by(|(_, a), (_, b)| a.normal().dot(normal).total_cmp(&b.normal().dot(normal)))
}

impl<'a> Samples<'a> {
    fn at(&self, place: IVec3) -> Layers<'a> {
        self.values[(place.z as usize * SPAN + place.y as usize) * SPAN + place.x as usize]
    }

    /// The sides of the surface that all corners of a cell have seen.
    fn sides(&self, place: IVec3) -> [Option<Side<'a>>; 2] {
        let corners: [Layers<'a>; CORNERS] = std::array::from_fn(|number| self.at(place + corner(number as i32)));
        let side = |begin: Option<&'a Voxel>| -> Option<Side<'a>> {
            let normal = begin?.normal();
            let mut side = [(0, begin?); CORNERS];
            for (chosen, layers) in side.iter_mut().zip(corners) {
                *chosen = same_side(layers, normal)?;
            }
            Some(side)
        };
        let [first, second] = corners[0].map(side);
        // Where both layers of the first corner lead to the same ones elsewhere there is one side.
        let is_other = |second: &Side<'a>| first.is_none_or(|first| (1..CORNERS).all(|at| first[at].0 != second[at].0));
        [first, second.filter(is_other)]
    }
}
