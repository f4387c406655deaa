use std::io::{BufRead, BufReader, ErrorKind};
use std::path::Path;

use glam::{DVec3, Vec3};
use ply_rs::parser::Parser;
use ply_rs::ply::Encoding;

use super::comments::{origin_from_comments, tree_from_comments};
use super::elements::{self, Fault, read_faces, skip};
use super::header::{StoredColors, VertexLayout, first_line};
use super::vertex::{Vertex, VertexSlot};
use crate::labelled_cloud::name_unknown_labels;
use crate::{LabelledCloud, LabelledMesh, SceneError};
use ostra_core::disk;
use ostra_core::job::Progress;
use ostra_core::statistics::upper_median;
use ostra_masks::LabelId;

/// Points between two checks for cancellation.
const STRIDE: usize = 1 << 16;
/// Magnitude from which coordinates with more than 32 bits are stored relative to an origin.
const FAR: f64 = 1000.0;
/// The origin is a multiple of this value.
const ORIGIN_STEP: f64 = 100.0;
/// Number of points from which the origin is chosen.
const ORIGIN_POINTS: usize = 4096;

/// A cloud read from a PLY file, and which properties the file had.
#[derive(Debug, Clone, PartialEq)]
pub struct PlyCloud {
    /// The points.
    ///
    /// Missing colours are grey, missing normals are zero and missing labels are 0. Missing
    /// confidences are 1 for labelled points. Positions with more digits than 32 bits hold are
    /// relative to `cloud.origin`. Ids that the file does not name get a label named after the
    /// number.
    pub cloud: LabelledCloud,
    /// Whether the file has labels.
    pub has_labels: bool,
    /// Whether the file has normals.
    pub has_normals: bool,
    /// Whether the file has colours.
    pub has_colors: bool,
    /// Warnings for the user.
    ///
    /// They report points dropped because their position is not finite (organised clouds mark holes
    /// this way), labels that mean "none", and the assumed range of colours.
    pub warnings: Vec<String>,
}

/// Reads the vertices of a PLY file.
///
/// The file may be ASCII or binary of either byte order, with properties in any order and of any
/// type. Labels are found under any of the usual names (`label`, `scalar_Label`, `class`,
/// `classification`, …). Faces and other elements are skipped. Negative labels, NaN and −1 stored
/// as an unsigned number mean "none" in other programs; they are read as 0, with a warning.
///
/// # Errors
///
/// Returns [`SceneError::Io`] if the file cannot be opened. Returns [`SceneError::Invalid`] if it
/// is not a PLY file, has no vertices, is truncated, or has a label that is not an integer up to
/// 65535. Returns [`SceneError::Stopped`] if the job is stopped.
pub fn read_ply(path: &Path, progress: &Progress) -> Result<PlyCloud, SceneError> {
    let io = |reason| SceneError::Io {
        path: path.to_path_buf(),
        reason,
    };
    let file = disk::open_regular(path).map_err(io)?;
    let bytes = file.metadata().map_err(io)?.len();
    let mut reader = BufReader::with_capacity(1 << 18, file);
    read_or(path, || read_from(&mut reader, bytes, progress))
}

/// Reads a PLY file with its faces, which must come after its vertices.
///
/// Faces with more than three corners are split into triangles.
///
/// # Errors
///
/// Returns the errors of [`read_ply`]. Returns [`SceneError::Invalid`] if there are no faces, if a
/// vertex has no finite position, or if a face refers to a vertex that does not exist.
pub fn read_mesh(path: &Path, progress: &Progress) -> Result<LabelledMesh, SceneError> {
    let io = |reason| SceneError::Io {
        path: path.to_path_buf(),
        reason,
    };
    let file = disk::open_regular(path).map_err(io)?;
    let bytes = file.metadata().map_err(io)?.len();
    let mut reader = BufReader::with_capacity(1 << 18, file);
    let read = || -> Result<LabelledMesh, Fault> {
        let layout = VertexLayout::read(&mut reader)?;
        let vertices = read_vertices(&mut reader, &layout, bytes, progress)?.cloud;
        if vertices.len() != layout.vertex.count {
            return Err(
                "some of its vertices have no finite position; repair the mesh"
                    .to_owned()
                    .into(),
            );
        }
        let triangles = read_faces(&mut reader, &layout, vertices.len(), progress)?;
        Ok(LabelledMesh {
            vertices,
            triangles,
        })
    };
    read_or(path, read)
}

fn read_or<T>(path: &Path, read: impl FnOnce() -> Result<T, Fault>) -> Result<T, SceneError> {
    read().map_err(|fault| match fault {
        Fault::Content(what) => SceneError::Invalid {
            path: path.to_path_buf(),
            what,
        },
        Fault::Stopped(stopped) => stopped.into(),
    })
}

/// Reads a PLY file of `bytes` bytes from its beginning.
pub(super) fn read_from(
    reader: &mut impl BufRead,
    bytes: u64,
    progress: &Progress,
) -> Result<PlyCloud, Fault> {
    let layout = VertexLayout::read(reader)?;
    read_vertices(reader, &layout, bytes, progress)
}

