use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use super::labels::{color_of, safe_names};
use crate::ply::{SavedColors, comments_of, file_part, origin_comment};
use crate::whole_file::{unplaced, write_whole};
use crate::{LabelledMesh, SceneError};
use ostra_core::job::Progress;
use ostra_masks::{LabelId, LabelTree};

/// Lines between two checks for cancellation.
const STRIDE: usize = 1 << 15;

/// Writes a mesh as Wavefront OBJ.
///
/// Vertices are `v x y z r g b` (sRGB colours, 0–1) with normals `vn`. Each label has an object and
/// a material named after its path. The materials go to `STEM.mtl` next to the mesh. Comments hold
/// the label tree, as in a PLY file.
pub(super) fn save(
    path: &Path,
    mesh: &LabelledMesh,
    coloring: SavedColors,
    progress: &Progress,
) -> Result<(), SceneError> {
    let parts = mesh.by_label();
    let tree = &mesh.vertices.tree;
    let names = safe_names(tree, parts.keys().copied());
    let library = library_name(path);
    let materials = materials(tree, &names);
    write_whole(&materials_path(path), |out| {
        out.write_all(materials.as_bytes()).map_err(unplaced)
    })?;
    write_whole(path, |out| {
        let mut out = BufWriter::with_capacity(1 << 18, out);
        let origin = origin_comment(mesh.vertices.origin)
            .map(|comment| format!("# {comment}\n"))
            .unwrap_or_default();
        out.write_all(origin.as_bytes()).map_err(unplaced)?;
        out.write_all(head(tree, &library).as_bytes())
            .map_err(unplaced)?;
        let mut writer = ObjWriter {
            out,
            vertices: 0,
            coloring,
            progress,
        };
        for (id, part) in &parts {
            writer.write_part(&names[id], part)?;
        }
        writer.out.flush().map_err(unplaced)
    })
}

/// Returns the path of the material file of a mesh at `path`.
pub(super) fn materials_path(path: &Path) -> PathBuf {
    path.with_file_name(library_name(path))
}

fn library_name(path: &Path) -> String {
    format!(
        "{}.mtl",
        file_part(&path.file_stem().unwrap_or_default().to_string_lossy())
    )
}

fn head(tree: &LabelTree, library: &str) -> String {
    let comments: String = comments_of(tree)
        .iter()
        .map(|comment| format!("# {comment}\n"))
        .collect();
    format!("{comments}mtllib {library}\n")
}

/// Returns the text of the MTL file: a matte material in the label's colour per label.
fn materials(tree: &LabelTree, names: &BTreeMap<LabelId, String>) -> String {
    let mut text = String::new();
    for (&id, name) in names {
        let [red, green, blue] = color_of(tree, id).map(unit);
        let _ = write!(
            text,
            "newmtl {name}\nKd {red:.4} {green:.4} {blue:.4}\nKs 0 0 0\nd 1\nillum 1\n\n"
        );
    }
    text
}

/// Writes the objects of an OBJ file.
struct ObjWriter<'a, W> {
    out: W,
    /// Number of vertices already written.
    vertices: usize,
    coloring: SavedColors,
    progress: &'a Progress,
}

impl<W: Write> ObjWriter<'_, W> {
    /// Writes the object of one label.
    fn write_part(&mut self, name: &str, part: &LabelledMesh) -> Result<(), SceneError> {
        let out = &mut self.out;
        writeln!(out, "o {name}\nusemtl {name}").map_err(unplaced)?;
        let (vertices, colors) = (&part.vertices, self.coloring.of(&part.vertices));
        let lines = vertices.len() + part.triangles.len();
        for (at, (position, color)) in vertices.positions.iter().zip(colors.iter()).enumerate() {
            if at % STRIDE == 0 {
                self.progress.step(at, lines)?;
            }
            let ([x, y, z], [red, green, blue]) = (position.to_array(), color.map(unit));
            writeln!(out, "v {x} {y} {z} {red:.4} {green:.4} {blue:.4}").map_err(unplaced)?;
        }
        for [x, y, z] in vertices.normals.iter().map(glam::Vec3::to_array) {
            writeln!(out, "vn {x:.4} {y:.4} {z:.4}").map_err(unplaced)?;
        }
        for (at, triangle) in part.triangles.iter().enumerate() {
            if at % STRIDE == 0 {
                self.progress.step(vertices.len() + at, lines)?;
            }
            let [a, b, c] = triangle.map(|vertex| self.vertices + vertex as usize + 1);
            writeln!(out, "f {a}//{a} {b}//{b} {c}//{c}").map_err(unplaced)?;
        }
        self.vertices += vertices.len();
        Ok(())
    }
}

fn unit(channel: u8) -> f32 {
    f32::from(channel) / 255.0
}
