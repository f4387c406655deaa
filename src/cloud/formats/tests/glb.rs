use glam::{Quat, Vec3};
use serde_json::Value;

use super::meshes::{mesh, saved};
use crate::LabelledMesh;
use crate::formats::MeshFormat;
use crate::ply::SavedColors;
use ostra_core::job::Progress;

/// A GLB split into header JSON and binary chunk, as the standard defines.
struct Glb {
    head: Value,
    binary: Vec<u8>,
}

fn number(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
}

fn read(bytes: &[u8]) -> Glb {
    assert_eq!(
        (&bytes[..4], number(bytes, 4), number(bytes, 8)),
        (&b"glTF"[..], 2, bytes.len())
    );
    let length = number(bytes, 12);
    assert_eq!((&bytes[16..20], length % 4), (&b"JSON"[..], 0));
    let head = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    let rest = &bytes[20 + length..];
    assert_eq!(
        (number(rest, 0), &rest[4..8]),
        (rest.len() - 8, &b"BIN\0"[..])
    );
    let binary = rest[8..].to_vec();
    Glb { head, binary }
}

impl Glb {
    /// Returns the entries of an accessor, with one number per component.
    fn entries(&self, accessor: &Value) -> Vec<Vec<f64>> {
        let of = |value: &Value, key: &str| value[key].as_u64().unwrap() as usize;
        let accessor = &self.head["accessors"][accessor.as_u64().unwrap() as usize];
        let view = &self.head["bufferViews"][of(accessor, "bufferView")];
        let width = match accessor["type"].as_str().unwrap() {
            "SCALAR" => 1,
            "VEC3" => 3,
            "VEC4" => 4,
            other => panic!("{other}"),
        };
        let (size, read): (usize, fn(&[u8]) -> f64) = match of(accessor, "componentType") {
            5123 => (2, |bytes| {
                f64::from(u16::from_le_bytes(bytes.try_into().unwrap()))
            }),
            5125 => (4, |bytes| {
                f64::from(u32::from_le_bytes(bytes.try_into().unwrap()))
            }),
            5126 => (4, |bytes| {
                f64::from(f32::from_le_bytes(bytes.try_into().unwrap()))
            }),
            other => panic!("{other}"),
        };
        let stride = view["byteStride"]
            .as_u64()
            .map_or(size * width, |stride| stride as usize);
        let start = of(accessor, "byteOffset");
        assert!(
            start.is_multiple_of(size)
                && (view["byteStride"].is_null()
                    || (stride.is_multiple_of(4) && start.is_multiple_of(4)))
        );
        let bytes = &self.binary[of(view, "byteOffset")..][..of(view, "byteLength")];
        let entry = |at: usize| {
            let bytes = &bytes[start + at * stride..][..size * width];
            bytes.chunks(size).map(read).collect()
        };
        (0..of(accessor, "count")).map(entry).collect()
    }
}

fn written(mesh: &LabelledMesh, coloring: SavedColors) -> Glb {
    let folder = tempfile::tempdir().unwrap();
    read(&saved(mesh, &folder.path().join("mesh.glb"), coloring))
}

fn to_srgb(linear: f64) -> f64 {
    if linear <= 0.003_130_8 {
        linear * 12.92
    } else {
        1.055 * linear.powf(1.0 / 2.4) - 0.055
    }
}

#[test]
fn each_label_is_a_node_with_its_properties() {
    let glb = written(&mesh(), SavedColors::Image);
    let nodes = glb.head["nodes"].as_array().unwrap();
    assert_eq!(glb.head["scenes"][0]["nodes"], serde_json::json!([0]));
    assert_eq!(nodes[0]["children"], serde_json::json!([1, 2, 3]));
    let names: Vec<&str> = nodes[1..]
        .iter()
        .map(|node| node["name"].as_str().unwrap())
        .collect();
    assert_eq!(names, ["unlabelled", "the plant/feuille été", "the plant"]);
    let extras = serde_json::json!({ "label": 3, "name": "feuille été", "parent": 7, "color": [255, 102, 0] });
    assert_eq!(nodes[2]["extras"], extras);
    assert_eq!(nodes[1]["extras"]["parent"], Value::Null);
    let primitive =
        &glb.head["meshes"][nodes[2]["mesh"].as_u64().unwrap() as usize]["primitives"][0];
    let material = &glb.head["materials"][primitive["material"].as_u64().unwrap() as usize];
    assert_eq!(
        (material["name"].as_str(), material["doubleSided"].as_bool()),
        (Some(names[1]), Some(true))
    );
    assert_eq!(
        glb.head["buffers"][0]["byteLength"].as_u64().unwrap() as usize,
        glb.binary.len()
    );
}

