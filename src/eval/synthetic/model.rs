use glam::{DVec3, Vec2, Vec3};

use super::bitmap::Bitmap;
use super::material::Material;
use super::part::Assembly;
use ostra_masks::LabelId;

/// All surfaces of a scene in one mesh, ready to be drawn.
#[derive(Debug, Clone)]
pub(super) struct Model {
    pub(super) positions: Vec<DVec3>,
    pub(super) normals: Vec<Vec3>,
    pub(super) uv: Vec<Vec2>,
    pub(super) triangles: Vec<[u32; 3]>,
    /// Per triangle, its entry in `looks`.
    pub(super) look_of: Vec<u16>,
    pub(super) looks: Vec<Look>,
    pub(super) bitmaps: Vec<Bitmap>,
}

/// Label and material of a part.
#[derive(Debug, Clone)]
pub(super) struct Look {
    pub(super) label: LabelId,
    pub(super) material: Material,
    pub(super) seed: u32,
}

impl Look {
    /// Linear RGB reflectance at a texture position (metres).
    pub(super) fn albedo(&self, uv: Vec2, bitmaps: &[Bitmap]) -> Vec3 {
        self.material.albedo(uv, self.seed, bitmaps)
    }
}

impl Model {
    /// Joins an assembly's parts (at most 65 535), leaving tree and traits with the caller.
    pub(super) fn joined(assembly: &mut Assembly) -> Self {
        let mut whole = super::mesh::Mesh::default();
        let (mut look_of, mut looks) = (Vec::new(), Vec::new());
        for part in std::mem::take(&mut assembly.parts) {
            look_of.resize(
                look_of.len() + part.mesh.triangles.len(),
                looks.len() as u16,
            );
            looks.push(Look {
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
            look_of,
            looks,
            bitmaps: std::mem::take(&mut assembly.bitmaps),
        }
    }

    /// The part that a triangle belongs to.
    pub(super) fn look(&self, triangle: usize) -> &Look {
        &self.looks[usize::from(self.look_of[triangle])]
    }
}
