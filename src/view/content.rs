use std::sync::Arc;

use super::arrangement::{Arranged, Arranging, Arrival};
use super::paint::Paint;
use super::pipelines::Pipelines;
use super::point_blocks::PointBlocks;
use super::surface_chunks::SurfaceChunks;
use super::{Appearance, Line, PicturePlane, SceneStyle, ViewCamera};
use ostra_cloud::{LabelledCloud, LabelledMesh};

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
            (Self::Surface(a), Self::Surface(b)) | (Self::Wireframe(a), Self::Wireframe(b)) => {
                Arc::ptr_eq(a, b)
            }
            _ => false,
        }
    }
}

/// A model on its way to the GPU and the picture that is being drawn of it.
pub(super) struct Content {
    model: Model,
    /// The colours of what is uploaded; `None` until the first upload.
    paint: Option<Paint>,
    kind: Kind,
}

enum Kind {
    Points {
        /// A sample of the points, later all; `None` until the first is arranged.
        blocks: Option<PointBlocks>,
        /// `None` once all has come.
        arranging: Option<Arranging>,
    },
    Surface(SurfaceChunks),
}

impl Content {
    /// Nothing.
    pub(super) fn empty() -> Self {
        let blocks = Some(PointBlocks::new(Arc::default()));
        Self {
            model: Model::Cloud(Arc::default()),
            paint: None,
            kind: Kind::Points {
                blocks,
                arranging: None,
            },
        }
    }

    /// `before` is what was shown till now.
    pub(super) fn new(model: Model, before: &Self) -> Self {
        let kind = match &model {
            Model::Cloud(cloud) if cloud.is_empty() => return Self::empty(),
            Model::Cloud(cloud) => Kind::Points {
                blocks: None,
                arranging: Some(Arranging::begin(Arc::clone(cloud), before.arranged())),
            },
            Model::Surface(mesh) | Model::Wireframe(mesh) => Kind::Surface(SurfaceChunks::new(
                mesh.triangles.len(),
                matches!(model, Model::Wireframe(_)),
            )),
        };
        Self {
            model,
            paint: None,
            kind,
        }
    }

    /// A cloud with the arrangement of all of its points.
    fn arranged(&self) -> Option<Arranged> {
        match (&self.model, &self.kind) {
            (
                Model::Cloud(cloud),
                Kind::Points {
                    blocks: Some(blocks),
                    ..
                },
            ) => {
                let all = blocks.arrangement();
                (all.len() == cloud.len()).then(|| (Arc::clone(cloud), Arc::clone(all)))
            }
            _ => None,
        }
    }

    pub(super) fn shows(&self, model: &Model) -> bool {
        self.model.is(model)
    }

    /// Takes what was arranged meanwhile; whether pictures are to begin anew for it.
    pub(super) fn receive(&mut self) -> bool {
        let Kind::Points { blocks, arranging } = &mut self.kind else {
            return false;
        };
        match arranging.as_ref().map(Arranging::next) {
            Some(Arrival::Some(arrangement)) => {
                *blocks = Some(PointBlocks::new(arrangement));
                true
            }
            Some(Arrival::Over) => {
                *arranging = None;
                false
            }
            Some(Arrival::NotYet) | None => false,
        }
    }

    /// Whether there is anything to be drawn yet.
    pub(super) fn is_ready(&self) -> bool {
        !matches!(self.kind, Kind::Points { blocks: None, .. })
    }

    /// Whether nothing better than what is drawn comes by itself.
    pub(super) fn is_final(&self) -> bool {
        !matches!(
            self.kind,
            Kind::Points {
                arranging: Some(_),
                ..
            }
        )
    }

