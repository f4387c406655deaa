use glam::DVec3;

use super::bricks::build_bricks;
use super::model::SceneMesh;
use super::options::{SceneKind, SceneOptions};
use super::render::{Light, render};
use super::tiller::build_tiller;
use super::truth::{TruthOptions, TruthSource, exact_cloud};
use super::view::{RenderedView, SyntheticView, arc_of_views, spoil};
use ostra_cloud::measure::TraitRow;
use ostra_cloud::{LabelledCloud, SceneError};
use ostra_core::job::Progress;
use ostra_masks::{Label, LabelId, LabelTree};

/// A synthetic scene: labelled surfaces with materials, cameras and exact traits.
///
/// World units are metres and z is up. The specimen stands on z = 0 at the origin.
#[derive(Debug, Clone)]
pub struct Scene {
    options: SceneOptions,
    pub(super) model: SceneMesh,
    pub(super) light: Light,
    pub(super) views: Vec<SyntheticView>,
    tree: LabelTree,
    traits: Vec<TraitRow>,
}

impl Scene {
    /// Depth in the label tree of the classes that a user would label.
    ///
    /// These are `stem`, `leaf` and `panicle`, or `car`, `wheel` and `figure`. The specimen is
    /// above them; instances and their parts are below.
    pub const CLASS_LEVEL: usize = 2;

    /// Depth of parts in the label tree.
    pub const PART_LEVEL: usize = 4;

    /// Builds a scene; equal options give equal scenes.
    ///
    /// # Errors
    /// Returns [`SceneError::Request`] if an option is out of range.
    pub fn build(options: &SceneOptions) -> Result<Self, SceneError> {
        options.check()?;
        let mut assembly = match options.scene {
            SceneKind::Tiller => build_tiller(options.seed),
            SceneKind::Bricks => build_bricks(options.seed),
        };
        let model = SceneMesh::joined(&mut assembly);
        let light = Light::new(&model, DVec3::new(0.0, 0.0, 0.25));
        let views = arc_of_views(options);
        Ok(Self {
            options: options.clone(),
            model,
            light,
            views,
            tree: assembly.tree,
            traits: assembly.traits,
        })
    }

    /// Returns the options of the scene.
    #[must_use]
    pub fn options(&self) -> &SceneOptions {
        &self.options
    }

    /// Returns the cameras in order along the arc.
    #[must_use]
    pub fn views(&self) -> &[SyntheticView] {
        &self.views
    }

    /// Returns the labels: specimen › class › instance (› part).
    #[must_use]
    pub fn tree(&self) -> &LabelTree {
        &self.tree
    }

    /// Returns the labels that a simulated user clicks.
    ///
    /// For a plant these are the classes. For toys these are the parts, with all wheels as one
    /// class.
    #[must_use]
    pub fn clicked_labels(&self) -> Vec<LabelId> {
        let separated = self.classes_with_instances();
        let is_clicked = |label: &&Label| match self.options.scene {
            SceneKind::Tiller => self.tree.depth(label.id) == Self::CLASS_LEVEL,
            SceneKind::Bricks => {
                separated.contains(&label.name) || self.tree.depth(label.id) == Self::PART_LEVEL
            }
        };
        self.tree
            .iter()
            .filter(is_clicked)
            .map(|label| label.id)
            .collect()
    }

    /// Returns the names of classes that are clicked as one and split into connected instances.
    #[must_use]
    pub fn classes_with_instances(&self) -> Vec<String> {
        match self.options.scene {
            SceneKind::Tiller => Vec::new(),
            SceneKind::Bricks => vec!["wheel".into()],
        }
    }

    /// Returns the exact traits, in metres.
    #[must_use]
    pub fn traits(&self) -> &[TraitRow] {
        &self.traits
    }

    /// Renders a view without noise; it need not be one of [`Self::views`].
    #[must_use]
    pub fn render_exact(&self, view: &SyntheticView) -> RenderedView {
        render(&self.model, &self.light, view)
    }

    /// Renders a view like [`Self::render_exact`], with the sensor noise of the options.
    #[must_use]
    pub fn render(&self, view: &SyntheticView) -> RenderedView {
        let mut rendered = self.render_exact(view);
        if let Some(noise) = &self.options.noise {
            spoil(
                &mut rendered,
                noise,
                self.options.seed.wrapping_add(view.index as u64),
            );
        }
        rendered
    }

    /// Samples points with their deepest labels on the exact surfaces.
    ///
    /// Normals point to the first camera that sees the point, or outwards if `min_views` is 0.
    ///
    /// # Errors
    /// Returns [`SceneError::Request`] if a spacing is out of range, and [`SceneError::Stopped`] if
    /// stopped.
    pub fn cloud(
        &self,
        options: &TruthOptions,
        progress: &Progress,
    ) -> Result<LabelledCloud, SceneError> {
        let source = TruthSource {
            model: &self.model,
            light: &self.light,
            views: &self.views,
            tree: &self.tree,
            seed: self.options.seed,
        };
        exact_cloud(&source, options, progress)
    }
}
