use glam::DVec3;

use super::bricks::build_bricks;
use super::model::Model;
use super::options::{SceneKind, SceneOptions};
use super::render::{Light, render};
use super::tiller::build_tiller;
use super::truth::{TruthOptions, exact_cloud};
use super::view::{RenderedView, View, arc_of_views, spoil};
use ostra_cloud::measure::TraitRow;
use ostra_cloud::{LabelledCloud, SceneError};
use ostra_core::job::Progress;
use ostra_masks::{Label, LabelId, LabelTree};

/// A made scene: surfaces with labels and materials, cameras, and every dimension known. World units are metres, z is
/// up, the specimen stands on z = 0 at the origin.
#[derive(Debug, Clone)]
pub struct Scene {
    options: SceneOptions,
    pub(super) model: Model,
    light: Light,
    pub(super) views: Vec<View>,
    tree: LabelTree,
    traits: Vec<TraitRow>,
}

impl Scene {
    /// Depth in the label tree of the classes a user would label (`stem`, `leaf`, `panicle`; `car`, `wheel`, `figure`); the
    /// specimen is above, instances and their parts are below.
    pub const CLASS_LEVEL: usize = 2;

    /// Depth of parts in the label tree.
    pub const PART_LEVEL: usize = 4;

    /// Makes the scene; the same options give the same scene.
    ///
    /// # Errors
    /// [`SceneError::Request`] for an option out of range.
    pub fn build(options: &SceneOptions) -> Result<Self, SceneError> {
        options.check()?;
        let mut assembly = match options.scene {
            SceneKind::Tiller => build_tiller(options.seed),
            SceneKind::Bricks => build_bricks(options.seed),
        };
        let model = Model::joined(&mut assembly);
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

    /// What the scene was made from.
    #[must_use]
    pub fn options(&self) -> &SceneOptions {
        &self.options
    }

    /// The cameras, in order along the arc.
    #[must_use]
    pub fn views(&self) -> &[View] {
        &self.views
    }

    /// The labels: specimen › class › instance (› part).
    #[must_use]
    pub fn tree(&self) -> &LabelTree {
        &self.tree
    }

    /// What a user would click: the classes of a plant; the parts of toys, and their wheels as one class.
    #[must_use]
    pub fn clicked_labels(&self) -> Vec<LabelId> {
        let told_apart = self.classes_told_apart();
        let is_clicked = |label: &&Label| match self.options.scene {
            SceneKind::Tiller => self.tree.depth(label.id) == Self::CLASS_LEVEL,
            SceneKind::Bricks => {
                told_apart.contains(&label.name) || self.tree.depth(label.id) == Self::PART_LEVEL
            }
        };
        self.tree
            .iter()
            .filter(is_clicked)
            .map(|label| label.id)
            .collect()
    }

    /// Names of classes that a user clicks as one and whose instances are told apart by what hangs together.
    #[must_use]
    pub fn classes_told_apart(&self) -> Vec<String> {
        match self.options.scene {
            SceneKind::Tiller => Vec::new(),
            SceneKind::Bricks => vec!["wheel".into()],
        }
    }

    /// The exact traits, metres.
    #[must_use]
    pub fn traits(&self) -> &[TraitRow] {
        &self.traits
    }

    /// What a camera sees, without noise. The view need not be one of [`Self::views`].
    #[must_use]
    pub fn render_exact(&self, view: &View) -> RenderedView {
        render(&self.model, &self.light, view)
    }

    /// What a camera records: as [`Self::render_exact`], with the sensor noise of the options.
    #[must_use]
    pub fn render(&self, view: &View) -> RenderedView {
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

    /// Points on the exact surfaces with their deepest labels. Normals point to the first camera that sees the point
    /// (outwards where `min_views` is 0).
    ///
    /// # Errors
    /// [`SceneError::Request`] for a spacing out of range, [`SceneError::Stopped`].
    pub fn cloud(
        &self,
        options: &TruthOptions,
        progress: &Progress,
    ) -> Result<LabelledCloud, SceneError> {
        let scene = (&self.model, &self.light, &self.tree);
        exact_cloud(scene, (&self.views, self.options.seed), options, progress)
    }
}
