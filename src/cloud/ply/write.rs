use std::borrow::Cow;
use std::io::{BufWriter, Write};
use std::ops::Range;
use std::path::Path;

use glam::Vec3;
use ply_rs::ply::{
    Addable, ElementDef, Encoding, Header, PropertyAccess, PropertyDef, PropertyType, ScalarType,
    Version,
};
use ply_rs::writer::Writer;
use rayon::prelude::*;

use super::comments::{comments_of, origin_comment};
use crate::whole_file::{unplaced, write_whole};
use crate::{LabelledCloud, LabelledMesh, SceneError};
use ostra_core::job::Progress;

/// Points between two checks for cancellation; they are encoded together.
const STRIDE: usize = 1 << 16;
/// Number of points encoded by one task.
const TASK: usize = 1 << 12;
/// Size of a point: seven floats, a colour and a label.
const POINT_BYTES: usize = 7 * 4 + 3 + 4;

/// The colours of a written cloud.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SavedColors {
    /// Image colours.
    #[default]
    Image,
    /// Label colours.
    Labels,
}

impl SavedColors {
    /// Returns the colours of the points in sRGB.
    #[must_use]
    pub fn of(self, cloud: &LabelledCloud) -> Cow<'_, [[u8; 3]]> {
        match self {
            Self::Image => Cow::Borrowed(&cloud.colors),
            Self::Labels => Cow::Owned(cloud.label_colors()),
        }
    }
}

/// Writes a cloud to `path`.
///
/// The file is written under a temporary name next to `path` and then renamed, so that the previous
/// file is left intact if the job is stopped or the disk is full.
///
/// # Errors
///
/// Returns [`SceneError::Io`] if the file cannot be written. Returns [`SceneError::Request`] if the
/// vectors of the cloud differ in length. Returns [`SceneError::Stopped`] if the job is stopped.
pub fn save_ply(
    path: &Path,
    cloud: &LabelledCloud,
    coloring: SavedColors,
    progress: &Progress,
) -> Result<(), SceneError> {
    save(
        path,
        &PlyContent {
            cloud,
            triangles: None,
            coloring,
        },
        progress,
    )
}

/// Writes a mesh to `path` as [`save_ply`] does.
///
/// The vertices are written as the points of a cloud, followed by an element `face` with the list
/// `vertex_indices`.
///
/// # Errors
///
/// Returns the errors of [`save_ply`].
pub fn save_mesh(
    path: &Path,
    mesh: &LabelledMesh,
    coloring: SavedColors,
    progress: &Progress,
) -> Result<(), SceneError> {
    save(
        path,
        &PlyContent {
            cloud: &mesh.vertices,
            triangles: Some(&mesh.triangles),
            coloring,
        },
        progress,
    )
}

/// The content of a file.
struct PlyContent<'a> {
    cloud: &'a LabelledCloud,
    triangles: Option<&'a [[u32; 3]]>,
    coloring: SavedColors,
}

fn save(path: &Path, content: &PlyContent<'_>, progress: &Progress) -> Result<(), SceneError> {
    write_whole(path, |out| write(out, content, progress))
}

/// Writes a cloud in the form of this module; the writer needs no buffer of its own.
///
/// # Errors
///
/// Returns the errors of [`save_ply`]; [`SceneError::Io`] has an empty path.
pub fn write_ply<W: Write>(
    out: W,
    cloud: &LabelledCloud,
    coloring: SavedColors,
    progress: &Progress,
) -> Result<(), SceneError> {
    write(
        out,
        &PlyContent {
            cloud,
            triangles: None,
            coloring,
        },
        progress,
    )
}

