use std::ops::Range;
use std::sync::Arc;

use wgpu::util::DeviceExt;

use super::Appearance;
use super::paint::Paint;
use super::pipelines::Pipelines;
use super::points::{PointInstance, SpreadOrder, pack, spacing};
use super::surface_chunks::SurfaceChunks;
use crate::scene::{LabelledCloud, LabelledMesh};

/// Points per GPU buffer: 8 MB, packed in a few milliseconds.
const CHUNK: usize = 500_000;

/// What the 3-D view shows.
#[derive(Debug, Clone)]
pub enum Model {
    /// Points as discs.
    Cloud(Arc<LabelledCloud>),
    /// Triangles, lit from the camera. Borders of labels are drawn where triangles meet: see
    /// [`LabelledMesh::split_at_labels`].
    Surface(Arc<LabelledMesh>),
    /// The sides of triangles.
    Wireframe(Arc<LabelledMesh>),
}

impl Model {
    /// Its points or vertices.
    #[must_use]
    pub fn points(&self) -> &LabelledCloud {
        match self {
            Self::Cloud(cloud) => cloud,
            Self::Surface(mesh) | Self::Wireframe(mesh) => &mesh.vertices,
        }
    }

    /// Whether it is the very same thing, shown in the same way.
    fn is(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Cloud(a), Self::Cloud(b)) => Arc::ptr_eq(a, b),
            (Self::Surface(a), Self::Surface(b)) | (Self::Wireframe(a), Self::Wireframe(b)) => Arc::ptr_eq(a, b),
            _ => false,
        }
    }
}

/// A model on its way to the GPU: points, or chunks of triangles, in an order in which every part is spread over the whole.
pub(super) struct Content {
    model: Model,
    /// Distance between points; 0 for triangles.
    pub(super) spacing: f32,
    /// How many points or triangles there are.
    pub(super) len: usize,
    /// How many the GPU has; the first of the order.
    pub(super) uploaded: usize,
    /// The colours of what is uploaded; `None` until the first upload.
    paint: Option<Paint>,
    kind: Kind,
}

enum Kind {
    Points { order: SpreadOrder, chunks: Vec<wgpu::Buffer> },
    Surface(SurfaceChunks),
}

impl Content {
    pub(super) fn new(model: Model) -> Self {
        let (len, kind, spacing) = match &model {
            Model::Cloud(cloud) => {
                let kind = Kind::Points { order: SpreadOrder::new(cloud.len()), chunks: Vec::new() };
                (cloud.len(), kind, spacing(cloud))
            }
            Model::Surface(mesh) | Model::Wireframe(mesh) => {
                let edges = matches!(model, Model::Wireframe(_));
                (mesh.triangles.len(), Kind::Surface(SurfaceChunks::new(mesh.triangles.len(), edges)), 0.0)
            }
        };
        Self { model, spacing, len, uploaded: 0, paint: None, kind }
    }

    pub(super) fn shows(&self, model: &Model) -> bool {
        self.model.is(model)
    }

    /// Colours are others now: all is to be uploaded anew.
    pub(super) fn forget(&mut self) {
        self.uploaded = 0;
        self.paint = None;
        match &mut self.kind {
            Kind::Points { chunks, .. } => chunks.clear(),
            Kind::Surface(chunks) => chunks.clear(),
        }
    }

    /// What the ends of the ramp stand for that colours come from, where they do.
    pub(super) fn range(&self) -> Option<[f32; 2]> {
        self.paint.as_ref().and_then(Paint::range)
    }

    /// Strength of the eye-dome lighting: triangles are lit by their normals.
    pub(super) fn edl_strength(&self, of_points: f32) -> f32 {
        match self.kind {
            Kind::Points { .. } => of_points,
            Kind::Surface(_) => 0.0,
        }
    }

    /// Hands the GPU a bounded part more.
    pub(super) fn upload_next(&mut self, device: &wgpu::Device, appearance: &Appearance) {
        match (&self.model, &mut self.kind) {
            (Model::Cloud(cloud), Kind::Points { order, chunks }) => {
                let paint = self.paint.get_or_insert_with(|| Paint::new(cloud, appearance));
                let end = (self.uploaded + CHUNK).min(cloud.len());
                let points = pack(cloud, *order, self.uploaded..end, paint);
                chunks.push(device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                    label: Some("points"),
                    contents: bytemuck::cast_slice::<PointInstance, u8>(&points),
                    usage: wgpu::BufferUsages::VERTEX,
                }));
                self.uploaded = end;
            }
            (Model::Surface(mesh) | Model::Wireframe(mesh), Kind::Surface(chunks)) => {
                let paint = self.paint.get_or_insert_with(|| Paint::new(&mesh.vertices, appearance));
                self.uploaded = chunks.upload_next(device, mesh, paint);
            }
            _ => {}
        }
    }

    /// Draws a part of what is uploaded; gives how far it came, which for triangles is the end of a chunk.
    pub(super) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, pipelines: &Pipelines, part: Range<usize>) -> usize {
        match &self.kind {
            Kind::Points { chunks, .. } => {
                pass.set_pipeline(&pipelines.points);
                for (index, chunk) in chunks.iter().enumerate() {
                    let first = index * CHUNK;
                    let (from, to) = (part.start.max(first), part.end.min(first + CHUNK));
                    if from < to {
                        pass.set_vertex_buffer(0, chunk.slice(..));
                        pass.draw(0..4, (from - first) as u32..(to - first) as u32);
                    }
                }
                part.end
            }
            Kind::Surface(chunks) => chunks.draw(pass, pipelines, part),
        }
    }
}
