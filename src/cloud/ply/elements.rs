//! Single elements of a PLY file: faces, ASCII lines, and skipped elements.

use std::io::BufRead;

use ply_rs::parser::Parser;
use ply_rs::ply::{
    ElementDef, Encoding, Property, PropertyAccess, PropertyAccessResult, PropertyType,
};

use super::header::{VertexLayout, first_line};
use super::vertex::Vertex;
use ostra_core::job::Progress;

/// Faces between two checks for cancellation.
const STRIDE: usize = 1 << 16;

/// The corners of one face: the first list property of its element.
#[derive(Default)]
struct PlyFace {
    corners: Vec<i64>,
}

impl PropertyAccess for PlyFace {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, _name: &str, list: Property) -> PropertyAccessResult {
        let corners: Vec<i64> = match list {
            Property::ListChar(corners) => corners.into_iter().map(i64::from).collect(),
            Property::ListUChar(corners) => corners.into_iter().map(i64::from).collect(),
            Property::ListShort(corners) => corners.into_iter().map(i64::from).collect(),
            Property::ListUShort(corners) => corners.into_iter().map(i64::from).collect(),
            Property::ListInt(corners) => corners.into_iter().map(i64::from).collect(),
            Property::ListUInt(corners) => corners.into_iter().map(i64::from).collect(),
            _ => return PropertyAccessResult::Ignored,
        };
        if self.corners.is_empty() {
            self.corners = corners;
        }
        PropertyAccessResult::Set
    }
}

/// Reads the faces as triangles; a face with more than three corners becomes a fan.
///
/// `vertices` is the number of vertices that corners may refer to.
pub(super) fn read_faces(
    reader: &mut impl BufRead,
    layout: &VertexLayout,
    vertices: usize,
    progress: &Progress,
) -> Result<Vec<[u32; 3]>, Fault> {
    let Some((faces, between)) = layout.after.split_last() else {
        return Err("it has no faces after its vertices; open it as a cloud"
            .to_owned()
            .into());
    };
    if faces.properties.is_empty() {
        let what = "its faces have no list of corners ('property list … vertex_indices'); export the mesh again";
        return Err(what.to_owned().into());
    }
    between
        .iter()
        .try_for_each(|element| skip(reader, layout, element, progress))?;
    let mut triangles = Vec::new();
    for index in 0..faces.count {
        if index % STRIDE == 0 {
            progress.step(index, faces.count).map_err(Fault::Stopped)?;
        }
        let corners = read_face(reader, layout, faces).map_err(|what| {
            format!(
                "face {index} of {} cannot be read ({what}); the file is damaged",
                faces.count
            )
        })?;
        let corner = |at: usize| {
            let named = u32::try_from(corners[at])
                .ok()
                .filter(|&corner| (corner as usize) < vertices);
            named.ok_or_else(|| {
                format!("face {index} names a vertex that is not there; the file is damaged")
            })
        };
        for last in 2..corners.len() {
            triangles.push([corner(0)?, corner(last - 1)?, corner(last)?]);
        }
    }
    Ok(triangles)
}

fn read_face(
    reader: &mut impl BufRead,
    layout: &VertexLayout,
    faces: &ElementDef,
) -> Result<Vec<i64>, String> {
    let parser = Parser::<PlyFace>::new();
    let read = match layout.encoding {
        Encoding::Ascii => {
            let is_list = |(_, property): (_, &ply_rs::ply::PropertyDef)| {
                matches!(property.data_type, PropertyType::List(..))
            };
            return read_list(reader, faces.properties.iter().map(is_list));
        }
        Encoding::BinaryBigEndian => parser.read_big_endian_element(reader, faces),
        Encoding::BinaryLittleEndian => parser.read_little_endian_element(reader, faces),
    };
    read.map(|face| face.corners)
        .map_err(|error| first_line(&error.to_string()).to_owned())
}

