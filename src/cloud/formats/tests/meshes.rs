use std::path::Path;

use glam::Vec3;

use crate::formats::{MeshFormat, VoxelFormat};
use crate::ply::SavedColors;
use crate::{LabelledCloud, LabelledMesh};
use ostra_core::job::Progress;
use ostra_masks::{Label, LabelId, LabelTree};

/// Returns a plant (7) with a leaf (3) whose name has characters that file names cannot hold.
pub(super) fn tree() -> LabelTree {
    let mut tree = LabelTree::default();
    let label = |id, name: &str, color, parent| Label {
        id: LabelId(id),
        name: name.into(),
        color,
        parent,
    };
    tree.set(label(7, "the plant", [0, 51, 255], None)).unwrap();
    tree.set(label(3, "feuille été", [255, 102, 0], Some(LabelId(7))))
        .unwrap();
    tree
}

/// Returns two triangles of a leaf, one of the plant and one unlabelled.
///
/// Triangles of different labels have no common vertices.
pub(super) fn mesh() -> LabelledMesh {
    let places = [
        [0.0, 0.0, 1.0],
        [1.0, 0.0, 1.0],
        [1.0, 1.0, 1.5],
        [0.0, 1.0, 1.1],
    ]
    .map(Vec3::from);
    let mut vertices = LabelledCloud {
        tree: tree(),
        ..LabelledCloud::default()
    };
    for (id, shift) in [(3, 0.0), (7, -2.5), (0, 4.0)] {
        for place in places {
            vertices.positions.push(place + Vec3::X * shift);
            vertices.normals.push(-Vec3::Z);
            vertices.colors.push([place.x as u8 * 200, 3, id as u8]);
            vertices.labels.push(LabelId(id));
            vertices.confidence.push(0.5 + place.y / 4.0);
        }
    }
    LabelledMesh {
        vertices,
        triangles: vec![[4, 5, 6], [0, 1, 2], [0, 2, 3], [8, 9, 10]],
    }
}

pub(super) fn saved(mesh: &LabelledMesh, path: &Path, coloring: SavedColors) -> Vec<u8> {
    MeshFormat::of(path)
        .unwrap()
        .save(path, mesh, coloring, &Progress::default())
        .unwrap();
    std::fs::read(path).unwrap()
}

#[test]
fn extension_selects_the_format_and_errors_list_all() {
    assert_eq!(
        MeshFormat::of(Path::new("a/B.OBJ")).unwrap(),
        MeshFormat::Obj
    );
    assert_eq!(
        VoxelFormat::of(Path::new("v.npz")).unwrap(),
        VoxelFormat::Npz
    );
    let wrong = |path: &str| MeshFormat::of(Path::new(path)).unwrap_err().to_string();
    assert_eq!(
        wrong("a/b.stl"),
        "a/b.stl: a mesh cannot be written under this ending; give a name that ends in .ply, .obj or .glb"
    );
    assert!(wrong("mesh").contains(".glb"));
    assert!(
        VoxelFormat::of(Path::new("v.obj"))
            .unwrap_err()
            .to_string()
            .contains(".ply, .npz or .vox")
    );
}

#[test]
fn same_mesh_gives_same_bytes_and_no_other_files() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.ply", "a.obj", "a.glb"] {
        let path = folder.path().join(name);
        assert!(
            saved(&mesh(), &path, SavedColors::Image) == saved(&mesh(), &path, SavedColors::Image),
            "{name}"
        );
        assert!(
            saved(&mesh(), &path, SavedColors::Image) != saved(&mesh(), &path, SavedColors::Labels),
            "{name}"
        );
    }
    let mut names: Vec<_> = std::fs::read_dir(folder.path())
        .unwrap()
        .map(|entry| entry.unwrap().file_name())
        .collect();
    names.sort();
    assert_eq!(names, ["a.glb", "a.mtl", "a.obj", "a.ply"]);
}

#[test]
fn stopped_save_leaves_the_old_file() {
    let folder = tempfile::tempdir().unwrap();
    let stopped = Progress::default();
    stopped.stop();
    for name in ["a.obj", "a.glb"] {
        let path = folder.path().join(name);
        let before = saved(&mesh(), &path, SavedColors::Image);
        assert!(
            MeshFormat::of(&path)
                .unwrap()
                .save(&path, &mesh(), SavedColors::Labels, &stopped)
                .is_err()
        );
        assert!(std::fs::read(&path).unwrap() == before, "{name}");
    }
}