    /// Colours are others now: all is to be uploaded anew.
    pub(super) fn forget(&mut self) {
        self.paint = None;
        match &mut self.kind {
            Kind::Points { blocks, .. } => blocks.iter_mut().for_each(PointBlocks::forget),
            Kind::Surface(chunks) => chunks.forget(),
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

    /// How many points or triangles there are.
    pub(super) fn len(&self) -> usize {
        match &self.kind {
            Kind::Points { .. } => self.model.points().len(),
            Kind::Surface(chunks) => chunks.len(),
        }
    }

    /// How many points or triangles of the picture are drawn.
    pub(super) fn drawn(&self) -> usize {
        match &self.kind {
            Kind::Points { blocks, .. } => blocks.as_ref().map_or(0, PointBlocks::drawn),
            Kind::Surface(chunks) => chunks.drawn(),
        }
    }

    /// Whether the picture is drawn as it was begun.
    pub(super) fn is_drawn(&self) -> bool {
        match &self.kind {
            Kind::Points { blocks, .. } => blocks.as_ref().is_some_and(PointBlocks::is_drawn),
            Kind::Surface(chunks) => chunks.drawn() == chunks.len(),
        }
    }

    /// Whether the picture is drawn and no finer one can be begun of what is there.
    pub(super) fn is_whole(&self) -> bool {
        match &self.kind {
            Kind::Points { blocks, .. } => blocks.as_ref().is_some_and(PointBlocks::is_whole),
            Kind::Surface(_) => self.is_drawn(),
        }
    }

    /// Whether what is drawn can be shown: a picture of points is whole in itself, however coarse, and holds until a finer
    /// one is drawn; one of triangles fills up.
    pub(super) fn is_presentable(&self) -> bool {
        matches!(self.kind, Kind::Surface(_)) || self.is_drawn()
    }

    /// Begins a picture: of points, a coarse one of a batch that is on the GPU after a bounded upload.
    pub(super) fn begin(
        &mut self,
        gpu: (&wgpu::Device, &wgpu::Queue),
        scene: &Scene3d,
        batch: usize,
    ) {
        match &mut self.kind {
            Kind::Points {
                blocks: Some(blocks),
                ..
            } => blocks.begin(&scene.camera, &scene.style, batch),
            Kind::Points { .. } => {}
            Kind::Surface(chunks) => chunks.begin(),
        }
        self.upload_next(gpu, &scene.style.appearance, batch);
        if let Kind::Points {
            blocks: Some(blocks),
            ..
        } = &mut self.kind
        {
            blocks.settle();
        }
    }

    /// Begins a finer picture of the same scene; one of triangles goes on.
    pub(super) fn refine(&mut self) {
        if let Kind::Points {
            blocks: Some(blocks),
            ..
        } = &mut self.kind
        {
            blocks.refine();
        }
    }

    /// Hands the GPU a bounded part more of what the picture needs, of triangles for the next batch.
    pub(super) fn upload_next(
        &mut self,
        gpu: (&wgpu::Device, &wgpu::Queue),
        appearance: &Appearance,
        batch: usize,
    ) {
        let paint = self
            .paint
            .get_or_insert_with(|| Paint::new(self.model.points(), appearance));
        match (&self.model, &mut self.kind) {
            (
                Model::Cloud(cloud),
                Kind::Points {
                    blocks: Some(blocks),
                    ..
                },
            ) => blocks.upload_next(gpu, cloud, paint),
            (Model::Surface(mesh) | Model::Wireframe(mesh), Kind::Surface(chunks)) => {
                chunks.upload_next(gpu.0, mesh, paint, batch);
            }
            _ => {}
        }
    }

    /// Draws at most a batch more of the picture.
    pub(super) fn draw(
        &mut self,
        pass: &mut wgpu::RenderPass<'_>,
        pipelines: &Pipelines,
        batch: usize,
    ) {
        match &mut self.kind {
            Kind::Points {
                blocks: Some(blocks),
                ..
            } => blocks.draw(pass, pipelines, batch),
            Kind::Points { .. } => {}
            Kind::Surface(chunks) => chunks.draw(pass, pipelines, batch),
        }
    }
}

/// All that decides what the 3-D view shows; a change of anything starts the picture anew.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene3d {
    /// Where it is seen from; its size is the texture's size.
    pub camera: ViewCamera,
    /// How it is drawn.
    pub style: SceneStyle,
    /// Line segments, e.g. [`super::frustum_lines`]; never clipped.
    pub lines: Vec<Line>,
    /// Pictures that stand in it; never clipped.
    pub planes: Vec<PicturePlane>,
}
