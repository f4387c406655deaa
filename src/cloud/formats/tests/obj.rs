use std::collections::BTreeMap;

use glam::Vec3;

use super::meshes::{mesh, saved};
use crate::ply::SavedColors;
use crate::{LabelledMesh, UNLABELLED_COLOR};

/// The content of an OBJ file.
///
/// It has positions with colours, normals, and the faces of each object and material.
#[derive(Default)]
struct Obj {
    library: String,
    vertices: Vec<[f32; 6]>,
    normals: Vec<[f32; 3]>,
    faces: BTreeMap<(String, String), Vec<[usize; 3]>>,
}

fn read(bytes: &[u8]) -> Obj {
    let mut obj = Obj::default();
    let (mut object, mut material) = (String::new(), String::new());
    let floats = |words: &str| {
        words
            .split(' ')
            .map(|word| word.parse().unwrap())
            .collect::<Vec<f32>>()
    };
    for line in std::str::from_utf8(bytes).unwrap().lines() {
        match line.split_once(' ').unwrap() {
            ("#", _) => (),
            ("mtllib", name) => obj.library = name.into(),
            ("o", name) => object = name.into(),
            ("usemtl", name) => material = name.into(),
            ("v", words) => obj.vertices.push(floats(words).try_into().unwrap()),
            ("vn", words) => obj.normals.push(floats(words).try_into().unwrap()),
            ("f", words) => {
                let corner = |word: &str| {
                    let (vertex, normal) = word.split_once("//").unwrap();
                    assert_eq!(vertex, normal);
                    vertex.parse::<usize>().unwrap() - 1
                };
                let face: Vec<usize> = words.split(' ').map(corner).collect();
                obj.faces
                    .entry((object.clone(), material.clone()))
                    .or_default()
                    .push(face.try_into().unwrap());
            }
            (word, _) => panic!("{word}"),
        }
    }
    obj
}

fn written(mesh: &LabelledMesh, coloring: SavedColors) -> (Obj, String) {
    let folder = tempfile::tempdir().unwrap();
    let obj = read(&saved(mesh, &folder.path().join("my mesh.obj"), coloring));
    let materials = std::fs::read_to_string(folder.path().join(&obj.library)).unwrap();
    (obj, materials)
}

#[test]
fn each_label_is_an_object_with_its_faces() {
    let (obj, materials) = written(&mesh(), SavedColors::Image);
    assert_eq!(obj.library, "my_mesh.mtl");
    let names = ["the_plant", "the_plant/feuille_été", "unlabelled"];
    assert_eq!(
        obj.faces
            .keys()
            .map(|(object, _)| object.as_str())
            .collect::<Vec<_>>(),
        names
    );
    assert!(
        obj.faces
            .keys()
            .all(|(object, material)| object == material)
    );
    assert_eq!(
        obj.faces.values().map(Vec::len).collect::<Vec<_>>(),
        [1, 2, 1]
    );
    assert!(
        materials.contains("newmtl the_plant/feuille_été\nKd 1.0000 0.4000 0.0000\n"),
        "{materials}"
    );
    assert_eq!(materials.matches("newmtl").count(), 3);
    assert_eq!(
        (obj.vertices.len(), obj.normals.len()),
        (10, 10),
        "each label's used vertices"
    );

    let whole = mesh();
    let corner = |at: usize| Vec3::from_slice(&obj.vertices[at][..3]);
    let leaf = &obj.faces[&(names[1].into(), names[1].into())];
    for (face, triangle) in leaf.iter().zip(&whole.triangles[1..3]) {
        assert_eq!(
            face.map(corner),
            triangle.map(|at| whole.vertices.positions[at as usize])
        );
    }
    let [_, _, _, red, green, blue] = obj.vertices[leaf[0][1]];
    assert_eq!(
        [red, green, blue].map(|channel| (channel * 255.0).round() as u8),
        [200, 3, 3]
    );
    assert_eq!(obj.normals[leaf[0][1]], [0.0, 0.0, -1.0]);
}

#[test]
fn label_coloring_writes_label_colours() {
    let (obj, _) = written(&mesh(), SavedColors::Labels);
    let plain = &obj.faces[&("unlabelled".into(), "unlabelled".into())];
    let color: Vec<u8> = obj.vertices[plain[0][0]][3..]
        .iter()
        .map(|channel| (channel * 255.0).round() as u8)
        .collect();
    assert_eq!(color, UNLABELLED_COLOR);
}

#[test]
fn labels_with_colliding_names_get_unique_objects() {
    let mut mesh = mesh();
    let leaf = mesh
        .vertices
        .tree
        .get(ostra_masks::LabelId(3))
        .unwrap()
        .clone();
    mesh.vertices
        .tree
        .set(ostra_masks::Label {
            name: "the-plant?".into(),
            parent: None,
            ..leaf.clone()
        })
        .unwrap();
    mesh.vertices
        .tree
        .rename(ostra_masks::LabelId(7), "the-plant!")
        .unwrap();
    let (obj, materials) = written(&mesh, SavedColors::Image);
    assert!(
        obj.faces
            .contains_key(&("the-plant_".into(), "the-plant_".into()))
    );
    assert!(
        obj.faces
            .contains_key(&("the-plant__7".into(), "the-plant__7".into()))
    );
    assert!(materials.contains("newmtl the-plant__7\nKd 0.0000 0.2000 1.0000\n"));
}
