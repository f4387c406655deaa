use glam::{DVec3, Vec2, Vec3};

use super::material::{Bitmap, Material};
use super::mesh::Mesh;
use ostra_cloud::measure::{Dimension, TraitRow};
use ostra_masks::{Label, LabelId, LabelTree};

/// All surfaces of a scene in one mesh, ready for rendering.
#[derive(Debug, Clone)]
pub(super) struct SceneMesh {
    pub(super) positions: Vec<DVec3>,
    pub(super) normals: Vec<Vec3>,
    pub(super) uv: Vec<Vec2>,
    pub(super) triangles: Vec<[u32; 3]>,
    /// Index into `looks` per triangle.
    pub(super) appearance_of: Vec<u16>,
    pub(super) appearances: Vec<PartAppearance>,
    pub(super) bitmaps: Vec<Bitmap>,
}

/// Label and material of a part.
#[derive(Debug, Clone)]
pub(super) struct PartAppearance {
    pub(super) label: LabelId,
    pub(super) material: Material,
    pub(super) seed: u32,
}

impl PartAppearance {
    /// Returns the linear RGB reflectance at a texture position (metres).
    pub(super) fn albedo(&self, uv: Vec2, bitmaps: &[Bitmap]) -> Vec3 {
        self.material.albedo(uv, self.seed, bitmaps)
    }
}

impl SceneMesh {
    /// Joins the parts of an assembly (at most 65 535); its tree and traits are left in place.
    pub(super) fn joined(assembly: &mut Assembly) -> Self {
        let mut whole = super::mesh::Mesh::default();
        let (mut appearance_of, mut appearances) = (Vec::new(), Vec::new());
        for part in std::mem::take(&mut assembly.parts) {
            appearance_of.resize(
                appearance_of.len() + part.mesh.triangles.len(),
                appearances.len() as u16,
            );
            appearances.push(PartAppearance {
                label: part.label,
                material: part.material,
                seed: part.seed,
            });
            whole.append(part.mesh);
        }
        Self {
            positions: whole.positions,
            normals: whole.normals,
            uv: whole.uv,
            triangles: whole.triangles,
            appearance_of,
            appearances,
            bitmaps: std::mem::take(&mut assembly.bitmaps),
        }
    }

    /// Returns the label and material of a triangle.
    pub(super) fn appearance(&self, triangle: usize) -> &PartAppearance {
        &self.appearances[usize::from(self.appearance_of[triangle])]
    }
}

/// A surface with one label and one material.
#[derive(Debug, Clone)]
pub(super) struct ScenePart {
    /// 0 for the surroundings.
    pub(super) label: LabelId,
    pub(super) material: Material,
    /// Seed that varies the material between parts.
    pub(super) seed: u32,
    pub(super) mesh: Mesh,
}

/// The output of a scene builder.
#[derive(Debug, Clone, Default)]
pub(super) struct Assembly {
    pub(super) parts: Vec<ScenePart>,
    pub(super) bitmaps: Vec<Bitmap>,
    pub(super) tree: LabelTree,
    pub(super) traits: Vec<TraitRow>,
}

impl Assembly {
    pub(super) fn add(&mut self, label: LabelId, material: Material, seed: u32, mesh: Mesh) {
        self.parts.push(ScenePart {
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
        value: f64,
        dimension: Dimension,
        definition: &'static str,
    ) {
        self.record_whole(id, name, value, dimension, definition);
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
        value: f64,
        dimension: Dimension,
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

    /// Adds a label below `parent`.
    ///
    /// Builders use each name once, so the tree always accepts it.
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
