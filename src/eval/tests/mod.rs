//! Tests of other crates' algorithms on synthetic scenes with known ground truth.

mod conflicts;
mod constrain;
mod correction;
mod surface;

use std::sync::Arc;

use ostra_cloud::SceneError;
use ostra_cloud::fuse::{FuseOptions, Fused, Views, fuse};
use ostra_core::job::Progress;
use ostra_frames::{DepthMap, Frame, Image, ImageSource, Orientation};
use ostra_masks::{LabelId, LabelMask};

use crate::synthetic::{RenderedView, Scene, SceneOptions};

/// A rendered synthetic scene, with ground truth masks that a test may change.
struct Rendered {
    scene: Scene,
    frames: Vec<Frame>,
    views: Vec<RenderedView>,
    masks: Vec<LabelMask>,
}

impl Rendered {
    /// Renders all views; masks contain labels down to `level`, or all levels.
    fn new(options: &SceneOptions, level: Option<usize>) -> Self {
        let scene = Scene::build(options).unwrap();
        let views: Vec<RenderedView> = scene
            .views()
            .iter()
            .map(|view| scene.render(view))
            .collect();
        let frame = |(name, view): (String, &RenderedView)| Frame {
            name,
            width: view.image.width,
            height: view.image.height,
            image: ImageSource::File {
                path: "none".into(),
                orientation: Orientation(1),
            },
            depth: None,
            camera: Some(view.camera),
        };
        let names = scene.views().iter().map(|view| view.name.clone());
        let frames = names.zip(&views).map(frame).collect();
        let id_at = |id: LabelId| level.map_or(id, |level| scene.tree().at_level(id, level));
        let mask = |view: &RenderedView| {
            let ids = view.mask.ids.iter().map(|&id| id_at(id)).collect();
            LabelMask { ids, ..view.mask }
        };
        Self {
            masks: views.iter().map(mask).collect(),
            frames,
            views,
            scene,
        }
    }

    fn label(&self, name: &str) -> LabelId {
        self.scene.tree().by_name(name).unwrap().id
    }

    fn fused(&self) -> Fused {
        fuse(
            self,
            self.scene.tree(),
            &FuseOptions::default(),
            &Progress::default(),
        )
        .unwrap()
    }
}

impl Views for Rendered {
    fn frames(&self) -> &[Frame] {
        &self.frames
    }

    fn has_depth(&self, _: usize) -> bool {
        true
    }

    fn image(&self, index: usize) -> Result<Arc<Image>, SceneError> {
        Ok(Arc::new(self.views[index].image.clone()))
    }

    fn depth(&self, index: usize) -> Result<Option<Arc<DepthMap>>, SceneError> {
        Ok(Some(Arc::new(self.views[index].depth.clone())))
    }

    fn mask(&self, index: usize) -> Option<Arc<LabelMask>> {
        Some(Arc::new(self.masks[index].clone()))
    }
}
