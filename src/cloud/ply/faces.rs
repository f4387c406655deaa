use std::io::BufRead;

use ply_rs::parser::Parser;
use ply_rs::ply::{
    ElementDef, Encoding, Property, PropertyAccess, PropertyAccessResult, PropertyType,
};

use super::ascii;
use super::header::{Layout, first_line};
use super::read::{Fault, skip};
use ostra_core::job::Progress;

/// Faces between two looks at the stop sign.
const STRIDE: usize = 1 << 16;

/// The corners of one face: the first list of its element.
#[derive(Default)]
struct Face {
    corners: Vec<i64>,
}

impl PropertyAccess for Face {
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

/// Reads the faces after `vertices` vertices as triangles; a face of more corners becomes a fan.
pub(super) fn read_faces(
    reader: &mut impl BufRead,
    layout: &Layout,
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
    layout: &Layout,
    faces: &ElementDef,
) -> Result<Vec<i64>, String> {
    let parser = Parser::<Face>::new();
    let read = match layout.encoding {
        Encoding::Ascii => {
            let is_list = |(_, property): (_, &ply_rs::ply::PropertyDef)| {
                matches!(property.data_type, PropertyType::List(..))
            };
            return ascii::read_list(reader, faces.properties.iter().map(is_list));
        }
        Encoding::BinaryBigEndian => parser.read_big_endian_element(reader, faces),
        Encoding::BinaryLittleEndian => parser.read_little_endian_element(reader, faces),
    };
    read.map(|face| face.corners)
        .map_err(|error| first_line(&error.to_string()).to_owned())
}
