//! Arrangement of the panes in the middle of the window.

use egui_tiles::{Container, Linear, LinearDir, Tile, TileId, Tiles, Tree};
use serde::{Deserialize, Serialize};

/// Content of a tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Pane {
    /// Image of the shown frame.
    Image,
    /// 3-D view.
    Scene,
    /// Table of traits.
    Traits,
}

/// Arrangement of the panes, with their shares of the space.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Arrangement(pub(super) Tree<Pane>);

impl Default for Arrangement {
    fn default() -> Self {
        let mut tiles = Tiles::default();
        let views = [Pane::Image, Pane::Scene].map(|pane| tiles.insert_pane(pane));
        let traits = tiles.insert_pane(Pane::Traits);
        let views = Linear::new_binary(LinearDir::Horizontal, views, 0.5);
        let views = tiles.insert_container(Container::Linear(views));
        let all = Linear::new_binary(LinearDir::Vertical, [views, traits], 0.65);
        let root = tiles.insert_container(Container::Linear(all));
        Self(Tree::new(egui::Id::unique("panes"), root, tiles))
    }
}

impl Arrangement {
    fn tile(&self, pane: Pane) -> Option<TileId> {
        self.0.tiles.find_pane(&pane)
    }

    /// Replaces an arrangement in which a pane is missing, which a damaged file of preferences has.
    pub(super) fn repair(&mut self) {
        let is_whole = [Pane::Image, Pane::Scene, Pane::Traits]
            .into_iter()
            .all(|pane| self.tile(pane).is_some());
        if !is_whole {
            *self = Self::default();
        }
    }

    pub(super) fn show_only(&mut self, shown: impl Fn(Pane) -> bool) {
        for pane in [Pane::Image, Pane::Scene, Pane::Traits] {
            if let Some(id) = self.tile(pane) {
                self.0.set_visible(id, shown(pane));
            }
        }
    }

    /// Swaps the places of the image and the 3-D view.
    pub(super) fn swap(&mut self) {
        self.repair();
        let (Some(image), Some(scene)) = (self.tile(Pane::Image), self.tile(Pane::Scene)) else {
            return;
        };
        for (id, pane) in [(image, Pane::Scene), (scene, Pane::Image)] {
            if let Some(tile) = self.0.tiles.get_mut(id) {
                *tile = Tile::Pane(pane);
            }
        }
    }

    /// Returns whether image and 3-D view are on top of each other.
    pub(super) fn is_stacked(&self) -> bool {
        let parent = self
            .tile(Pane::Image)
            .and_then(|image| self.0.tiles.parent_of(image));
        matches!(
            parent.and_then(|id| self.0.tiles.get(id)),
            Some(Tile::Container(Container::Linear(linear))) if linear.dir == LinearDir::Vertical
        )
    }

    /// Places image and 3-D view on top of each other, or side by side again.
    pub(super) fn turn(&mut self) {
        self.repair();
        let parent = self
            .tile(Pane::Image)
            .and_then(|image| self.0.tiles.parent_of(image));
        match parent.and_then(|id| self.0.tiles.get_mut(id)) {
            Some(Tile::Container(Container::Linear(linear))) => {
                linear.dir = match linear.dir {
                    LinearDir::Horizontal => LinearDir::Vertical,
                    LinearDir::Vertical => LinearDir::Horizontal,
                };
            }
            _ => *self = Self::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrangement_is_stored_and_a_damaged_one_replaced() {
        let mut moved = Arrangement::default();
        moved.turn();
        moved.swap();
        let text = serde_json::to_string(&moved).unwrap();
        let read: Arrangement = serde_json::from_str(&text).unwrap();
        assert_eq!(read, moved);
        assert_ne!(read, Arrangement::default());
        let mut broken = Arrangement(Tree::empty(egui::Id::unique("broken")));
        broken.repair();
        assert!(broken.tile(Pane::Scene).is_some());
    }
}