#[test]
fn geometry_survives_a_round_trip_per_label() {
    let mesh = mesh();
    let glb = written(&mesh, SavedColors::Image);
    for (at, (id, part)) in mesh.by_label().into_iter().enumerate() {
        let primitive = &glb.head["meshes"][at]["primitives"][0];
        let column = |name: &str| glb.entries(&primitive["attributes"][name]);
        let floats = |of: &[Vec3]| {
            of.iter()
                .map(|v| v.as_dvec3().to_array().to_vec())
                .collect::<Vec<_>>()
        };
        assert_eq!(column("POSITION"), floats(&part.vertices.positions));
        assert_eq!(column("NORMAL"), floats(&part.vertices.normals));
        assert!(
            column("_LABEL")
                .iter()
                .all(|label| label[0] == f64::from(id.0))
        );
        let confidence: Vec<f32> = column("_CONFIDENCE")
            .iter()
            .map(|share| share[0] as f32)
            .collect();
        assert_eq!(confidence, part.vertices.confidence);
        let color = |linear: &Vec<f64>| {
            [0, 1, 2].map(|at| (to_srgb(linear[at] / 65535.0) * 255.0).round() as u8)
        };
        assert_eq!(
            column("COLOR_0").iter().map(color).collect::<Vec<_>>(),
            part.vertices.colors
        );
        let indices: Vec<u32> = glb
            .entries(&primitive["indices"])
            .iter()
            .map(|index| index[0] as u32)
            .collect();
        assert_eq!(indices, part.triangles.as_flattened());
        let positions =
            &glb.head["accessors"][primitive["attributes"]["POSITION"].as_u64().unwrap() as usize];
        let most = part
            .vertices
            .positions
            .iter()
            .copied()
            .reduce(Vec3::max)
            .unwrap()
            .as_dvec3();
        assert_eq!(positions["max"], serde_json::json!(most.to_array()));
    }
}

#[test]
fn colors_survive_conversion_to_linear_light() {
    let mut mesh = mesh();
    mesh.triangles = vec![[0, 1, 2]];
    for channel in 0..=u8::MAX {
        mesh.vertices.colors[0] = [channel; 3];
        let glb = written(&mesh, SavedColors::Image);
        let color =
            &glb.entries(&glb.head["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"])[0];
        assert_eq!((to_srgb(color[0] / 65535.0) * 255.0).round() as u8, channel);
        assert_eq!(color[3], 65535.0, "opaque");
    }
}

#[test]
fn root_rotation_keeps_up_upwards() {
    let glb = written(&mesh(), SavedColors::Image);
    let turn: [f32; 4] = serde_json::from_value(glb.head["nodes"][0]["rotation"].clone()).unwrap();
    let turn = Quat::from_array(turn);
    assert!(
        (turn * -Vec3::Y).abs_diff_eq(Vec3::Y, 1e-6),
        "the world's y looks down, glTF's up"
    );
    assert!(
        (turn * -Vec3::Z).abs_diff_eq(Vec3::Z, 1e-6),
        "what faces the first camera faces glTF's viewer"
    );
}

#[test]
fn unknown_normals_become_unit_and_empty_mesh_is_an_error() {
    let mut mesh = mesh();
    mesh.vertices.normals.fill(Vec3::ZERO);
    let glb = written(&mesh, SavedColors::Image);
    let normals = glb.entries(&glb.head["meshes"][0]["primitives"][0]["attributes"]["NORMAL"]);
    assert!(
        normals
            .iter()
            .all(|normal| normal.iter().map(|along| along * along).sum::<f64>() == 1.0)
    );
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("empty.glb");
    let empty = LabelledMesh::default();
    let error = MeshFormat::Glb
        .save(&path, &empty, SavedColors::Image, &Progress::default())
        .unwrap_err();
    assert!(error.to_string().contains("no triangles"));
}