/// Why reading ended early.
#[derive(Debug)]
pub(super) enum Fault {
    Content(String),
    Stopped(ostra_core::job::Stopped),
}

impl From<String> for Fault {
    fn from(what: String) -> Self {
        Self::Content(what)
    }
}

/// Skips an element.
pub(super) fn skip(
    reader: &mut impl BufRead,
    layout: &VertexLayout,
    element: &ElementDef,
    progress: &Progress,
) -> Result<(), Fault> {
    if element.properties.is_empty() && layout.encoding != Encoding::Ascii {
        return Ok(());
    }
    let parser = Parser::<Vertex>::new();
    for index in 0..element.count {
        if index % STRIDE == 0 {
            progress.check().map_err(Fault::Stopped)?;
        }
        let read = match layout.encoding {
            Encoding::Ascii => skip_lines(reader, 1),
            Encoding::BinaryBigEndian => parser
                .read_big_endian_element(reader, element)
                .map(drop)
                .map_err(|error| error.to_string()),
            Encoding::BinaryLittleEndian => parser
                .read_little_endian_element(reader, element)
                .map(drop)
                .map_err(|error| error.to_string()),
        };
        read.map_err(|what| {
            format!(
                "element '{}' cannot be read ({}); the file is damaged or cut off",
                element.name,
                first_line(&what)
            )
        })?;
    }
    Ok(())
}

/// Reads one vertex of an ASCII file.
///
/// Numbers may be written as Rust, C or PCL write them (`5.`, `.5`, `nan`, `-inf`), which the
/// grammar of ply-rs does not accept.
pub(super) fn read_vertex(
    reader: &mut impl BufRead,
    layout: &VertexLayout,
    line: &mut String,
) -> Result<Vertex, String> {
    next_line(reader, line)?;
    while line.trim_ascii().is_empty() && !layout.columns.is_empty() {
        next_line(reader, line)?;
    }
    // Some exporters put a byte-order mark between the header and the points.
    let mut words = line.trim_start_matches('\u{feff}').split_ascii_whitespace();
    let mut number = || -> Result<f64, String> {
        let word = words
            .next()
            .ok_or("a line has fewer numbers than the header says")?;
        word.parse()
            .map_err(|_| format!("'{word}' is not a number"))
    };
    let mut vertex = Vertex::new();
    for column in &layout.columns {
        let value = number()?;
        match column {
            Some(slot) => vertex.put(*slot, value),
            None => (0..value as u64).try_for_each(|_| number().map(drop))?,
        }
    }
    Ok(vertex)
}

/// Skips the lines of an element.
fn skip_lines(reader: &mut impl BufRead, count: usize) -> Result<(), String> {
    let mut line = String::new();
    (0..count).try_for_each(|_| next_line(reader, &mut line))
}

fn next_line(reader: &mut impl BufRead, line: &mut String) -> Result<(), String> {
    line.clear();
    let read = reader.read_line(line).map_err(|error| error.to_string())?;
    if read == 0 {
        Err("the file ends early".into())
    } else {
        Ok(())
    }
}

/// Reads a line of properties and returns the first list.
fn read_list(
    reader: &mut impl BufRead,
    properties: impl Iterator<Item = bool>,
) -> Result<Vec<i64>, String> {
    let mut line = String::new();
    next_line(reader, &mut line)?;
    let mut words = line.split_ascii_whitespace();
    for is_list in properties {
        // Values before the list may be any number and are ignored.
        let count = if is_list { whole(words.next())? } else { 1 };
        let values = (0..count).map(|_| words.next());
        if is_list {
            return values.map(whole).collect();
        }
        values.for_each(drop);
    }
    Err("it has no list of corners".into())
}

fn whole(word: Option<&str>) -> Result<i64, String> {
    let word = word.ok_or("a line has fewer numbers than the header says")?;
    word.parse()
        .map_err(|_| format!("'{word}' is not a whole number"))
}
