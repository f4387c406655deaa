use std::path::Path;

use glam::{DVec3, Vec3};

use super::meshes::tree;
use crate::formats::VoxelFormat;
use crate::ply::SavedColors;
use crate::{LabelledCloud, SceneError};
use ostra_core::job::Progress;
use ostra_masks::LabelId;

pub(super) const VOXEL: f64 = 0.05;

/// Returns voxels at these positions of the world grid, labelled 3, 7, 0, 3, 7 …
pub(super) fn voxels(places: &[[i32; 3]]) -> LabelledCloud {
    let middle = |&[x, y, z]: &[i32; 3]| {
        ((DVec3::new(x.into(), y.into(), z.into()) + 0.5) * VOXEL).as_vec3()
    };
    let mut voxels = LabelledCloud::from_positions(places.iter().map(middle).collect());
    voxels.labels = (0..places.len())
        .map(|at| LabelId([3, 7, 0][at % 3]))
        .collect();
    voxels.colors = (0..places.len()).map(|at| [at as u8, 100, 200]).collect();
    voxels.confidence = (0..places.len())
        .map(|at| 1.0 / (at as f32 + 1.0))
        .collect();
    voxels.normals.fill(Vec3::X);
    voxels.tree = tree();
    voxels
}

pub(super) fn saved(
    voxels: &LabelledCloud,
    name: &str,
    coloring: SavedColors,
) -> Result<Vec<u8>, SceneError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    VoxelFormat::of(Path::new(name))?.save(&path, voxels, VOXEL, coloring, &Progress::default())?;
    Ok(std::fs::read(path).unwrap())
}

#[test]
fn same_voxels_give_same_bytes_and_no_voxels_are_an_error() {
    let some = voxels(&[[0, 0, 0], [3, -2, 9], [4, 4, 4]]);
    for name in ["a.npz", "a.vox"] {
        assert_eq!(
            saved(&some, name, SavedColors::Image).unwrap(),
            saved(&some, name, SavedColors::Image).unwrap()
        );
        assert!(
            saved(&voxels(&[]), name, SavedColors::Image)
                .unwrap_err()
                .to_string()
                .contains("no voxels")
        );
    }
}
