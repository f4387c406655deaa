use std::io::Write;
use std::path::Path;

use glam::Vec3;
use serde_json::{Value, json};

use super::labels::{color_of, path_name};
use crate::ply::{SavedColors, label_name};
use crate::whole_file::{unplaced, write_whole};
use crate::{LabelledMesh, SceneError};
use ostra_core::job::Progress;
use ostra_masks::{LabelId, LabelTree};

/// Component types of glTF 2.0.
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const FLOAT: u32 = 5126;

/// Layout of one column of the binary chunk.
struct BinaryColumn {
    name: &'static str,
    component: u32,
    shape: &'static str,
    normalized: bool,
    /// Bytes per entry, including padding.
    stride: usize,
}

/// Columns in file order. Within each column the entries of one label are contiguous.
const COLUMNS: [BinaryColumn; 6] = [
    BinaryColumn {
        name: "POSITION",
        component: FLOAT,
        shape: "VEC3",
        normalized: false,
        stride: 12,
    },
    BinaryColumn {
        name: "NORMAL",
        component: FLOAT,
        shape: "VEC3",
        normalized: false,
        stride: 12,
    },
    BinaryColumn {
        name: "COLOR_0",
        component: UNSIGNED_SHORT,
        shape: "VEC4",
        normalized: true,
        stride: 8,
    },
    BinaryColumn {
        name: "_LABEL",
        component: UNSIGNED_SHORT,
        shape: "SCALAR",
        normalized: false,
        stride: 4,
    },
    BinaryColumn {
        name: "_CONFIDENCE",
        component: FLOAT,
        shape: "SCALAR",
        normalized: false,
        stride: 4,
    },
    BinaryColumn {
        name: "indices",
        component: UNSIGNED_INT,
        shape: "SCALAR",
        normalized: false,
        stride: 4,
    },
];

/// Writes a mesh as binary glTF 2.0 (Khronos Group, 2017).
///
/// A root node rotates the world axes (x right, y down, z forward) into those of glTF (y up). Below
/// it there is a node, a mesh and a material per label, named after the label's path. Vertices have
/// positions in world units, normals, linear colours, `_LABEL` and `_CONFIDENCE`. Colours have 16
/// bits so that dark ones remain distinct. The `extras` of a node hold the label's id, name, parent
/// and colour.
pub(super) fn save(
    path: &Path,
    mesh: &LabelledMesh,
    coloring: SavedColors,
    progress: &Progress,
) -> Result<(), SceneError> {
    if mesh.triangles.is_empty() {
        return Err(SceneError::Request(
            "the mesh has no triangles; there is nothing to write as GLB".into(),
        ));
    }
    let parts = mesh.by_label();
    let mut columns: [Vec<u8>; 6] = Default::default();
    let mut accessors = Vec::new();
    for (at, part) in parts.values().enumerate() {
        progress.step(at, parts.len())?;
        accessors.extend(accessors_of(part, &columns));
        fill(&mut columns, part, coloring);
    }
    let ids: Vec<LabelId> = parts.into_keys().collect();
    let head = head(&mesh.vertices.tree, &ids, &accessors, &columns);
    write_whole(path, |out| {
        write(out, head.to_string().into_bytes(), &columns, progress)
    })
}

/// Writes the GLB container: a 12-byte header, the JSON chunk and the binary chunk.
fn write(
    out: &mut impl Write,
    mut head: Vec<u8>,
    columns: &[Vec<u8>],
    progress: &Progress,
) -> Result<(), SceneError> {
    head.resize(head.len().next_multiple_of(4), b' ');
    let binary: usize = columns.iter().map(Vec::len).sum();
    let too_large =
        "the mesh takes more than the 4 GiB that a GLB can hold; keep fewer triangles or write PLY";
    let whole = u32::try_from(12 + 8 + head.len() + 8 + binary)
        .map_err(|_| SceneError::Request(too_large.into()))?;
    let mut start = Vec::new();
    start.extend_from_slice(b"glTF");
    [2, whole, head.len() as u32]
        .iter()
        .for_each(|number| start.extend_from_slice(&number.to_le_bytes()));
    start.extend_from_slice(b"JSON");
    start.extend_from_slice(&head);
    start.extend_from_slice(&(binary as u32).to_le_bytes());
    start.extend_from_slice(b"BIN\0");
    for piece in std::iter::once(&start).chain(columns) {
        progress.check()?;
        out.write_all(piece).map_err(unplaced)?;
    }
    Ok(())
}

/// Returns the accessors of the label whose entries are appended to `columns` next.
fn accessors_of(part: &LabelledMesh, columns: &[Vec<u8>; 6]) -> Vec<Value> {
    let accessor = |(view, (column, bytes)): (usize, (&BinaryColumn, &Vec<u8>))| {
        let is_index = column.name == "indices";
        let count = if is_index {
            part.triangles.len() * 3
        } else {
            part.vertices.len()
        };
        let mut value = json!({
            "bufferView": view, "byteOffset": bytes.len(), "componentType": column.component,
            "count": count, "type": column.shape, "normalized": column.normalized,
        });
        if column.name == "POSITION" {
            let positions = || part.vertices.positions.iter().copied();
            let bound = |of: fn(Vec3, Vec3) -> Vec3| {
                positions()
                    .reduce(of)
                    .unwrap_or_default()
                    .as_dvec3()
                    .to_array()
            };
            (value["min"], value["max"]) = (json!(bound(Vec3::min)), json!(bound(Vec3::max)));
        }
        value
    };
    COLUMNS
        .iter()
        .zip(columns)
        .enumerate()
        .map(accessor)
        .collect()
}