fn write<W: Write>(
    out: W,
    content: &PlyContent<'_>,
    progress: &Progress,
) -> Result<(), SceneError> {
    let PlyContent {
        cloud,
        triangles,
        coloring,
    } = *content;
    check_lengths(cloud)?;
    let mut out = BufWriter::with_capacity(1 << 18, out);
    let header = header(cloud, triangles);
    let writer = Writer::<Point>::new();
    writer.write_header(&mut out, &header).map_err(unplaced)?;
    let colors = coloring.of(cloud);
    let Some(definition) = header.elements.get("vertex") else {
        return Ok(());
    };
    let encode = |task: Range<usize>| {
        let (mut bytes, writer) = (
            Vec::with_capacity(task.len() * POINT_BYTES),
            Writer::<Point>::new(),
        );
        for index in task {
            let point = Point {
                position: cloud.positions[index],
                normal: cloud.normals[index],
                color: colors[index],
                label: cloud.labels[index].0,
                confidence: cloud.confidence[index],
            };
            writer.write_little_endian_element(&mut bytes, &point, definition)?;
        }
        Ok(bytes)
    };
    for first in (0..cloud.len()).step_by(STRIDE) {
        progress.step(first, cloud.len())?;
        let last = (first + STRIDE).min(cloud.len());
        let tasks: Vec<usize> = (first..last).step_by(TASK).collect();
        let encoded = tasks
            .into_par_iter()
            .map(|first| encode(first..(first + TASK).min(last)));
        for bytes in encoded
            .collect::<std::io::Result<Vec<Vec<u8>>>>()
            .map_err(unplaced)?
        {
            out.write_all(&bytes).map_err(unplaced)?;
        }
    }
    for triangle in triangles.unwrap_or_default() {
        out.write_all(&[3]).map_err(unplaced)?;
        out.write_all(bytemuck::cast_slice(&triangle.map(u32::to_le_bytes)))
            .map_err(unplaced)?;
    }
    out.flush().map_err(unplaced)
}

fn check_lengths(cloud: &LabelledCloud) -> Result<(), SceneError> {
    let lengths = [
        cloud.normals.len(),
        cloud.colors.len(),
        cloud.labels.len(),
        cloud.confidence.len(),
    ];
    match lengths.iter().all(|&length| length == cloud.len()) {
        true => Ok(()),
        false => Err(SceneError::Request(
            "the cloud's points, normals, colours and labels differ in number".into(),
        )),
    }
}

fn header(cloud: &LabelledCloud, triangles: Option<&[[u32; 3]]>) -> Header {
    let mut vertex = ElementDef::new("vertex".into());
    vertex.count = cloud.len();
    let columns = [
        (ScalarType::Float, &["x", "y", "z", "nx", "ny", "nz"][..]),
        (ScalarType::UChar, &["red", "green", "blue"]),
        (ScalarType::Int, &["label"]),
        (ScalarType::Float, &["confidence"]),
    ];
    for (scalar, names) in columns {
        for name in names {
            vertex.properties.add(PropertyDef::new(
                (*name).into(),
                PropertyType::Scalar(scalar.clone()),
            ));
        }
    }
    let mut header = Header::new();
    header.encoding = Encoding::BinaryLittleEndian;
    header.version = Version { major: 1, minor: 0 };
    header.comments = comments_of(&cloud.tree);
    header.comments.extend(origin_comment(cloud.origin));
    header.elements.add(vertex);
    if let Some(triangles) = triangles {
        let mut face = ElementDef::new("face".into());
        face.count = triangles.len();
        let corners = PropertyType::List(ScalarType::UChar, ScalarType::Int);
        face.properties
            .add(PropertyDef::new("vertex_indices".into(), corners));
        header.elements.add(face);
    }
    header
}

/// One point to be written.
struct Point {
    position: Vec3,
    normal: Vec3,
    color: [u8; 3],
    label: u16,
    confidence: f32,
}

impl PropertyAccess for Point {
    fn new() -> Self {
        Self {
            position: Vec3::ZERO,
            normal: Vec3::ZERO,
            color: [0; 3],
            label: 0,
            confidence: 0.0,
        }
    }

    fn get_float(&self, name: &str) -> Option<f32> {
        Some(match name {
            "x" => self.position.x,
            "y" => self.position.y,
            "z" => self.position.z,
            "nx" => self.normal.x,
            "ny" => self.normal.y,
            "nz" => self.normal.z,
            "confidence" => self.confidence,
            _ => return None,
        })
    }

    fn get_uchar(&self, name: &str) -> Option<u8> {
        Some(match name {
            "red" => self.color[0],
            "green" => self.color[1],
            "blue" => self.color[2],
            _ => return None,
        })
    }

    fn get_int(&self, name: &str) -> Option<i32> {
        (name == "label").then_some(i32::from(self.label))
    }
}