fn read_vertices(
    reader: &mut impl BufRead,
    layout: &VertexLayout,
    bytes: u64,
    progress: &Progress,
) -> Result<PlyCloud, Fault> {
    layout.check_counts(bytes)?;
    layout
        .before
        .iter()
        .try_for_each(|element| skip(reader, layout, element, progress))?;
    let count = layout.vertex.count;
    // A header can claim any number of points, so no more is reserved than the file can hold.
    let mut builder = Builder::new(
        layout,
        count.min(usize::try_from(bytes).unwrap_or(usize::MAX) / 3),
    );
    let mut line = String::new();
    for index in 0..count {
        if index % STRIDE == 0 {
            progress.step(index, count).map_err(Fault::Stopped)?;
        }
        let vertex = read_vertex(reader, layout, &mut line).map_err(|what| {
            format!(
                "point {index} of {count} cannot be read ({what}); the file is damaged or cut off"
            )
        })?;
        builder
            .push(&vertex)
            .map_err(|what| format!("point {index}: {what}"))?;
    }
    Ok(builder.finish(layout))
}

fn read_vertex(
    reader: &mut impl BufRead,
    layout: &VertexLayout,
    line: &mut String,
) -> Result<Vertex, String> {
    let parser = Parser::<Vertex>::new();
    let read = match layout.encoding {
        Encoding::Ascii => return elements::read_vertex(reader, layout, line),
        Encoding::BinaryBigEndian => parser.read_big_endian_element(reader, &layout.vertex),
        Encoding::BinaryLittleEndian => parser.read_little_endian_element(reader, &layout.vertex),
    };
    read.map_err(|error| match error.kind() {
        ErrorKind::UnexpectedEof => "the file ends early".into(),
        _ => first_line(&error.to_string()).to_string(),
    })
}

/// Collects vertices into a cloud.
struct Builder {
    cloud: LabelledCloud,
    /// Colours as stored, if their range is only known at the end.
    wide_colors: Vec<[f32; 3]>,
    colors: StoredColors,
    has_colors: bool,
    has_confidence: bool,
    dropped: usize,
    /// Number of points whose label means "none", and the first such label.
    without_label: Option<(usize, f64)>,
    /// Whether the file may hold more digits than 32 bits do.
    is_exact: bool,
    /// Offset subtracted from positions, once enough points are known to choose it.
    shift: Option<DVec3>,
    /// The positions until then.
    first: Vec<DVec3>,
}

impl Builder {
    fn new(layout: &VertexLayout, capacity: usize) -> Self {
        let cloud = LabelledCloud {
            positions: Vec::with_capacity(capacity),
            normals: Vec::with_capacity(capacity),
            colors: Vec::with_capacity(capacity),
            labels: Vec::with_capacity(capacity),
            confidence: Vec::with_capacity(capacity),
            tree: tree_from_comments(&layout.comments),
            origin: origin_from_comments(&layout.comments),
        };
        Self {
            cloud,
            wide_colors: Vec::new(),
            colors: layout.colors,
            has_colors: layout.has(VertexSlot::Red)
                && layout.has(VertexSlot::Green)
                && layout.has(VertexSlot::Blue),
            has_confidence: layout.has(VertexSlot::Confidence),
            is_exact: layout.double_positions || layout.encoding == Encoding::Ascii,
            shift: None,
            first: Vec::new(),
            dropped: 0,
            without_label: None,
        }
    }

    fn push(&mut self, vertex: &Vertex) -> Result<(), String> {
        let exact = DVec3::new(
            vertex.at(VertexSlot::X),
            vertex.at(VertexSlot::Y),
            vertex.at(VertexSlot::Z),
        );
        if !exact.as_vec3().is_finite() {
            self.dropped += 1;
            return Ok(());
        }
        let stored = vertex.at(VertexSlot::Label);
        let label = if means_no_label(stored) {
            self.without_label.get_or_insert((0, stored)).0 += 1;
            LabelId::NONE
        } else {
            label_id(stored)?
        };
        self.push_position(exact);
        self.cloud.normals.push(self.normal(vertex));
        let color =
            [VertexSlot::Red, VertexSlot::Green, VertexSlot::Blue].map(|slot| vertex.at(slot));
        match self.colors {
            _ if !self.has_colors => self.cloud.colors.push([192; 3]),
            StoredColors::Bytes => self.cloud.colors.push(color.map(|channel| channel as u8)),
            StoredColors::Wide { .. } => self.wide_colors.push(color.map(|channel| channel as f32)),
        }
        self.cloud.labels.push(label);
        self.cloud.confidence.push(self.confidence(vertex, label));
        Ok(())
    }

    fn push_position(&mut self, exact: DVec3) {
        if let Some(shift) = self.shift {
            self.cloud.positions.push((exact - shift).as_vec3());
            return;
        }
        self.first.push(exact);
        if self.first.len() == ORIGIN_POINTS {
            self.choose_origin();
        }
    }

