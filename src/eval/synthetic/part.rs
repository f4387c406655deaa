use super::bitmap::Bitmap;
use super::material::Material;
use super::mesh::Mesh;
use ostra_cloud::measure::{Dimension, TraitRow};
use ostra_masks::{Label, LabelId, LabelTree};

/// A surface of one label and one material.
#[derive(Debug, Clone)]
pub(super) struct Part {
    /// 0 for the surroundings.
    pub(super) label: LabelId,
    pub(super) material: Material,
    /// Varies the material from part to part.
    pub(super) seed: u32,
    pub(super) mesh: Mesh,
}

/// What a builder of a scene hands over.
#[derive(Debug, Clone, Default)]
pub(super) struct Assembly {
    pub(super) parts: Vec<Part>,
    pub(super) bitmaps: Vec<Bitmap>,
    pub(super) tree: LabelTree,
    pub(super) traits: Vec<TraitRow>,
}

impl Assembly {
    pub(super) fn add(&mut self, label: LabelId, material: Material, seed: u32, mesh: Mesh) {
        self.parts.push(Part {
            label,
            material,
            seed,
            mesh,
        });
    }

    /// Adds an exact trait of the only instance of a label.
    pub(super) fn record(
        &mut self,
        id: LabelId,
        name: &'static str,
        value: (f64, Dimension),
        definition: &'static str,
    ) {
        self.record_whole(id, name, value, definition);
        self.traits
            .iter_mut()
            .last()
            .into_iter()
            .for_each(|row| row.instance = 1);
    }

    /// Adds an exact trait of a label as a whole.
    pub(super) fn record_whole(
        &mut self,
        id: LabelId,
        name: &'static str,
        (value, dimension): (f64, Dimension),
        definition: &'static str,
    ) {
        let label = self
            .tree
            .get(id)
            .map_or_else(String::new, |label| label.name.clone());
        let path = TraitRow::path_of(&self.tree, id);
        let (name, definition) = (name.into(), definition.into());
        self.traits.push(TraitRow {
            id,
            label,
            path,
            instance: 0,
            name,
            value,
            dimension,
            definition,
            points: 0,
        });
    }

    /// Adds a label below `parent`. Builders give every name once, so the tree takes it.
    pub(super) fn label(&mut self, name: &str, parent: Option<LabelId>) -> LabelId {
        let id = self.tree.next_id();
        let added = self.tree.set(Label {
            id,
            name: name.to_owned(),
            color: LabelTree::color_for(id),
            parent,
        });
        debug_assert!(added.is_ok(), "{added:?}");
        id
    }
}