fn fill(columns: &mut [Vec<u8>; 6], part: &LabelledMesh, coloring: SavedColors) {
    let vertices = &part.vertices;
    let [positions, normals, colors, labels, confidences, indices] = columns;
    let floats = |out: &mut Vec<u8>, values: &[f32]| {
        values
            .iter()
            .for_each(|value| out.extend(value.to_le_bytes()));
    };
    for (position, normal) in vertices.positions.iter().zip(&vertices.normals) {
        floats(positions, &position.to_array());
        // glTF requires unit normals; an unknown normal points backwards along the world's z axis.
        floats(normals, &normal.normalize_or(-Vec3::Z).to_array());
    }
    let linear = linear_channels();
    for color in coloring.of(vertices).iter() {
        let [red, green, blue] = color.map(|channel| linear[usize::from(channel)]);
        [red, green, blue, u16::MAX]
            .iter()
            .for_each(|channel| colors.extend(channel.to_le_bytes()));
    }
    vertices
        .labels
        .iter()
        .for_each(|label| labels.extend(u32::from(label.0).to_le_bytes()));
    floats(confidences, &vertices.confidence);
    part.triangles
        .iter()
        .flatten()
        .for_each(|vertex| indices.extend(vertex.to_le_bytes()));
}

/// Returns the table from sRGB (IEC 61966-2-1) to 16-bit linear light.
///
/// Vertex colours in glTF are linear.
fn linear_channels() -> [u16; 256] {
    std::array::from_fn(|channel| {
        let encoded = channel as f64 / 255.0;
        let linear = if encoded <= 0.04045 {
            encoded / 12.92
        } else {
            ((encoded + 0.055) / 1.055).powf(2.4)
        };
        (linear * 65535.0).round() as u16
    })
}

fn head(tree: &LabelTree, ids: &[LabelId], accessors: &[Value], columns: &[Vec<u8>; 6]) -> Value {
    let children: Vec<usize> = (1..=ids.len()).collect();
    // A rotation by 180° about x.
    let root = json!({ "name": "scene", "rotation": [1.0, 0.0, 0.0, 0.0], "children": children });
    let node = |(mesh, &id): (usize, &LabelId)| {
        let parent = tree
            .get(id)
            .and_then(|label| label.parent)
            .map(|parent| parent.0);
        let extras = json!({ "label": id.0, "name": label_name(tree, id), "parent": parent, "color": color_of(tree, id) });
        json!({ "name": path_name(tree, id), "mesh": mesh, "extras": extras })
    };
    let mesh = |(at, &id): (usize, &LabelId)| {
        let place = |column: usize| at * COLUMNS.len() + column;
        let attributes: serde_json::Map<String, Value> = (0..5)
            .map(|column| (COLUMNS[column].name.to_owned(), json!(place(column))))
            .collect();
        json!({
            "name": path_name(tree, id),
            "primitives": [{ "attributes": attributes, "indices": place(5), "material": at, "mode": 4 }],
        })
    };
    let material = |&id: &LabelId| {
        let surface = json!({ "metallicFactor": 0.0, "roughnessFactor": 1.0 });
        json!({ "name": path_name(tree, id), "doubleSided": true, "pbrMetallicRoughness": surface })
    };
    let labels = || ids.iter().enumerate();
    json!({
        "asset": { "version": "2.0", "generator": concat!("OSTRA ", env!("CARGO_PKG_VERSION")) },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": std::iter::once(root).chain(labels().map(node)).collect::<Vec<_>>(),
        "meshes": labels().map(mesh).collect::<Vec<_>>(),
        "materials": ids.iter().map(material).collect::<Vec<_>>(),
        "accessors": accessors,
        "bufferViews": views(columns),
        "buffers": [{ "byteLength": columns.iter().map(Vec::len).sum::<usize>() }],
    })
}

/// Returns one buffer view per column.
///
/// The views of vertex data state their stride; the one of the indices must not.
fn views(columns: &[Vec<u8>; 6]) -> Vec<Value> {
    const VERTICES: u32 = 34962;
    const INDICES: u32 = 34963;
    let mut offset = 0;
    let view = |(column, bytes): (&BinaryColumn, &Vec<u8>)| {
        let mut value = json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes.len(), "target": INDICES });
        if column.name != "indices" {
            (value["byteStride"], value["target"]) = (json!(column.stride), json!(VERTICES));
        }
        offset += bytes.len();
        value
    };
    COLUMNS.iter().zip(columns).map(view).collect()
}