    /// Chooses the origin that positions are relative to.
    ///
    /// It is non-zero if the file has more digits than 32 bits hold and most of its first points
    /// are far from zero. A hole stored as zero, or one distant point, has no influence.
    fn choose_origin(&mut self) {
        let median = |axis: usize| {
            let mut along: Vec<f64> = self.first.iter().map(|at| at[axis]).collect();
            upper_median(&mut along)
        };
        let is_far = |at: DVec3| self.is_exact && at.abs().max_element() >= FAR;
        let median = || Some(DVec3::new(median(0)?, median(1)?, median(2)?));
        let shift = median()
            .filter(|&at| is_far(at))
            .map_or(DVec3::ZERO, |at| (at / ORIGIN_STEP).round() * ORIGIN_STEP);
        // Adding zero turns -0 into 0.
        let shift = shift + DVec3::ZERO;
        self.shift = Some(shift);
        self.cloud
            .positions
            .extend(self.first.drain(..).map(|exact| (exact - shift).as_vec3()));
    }

    fn normal(&self, vertex: &Vertex) -> Vec3 {
        let normal = DVec3::new(
            vertex.at(VertexSlot::Nx),
            vertex.at(VertexSlot::Ny),
            vertex.at(VertexSlot::Nz),
        )
        .as_vec3();
        // Unit normals are kept bit for bit, so that writing what was read gives the same file.
        if normal.is_normalized() {
            normal
        } else {
            normal.normalize_or_zero()
        }
    }

    /// Scales colours of a wider type to 0–255.
    ///
    /// Returns a warning about the assumed range, if it is needed.
    fn scale_colors(&mut self) -> Option<String> {
        let StoredColors::Wide { floating } = self.colors else {
            return None;
        };
        if !self.has_colors {
            return None;
        }
        let channels = || self.wide_colors.iter().flatten().copied();
        let highest = channels()
            .filter(|channel| channel.is_finite())
            .fold(0.0f32, f32::max);
        // Values slightly above the end of a range are due to rounding.
        let (range, usual) = match highest {
            _ if floating && highest <= 1.01 => (1.0, true),
            _ if highest <= 255.5 => (255.0, !floating),
            _ => (65_535.0, !floating),
        };
        let outside = channels()
            .filter(|channel| !(0.0..=range * 1.01).contains(channel))
            .count();
        let scale = 255.0 / range;
        self.cloud.colors = self
            .wide_colors
            .iter()
            .map(|color| color.map(|c| (c * scale).round() as u8))
            .collect();
        let taken =
            (!usual).then(|| format!("colours go up to {highest} and were taken as 0 to {range}"));
        let outside = (outside > 0).then(|| {
            format!("{outside} colour values are NaN, negative or above {range} and were set to the nearest colour")
        });
        Some(
            [taken, outside]
                .into_iter()
                .flatten()
                .collect::<Vec<_>>()
                .join("; "),
        )
        .filter(|text| !text.is_empty())
    }

    fn confidence(&self, vertex: &Vertex, label: LabelId) -> f32 {
        match self.has_confidence {
            true => (vertex.at(VertexSlot::Confidence) as f32)
                .clamp(0.0, 1.0)
                .max(0.0),
            false => f32::from(u8::from(label != LabelId::NONE)),
        }
    }

    fn finish(mut self, layout: &VertexLayout) -> PlyCloud {
        if self.shift.is_none() {
            self.choose_origin();
        }
        let mut used: Vec<LabelId> = self.cloud.labels.clone();
        used.sort_unstable();
        used.dedup();
        name_unknown_labels(&mut self.cloud.tree, used);
        let mut warnings: Vec<String> = self.scale_colors().into_iter().collect();
        if let Some((count, first)) = self.without_label {
            warnings.push(format!(
                "{count} points have a label that means none (such as {first}) and are unlabelled"
            ));
        }
        if self.dropped > 0 {
            warnings.push(format!(
                "{} points without a finite position were left out",
                self.dropped
            ));
        }
        self.cloud.origin += self.shift.unwrap_or_default();
        PlyCloud {
            has_labels: layout.has(VertexSlot::Label),
            has_normals: layout.has(VertexSlot::Nx)
                && layout.has(VertexSlot::Ny)
                && layout.has(VertexSlot::Nz),
            has_colors: self.has_colors,
            cloud: self.cloud,
            warnings,
        }
    }
}

/// Returns whether a stored label means that the point has no label.
///
/// Other programs use NaN, a negative integer (−1 for noise, −100 for "ignore"), or −1 stored as an
/// unsigned 32-bit number.
fn means_no_label(value: f64) -> bool {
    let whole = value.round();
    let unsigned = [f64::from(u32::MAX), f64::from(u32::MAX as f32)];
    value.is_nan() || (whole < 0.0 && (value - whole).abs() <= 1e-3) || unsigned.contains(&value)
}

/// Converts a stored label to an id.
///
/// Files store labels as any integer or floating-point type.
fn label_id(value: f64) -> Result<LabelId, String> {
    let whole = value.round();
    if (value - whole).abs() > 1e-3 || !(0.0..=65535.0).contains(&whole) {
        return Err(format!(
            "its label {value} is not a whole number from 0 to 65535; renumber the labels"
        ));
    }
    Ok(LabelId(whole as u16))
}
