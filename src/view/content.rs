use std::sync::Arc;

use super::paint::Paint;
use super::pipelines::Pipelines;
use super::point_blocks::PointBlocks;
use super::point_lod::{Arranged, Arrival, LodBuild};
use super::surface_chunks::SurfaceChunks;
use super::target::Gpu;
use super::{Appearance, ImagePlane, LineVertex, SceneStyle, ViewCamera};
use ostra_cloud::{LabelledCloud, LabelledMesh};

/// The model shown in the 3-D view.
#[derive(Debug, Clone)]
pub enum SceneModel {
    /// Points as discs.
    Cloud(Arc<LabelledCloud>),
    /// Triangles, lit from the camera.
    ///
    /// Label borders are drawn along triangle edges; see [`LabelledMesh::split_at_labels`].
    Surface(Arc<LabelledMesh>),
    /// The edges of triangles.
    Wireframe(Arc<LabelledMesh>),
}

impl SceneModel {
    /// Returns the points of a cloud or the vertices of a mesh.
    #[must_use]
    pub fn points(&self) -> &LabelledCloud {
        match self {
            Self::Cloud(cloud) => cloud,
            Self::Surface(mesh) | Self::Wireframe(mesh) => &mesh.vertices,
        }
    }

    /// Returns whether `other` is the same object, shown in the same way.
    fn is(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Cloud(a), Self::Cloud(b)) => Arc::ptr_eq(a, b),
            (Self::Surface(a), Self::Surface(b)) | (Self::Wireframe(a), Self::Wireframe(b)) => {
                Arc::ptr_eq(a, b)
            }
            _ => false,
        }
    }
}

/// A model that is being uploaded, and the image that is being drawn of it.
pub(super) struct Content {
    model: SceneModel,
    /// Colours of the uploaded data; `None` until the first upload.
    paint: Option<Paint>,
    kind: ContentKind,
}

enum ContentKind {
    Points {
        /// A sample of the points, later all of them; `None` until the sample is arranged.
        blocks: Option<PointBlocks>,
        /// `None` once all points are arranged.
        lod_build: Option<LodBuild>,
    },
    Surface(SurfaceChunks),
}

impl Content {
    /// Returns content without points.
    pub(super) fn empty() -> Self {
        let blocks = Some(PointBlocks::new(Arc::default()));
        Self {
            model: SceneModel::Cloud(Arc::default()),
            paint: None,
            kind: ContentKind::Points {
                blocks,
                lod_build: None,
            },
        }
    }

    /// Creates content for `model`; `before` is the content shown so far.
    pub(super) fn new(model: SceneModel, before: &Self) -> Self {
        let kind = match &model {
            SceneModel::Cloud(cloud) if cloud.is_empty() => return Self::empty(),
            SceneModel::Cloud(cloud) => ContentKind::Points {
                blocks: None,
                lod_build: Some(LodBuild::begin(Arc::clone(cloud), before.arranged())),
            },
            SceneModel::Surface(mesh) | SceneModel::Wireframe(mesh) => {
                ContentKind::Surface(SurfaceChunks::new(
                    mesh.triangles.len(),
                    matches!(model, SceneModel::Wireframe(_)),
                ))
            }
        };
        Self {
            model,
            paint: None,
            kind,
        }
    }

    /// Returns the cloud with its arrangement if the arrangement covers all points.
    fn arranged(&self) -> Option<Arranged> {
        match (&self.model, &self.kind) {
            (
                SceneModel::Cloud(cloud),
                ContentKind::Points {
                    blocks: Some(blocks),
                    ..
                },
            ) => {
                let all = blocks.point_lod();
                (all.len() == cloud.len()).then(|| (Arc::clone(cloud), Arc::clone(all)))
            }
            _ => None,
        }
    }

    pub(super) fn shows(&self, model: &SceneModel) -> bool {
        self.model.is(model)
    }

    /// Applies a completed arrangement; returns whether the image must be redrawn.
    pub(super) fn receive(&mut self) -> bool {
        let ContentKind::Points { blocks, lod_build } = &mut self.kind else {
            return false;
        };
        match lod_build.as_ref().map(LodBuild::next) {
            Some(Arrival::Some(point_lod)) => {
                *blocks = Some(PointBlocks::new(point_lod));
                true
            }
            Some(Arrival::Over) => {
                *lod_build = None;
                false
            }
            Some(Arrival::NotYet) | None => false,
        }
    }

    /// Returns whether there is anything to draw yet.
    pub(super) fn is_ready(&self) -> bool {
        !matches!(self.kind, ContentKind::Points { blocks: None, .. })
    }

    /// Returns whether no further arrangement is expected.
    pub(super) fn is_final(&self) -> bool {
        !matches!(
            self.kind,
            ContentKind::Points {
                lod_build: Some(_),
                ..
            }
        )
    }

    /// Discards the uploaded data after a change of colours.
    pub(super) fn forget(&mut self) {
        self.paint = None;
        match &mut self.kind {
            ContentKind::Points { blocks, .. } => blocks.iter_mut().for_each(PointBlocks::forget),
            ContentKind::Surface(chunks) => chunks.forget(),
        }
    }

