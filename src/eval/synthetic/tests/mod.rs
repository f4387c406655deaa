//! Tests of the synthetic scenes: dimensions, exactness, determinism.

mod exactness;
mod model;
mod output;
mod traits;

use super::*;
use ostra_core::job::Progress;
use ostra_masks::{LabelId, LabelTree};

/// Returns options for a tiller with few views and small images.
fn small(seed: u64) -> SceneOptions {
    SceneOptions {
        views: 4,
        width: 240,
        height: 320,
        seed,
        ..SceneOptions::default()
    }
}

fn built(options: &SceneOptions) -> Scene {
    Scene::build(options).unwrap()
}

/// Returns the class name (`stem`, `leaf`, …) of a label; empty if it has none.
fn class(tree: &LabelTree, id: LabelId) -> String {
    tree.get(tree.at_level(id, Scene::CLASS_LEVEL))
        .map_or_else(String::new, |label| label.name.clone())
}
