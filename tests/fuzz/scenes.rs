//! Fuzz targets for clouds and meshes.

use ostra_cloud::ply::{read_mesh, read_ply};
use ostra_core::job::Progress;

use crate::harness::fuzz;
use crate::seeds;

#[test]
fn clouds() {
    fuzz!("PLY clouds", 20_000, seeds::clouds(), |folder, seed| {
        if let Ok(read) = read_ply(&folder.join(&seed.path), &Progress::default()) {
            let cloud = read.cloud;
            let count = cloud.len();
            assert!(
                [
                    cloud.normals.len(),
                    cloud.colors.len(),
                    cloud.labels.len(),
                    cloud.confidence.len()
                ] == [count; 4]
            );
        }
    });
}

#[test]
fn meshes() {
    fuzz!("PLY meshes", 20_000, seeds::meshes(), |folder, seed| {
        if let Ok(mesh) = read_mesh(&folder.join(&seed.path), &Progress::default()) {
            assert!(
                mesh.triangles
                    .iter()
                    .flatten()
                    .all(|&corner| (corner as usize) < mesh.vertices.len())
            );
        }
    });
}