    /// Returns the values at the ends of the colour ramp, if the colours use one.
    pub(super) fn range(&self) -> Option<[f32; 2]> {
        self.paint.as_ref().and_then(Paint::range)
    }

    /// Returns the strength of the eye-dome lighting: 0 for triangles, lit by their normals.
    pub(super) fn edl_strength(&self, of_points: f32) -> f32 {
        match self.kind {
            ContentKind::Points { .. } => of_points,
            ContentKind::Surface(_) => 0.0,
        }
    }

    /// Returns the number of points or triangles.
    pub(super) fn len(&self) -> usize {
        match &self.kind {
            ContentKind::Points { .. } => self.model.points().len(),
            ContentKind::Surface(chunks) => chunks.len(),
        }
    }

    /// Returns how many points or triangles of the current image are drawn.
    pub(super) fn drawn(&self) -> usize {
        match &self.kind {
            ContentKind::Points { blocks, .. } => blocks.as_ref().map_or(0, PointBlocks::drawn),
            ContentKind::Surface(chunks) => chunks.drawn(),
        }
    }

    /// Returns whether the current image is drawn completely.
    pub(super) fn is_drawn(&self) -> bool {
        match &self.kind {
            ContentKind::Points { blocks, .. } => {
                blocks.as_ref().is_some_and(PointBlocks::is_drawn)
            }
            ContentKind::Surface(chunks) => chunks.drawn() == chunks.len(),
        }
    }

    /// Returns whether the current image is drawn and includes all available points in view.
    pub(super) fn is_whole(&self) -> bool {
        match &self.kind {
            ContentKind::Points { blocks, .. } => {
                blocks.as_ref().is_some_and(PointBlocks::is_whole)
            }
            ContentKind::Surface(_) => self.is_drawn(),
        }
    }

    /// Returns whether the current image can be shown.
    ///
    /// An image of points is shown when it is drawn completely, however coarse, and stays until a
    /// finer one is complete. An image of triangles is shown while it fills up.
    pub(super) fn is_presentable(&self) -> bool {
        matches!(self.kind, ContentKind::Surface(_)) || self.is_drawn()
    }

    /// Starts an image.
    ///
    /// For points it is a coarse one. It consists of a batch that is on the GPU after a bounded
    /// upload.
    pub(super) fn begin(&mut self, gpu: &Gpu, scene: &Scene3d, batch: usize) {
        match &mut self.kind {
            ContentKind::Points {
                blocks: Some(blocks),
                ..
            } => blocks.begin(&scene.camera, &scene.style, batch),
            ContentKind::Points { .. } => {}
            ContentKind::Surface(chunks) => chunks.begin(),
        }
        self.upload_next(gpu, &scene.style.appearance, batch);
        if let ContentKind::Points {
            blocks: Some(blocks),
            ..
        } = &mut self.kind
        {
            blocks.settle();
        }
    }

    /// Starts a finer image of the same points; an image of triangles is continued.
    pub(super) fn refine(&mut self) {
        if let ContentKind::Points {
            blocks: Some(blocks),
            ..
        } = &mut self.kind
        {
            blocks.refine();
        }
    }

    /// Uploads a bounded part of the data that the image needs.
    ///
    /// For triangles that is the data of the next batch.
    pub(super) fn upload_next(&mut self, gpu: &Gpu, appearance: &Appearance, batch: usize) {
        let paint = self
            .paint
            .get_or_insert_with(|| Paint::new(self.model.points(), appearance));
        match (&self.model, &mut self.kind) {
            (
                SceneModel::Cloud(cloud),
                ContentKind::Points {
                    blocks: Some(blocks),
                    ..
                },
            ) => blocks.upload_next(gpu, cloud, paint),
            (
                SceneModel::Surface(mesh) | SceneModel::Wireframe(mesh),
                ContentKind::Surface(chunks),
            ) => {
                chunks.upload_next(&gpu.device, mesh, paint, batch);
            }
            _ => {}
        }
    }

    /// Draws at most one more batch of the image.
    pub(super) fn draw(
        &mut self,
        pass: &mut wgpu::RenderPass<'_>,
        pipelines: &Pipelines,
        batch: usize,
    ) {
        match &mut self.kind {
            ContentKind::Points {
                blocks: Some(blocks),
                ..
            } => blocks.draw(pass, pipelines, batch),
            ContentKind::Points { .. } => {}
            ContentKind::Surface(chunks) => chunks.draw(pass, pipelines, batch),
        }
    }
}

/// The inputs of the 3-D view; any change restarts the image.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene3d {
    /// The camera; its size is the size of the texture.
    pub camera: ViewCamera,
    /// Colours, clip box, sizes and background.
    pub style: SceneStyle,
    /// Line segments, e.g. [`super::frustum_lines`]; never clipped.
    pub lines: Vec<LineVertex>,
    /// Images placed in the scene; never clipped.
    pub planes: Vec<ImagePlane>,
    /// Points drawn over the model at the minimum size.
    pub over: Option<PointsOver>,
}

/// Points that are drawn besides the model, such as those of one frame.
///
/// They are drawn in one go, so there should be no more than some hundred thousand.
#[derive(Debug, Clone)]
pub struct PointsOver(pub Arc<LabelledCloud>);

impl PartialEq for PointsOver {
    /// Compares by pointer.
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}
