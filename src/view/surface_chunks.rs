use std::ops::Range;

use rayon::prelude::*;
use rustc_hash::FxHashMap;
use wgpu::util::DeviceExt;

use super::paint::Paint;
use super::pipelines::{Pipelines, SurfaceVertex};
use super::spread_order::SpreadOrder;
use ostra_cloud::LabelledMesh;

/// Maximum number of triangles per chunk; each chunk has its own vertex and index buffer.
const CHUNK: usize = 4096;
/// Maximum number of chunks that are packed in parallel per call.
const AT_ONCE: usize = 64;

/// A surface in chunks of triangles, uploaded and drawn in an order that is spread over the whole.
pub(super) struct SurfaceChunks {
    triangles: usize,
    order: SpreadOrder,
    /// Whether only edges are drawn.
    edges: bool,
    chunks: Vec<Chunk>,
    /// Number of triangles drawn of the current image, up to the end of a chunk.
    drawn: usize,
}

struct Chunk {
    vertices: wgpu::Buffer,
    indices: wgpu::Buffer,
    index_count: u32,
    /// Number of triangles in this chunk and all chunks before it.
    end: usize,
}

impl SurfaceChunks {
    pub(super) fn new(triangles: usize, edges: bool) -> Self {
        Self {
            triangles,
            order: SpreadOrder::new(triangles.div_ceil(CHUNK)),
            edges,
            chunks: Vec::new(),
            drawn: 0,
        }
    }

    /// Returns the number of triangles.
    pub(super) fn len(&self) -> usize {
        self.triangles
    }

    /// Returns how many triangles of the current image are drawn.
    pub(super) fn drawn(&self) -> usize {
        self.drawn
    }

    /// Discards the uploaded chunks after a change of colours.
    pub(super) fn forget(&mut self) {
        self.chunks.clear();
    }

    /// Starts an image.
    pub(super) fn begin(&mut self) {
        self.drawn = 0;
    }

    /// Uploads a few more chunks unless the next `most` triangles are already on the GPU.
    pub(super) fn upload_next(
        &mut self,
        device: &wgpu::Device,
        mesh: &LabelledMesh,
        paint: &Paint,
        most: usize,
    ) {
        if self.uploaded() >= self.triangles.min(self.drawn + most) {
            return;
        }
        let first = self.chunks.len();
        let last = (first + AT_ONCE).min(self.triangles.div_ceil(CHUNK));
        let triangles = |place: usize| {
            let from = self.order.at(place) * CHUNK;
            from..(from + CHUNK).min(self.triangles)
        };
        let packed: Vec<_> = (first..last)
            .into_par_iter()
            .map(|place| pack(mesh, triangles(place), self.edges, paint))
            .collect();
        for (place, (vertices, indices)) in (first..last).zip(packed) {
            let buffer = |label, contents, usage| {
                device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                    label: Some(label),
                    contents,
                    usage,
                })
            };
            let end = self.uploaded() + triangles(place).len();
            self.chunks.push(Chunk {
                vertices: buffer(
                    "vertices",
                    bytemuck::cast_slice(&vertices),
                    wgpu::BufferUsages::VERTEX,
                ),
                indices: buffer(
                    "indices",
                    bytemuck::cast_slice(&indices),
                    wgpu::BufferUsages::INDEX,
                ),
                index_count: indices.len() as u32,
                end,
            });
        }
    }

    fn uploaded(&self) -> usize {
        self.chunks.last().map_or(0, |chunk| chunk.end)
    }

    /// Draws the chunks that start among the next `most` triangles.
    pub(super) fn draw(
        &mut self,
        pass: &mut wgpu::RenderPass<'_>,
        pipelines: &Pipelines,
        most: usize,
    ) {
        let part = self.drawn..(self.drawn + most).min(self.uploaded());
        pass.set_pipeline(if self.edges {
            &pipelines.edges
        } else {
            &pipelines.surface
        });
        let mut begin = 0;
        for chunk in &self.chunks {
            if part.contains(&begin) && chunk.index_count > 0 {
                pass.set_vertex_buffer(0, chunk.vertices.slice(..));
                pass.set_index_buffer(chunk.indices.slice(..), wgpu::IndexFormat::Uint32);
                pass.draw_indexed(0..chunk.index_count, 0, 0..1);
            }
            begin = chunk.end;
            if begin >= part.end {
                break;
            }
        }
        self.drawn = begin;
    }
}

/// Packs some triangles into vertices and indices of triangle corners or edge ends.
///
/// Triangles with a hidden corner are left out.
fn pack(
    mesh: &LabelledMesh,
    triangles: Range<usize>,
    edges: bool,
    paint: &Paint,
) -> (Vec<SurfaceVertex>, Vec<u32>) {
    let (mut vertices, mut indices) = (Vec::new(), Vec::new());
    let mut places: FxHashMap<u32, Option<u32>> = FxHashMap::default();
    for &triangle in &mesh.triangles[triangles] {
        let [Some(a), Some(b), Some(c)] = triangle.map(|vertex| {
            *places.entry(vertex).or_insert_with(|| {
                let packed = packed(mesh, vertex as usize, paint)?;
                vertices.push(packed);
                Some(vertices.len() as u32 - 1)
            })
        }) else {
            continue;
        };
        if edges {
            indices.extend([a, b, b, c, c, a]);
        } else {
            indices.extend([a, b, c]);
        }
    }
    if edges {
        indices = once_each(&indices);
    }
    (vertices, indices)
}

fn packed(mesh: &LabelledMesh, vertex: usize, paint: &Paint) -> Option<SurfaceVertex> {
    let color = paint.color(&mesh.vertices, vertex)?;
    let [x, y, z] = (mesh.vertices.normals[vertex].clamp_length_max(1.0) * 32767.0)
        .to_array()
        .map(|along| along as i16);
    let position = mesh.vertices.positions[vertex].to_array();
    Some(SurfaceVertex {
        position,
        color,
        normal: [x, y, z, 0],
    })
}

/// Removes duplicate edges, which adjacent triangles share.
fn once_each(ends: &[u32]) -> Vec<u32> {
    let mut sides: Vec<[u32; 2]> = ends
        .as_chunks()
        .0
        .iter()
        .map(|&[a, b]: &[u32; 2]| [a.min(b), a.max(b)])
        .collect();
    sides.sort_unstable();
    sides.dedup();
    sides.concat()
}
