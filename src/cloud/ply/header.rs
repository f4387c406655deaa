use std::collections::BTreeMap;
use std::io::BufRead;

use ply_rs::parser::Parser;
use ply_rs::ply::{Addable, ElementDef, Encoding, Header, PropertyDef, PropertyType, ScalarType};

use super::vertex::{Vertex, VertexSlot};
use ostra_core::disk;

/// Maximum size of a PLY header.
///
/// A header with 65,535 labels with long names takes a tenth of it.
const MAX_HEADER_BYTES: usize = 64 << 20;

/// The UTF-8 byte-order mark that Windows editors and some exporters put before text.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// The structure of a file's vertices, as described by its header.
#[derive(Debug)]
pub(super) struct VertexLayout {
    pub(super) encoding: Encoding,
    pub(super) comments: Vec<String>,
    /// Elements before the vertices, which must be skipped.
    pub(super) before: Vec<ElementDef>,
    /// The vertices, with properties renamed by [`VertexSlot::property_name`].
    pub(super) vertex: ElementDef,
    /// Elements after the vertices; the last one is the faces, if the file has any.
    pub(super) after: Vec<ElementDef>,
    /// Slot of each vertex property, in file order; `None` is a list.
    pub(super) columns: Vec<Option<VertexSlot>>,
    /// How colours are stored.
    pub(super) colors: StoredColors,
    /// Whether the positions are stored in 64 bits.
    pub(super) double_positions: bool,
}

/// How a file stores its colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum StoredColors {
    /// 0 to 255.
    Bytes,
    /// A wider type, whose range only the values show: 0 to 1, 0 to 255 or 0 to 65535.
    Wide {
        /// Whether the type is floating-point.
        floating: bool,
    },
}

impl VertexLayout {
    /// Checks that a file of `bytes` bytes can hold the elements that its header lists.
    ///
    /// This happens before any of them is read, because a header can claim any number of points or
    /// faces.
    pub(super) fn check_counts(&self, bytes: u64) -> Result<(), String> {
        for element in self.before.iter().chain([&self.vertex]).chain(&self.after) {
            let each = match self.encoding {
                Encoding::Ascii => 1,
                _ => element
                    .properties
                    .iter()
                    .map(|(_, property)| least_bytes(&property.data_type))
                    .sum(),
            };
            if (element.count as u64).saturating_mul(each) > bytes {
                return Err(format!(
                    "its header lists {} of the element '{}', but the file has only {bytes} bytes and ends early; it is \
                     damaged or cut off",
                    element.count, element.name
                ));
            }
        }
        Ok(())
    }

    /// Returns whether the file has this property.
    pub(super) fn has(&self, slot: VertexSlot) -> bool {
        self.columns.contains(&Some(slot))
    }

    /// Reads a header up to and including its `end_header` line.
    ///
    /// ply-rs rejects property names with characters other than letters, digits, `_` and `-`
    /// (CloudCompare writes `scalar_Scalar_field_#2`). It also keeps only the last of two
    /// properties with the same name, and requires UTF-8 in comments. It is therefore given numbers
    /// as names, and the real names are kept separately.
    pub(super) fn read(reader: &mut impl BufRead) -> Result<Self, String> {
        let lines = header_lines(reader)?;
        let mut names: Vec<Vec<String>> = Vec::new();
        let text: String = lines
            .iter()
            .map(|line| number_properties(line, &mut names))
            .collect();
        let header = Parser::<Vertex>::new()
            .read_ply_header(&mut text.as_bytes())
            .map_err(|error| {
                format!(
                    "its header cannot be understood ({}); is it a PLY file?",
                    first_line(&error.to_string())
                )
            })?;
        if header.elements.len() != names.len() {
            return Err(
                "two elements of its header have the same name; write it again with another program"
                    .into(),
            );
        }
        Self::from_header(header, &names)
    }

    fn from_header(header: Header, names: &[Vec<String>]) -> Result<Self, String> {
        let place = header
            .elements
            .keys()
            .position(|name| name == "vertex")
            .ok_or("it has no element 'vertex', so no points; export it as a point cloud or mesh with vertices")?;
        let faces = header.elements.keys().position(|name| name == "face");
        let mut elements: Vec<ElementDef> = header
            .elements
            .into_iter()
            .map(|(_, element)| element)
            .collect();
        let mut after = elements.split_off(place + 1);
        after.truncate(
            faces
                .filter(|&faces| faces > place)
                .map_or(0, |faces| faces - place),
        );
        let Some(found) = elements.pop() else {
            return Err("it has no points".into());
        };
        let mut layout = Self {
            encoding: header.encoding,
            comments: header.comments,
            before: elements,
            vertex: ElementDef::new(found.name),
            after,
            columns: Vec::new(),
            colors: StoredColors::Bytes,
            double_positions: false,
        };
        layout.vertex.count = found.count;
        let taken: Vec<(PropertyType, VertexSlot)> =
            slots(&names[place], found.properties.into_iter().map(|(_, p)| p));
        for (data_type, slot) in taken {
            layout.add(slot, data_type);
        }
        match [VertexSlot::X, VertexSlot::Y, VertexSlot::Z]
            .into_iter()
            .find(|&slot| !layout.has(slot))
        {
            Some(slot) => Err(format!(
                "its vertices have no '{}'",
                format!("{slot:?}").to_lowercase()
            )),
            None => Ok(layout),
        }
    }

    fn add(&mut self, slot: VertexSlot, data_type: PropertyType) {
        let column = self.columns.len();
        if let PropertyType::Scalar(scalar) = &data_type {
            match slot {
                VertexSlot::Red | VertexSlot::Green | VertexSlot::Blue => {
                    self.colors = self.colors.with(scalar);
                }
                VertexSlot::X => self.double_positions = *scalar == ScalarType::Double,
                _ => {}
            }
            self.columns.push(Some(slot));
        } else {
            self.columns.push(None);
        }
        self.vertex
            .properties
            .add(PropertyDef::new(slot.property_name(column), data_type));
    }
}

/// Returns the header lines, each with its line break; invalid UTF-8 is replaced.
fn header_lines(reader: &mut impl BufRead) -> Result<Vec<String>, String> {
    let mut lines = Vec::new();
    let mut bytes = 0;
    disk::skip_mark(reader).map_err(|error| format!("its header cannot be read ({error})"))?;
    loop {
        let mut line = Vec::new();
        let mut limited = std::io::Read::take(&mut *reader, MAX_HEADER_BYTES as u64);
        limited
            .read_until(b'\n', &mut line)
            .map_err(|error| format!("its header cannot be read ({error})"))?;
        bytes += line.len();
        if lines.is_empty() && line.starts_with(BYTE_ORDER_MARK) {
            line.drain(..BYTE_ORDER_MARK.len());
        }
        if lines.is_empty() && line.trim_ascii() != b"ply" {
            return Err("it does not begin with 'ply', so it is not a PLY file".into());
        }
        if line.is_empty() || bytes > MAX_HEADER_BYTES {
            return Err("its header has no end ('end_header' is missing); the file is cut off or not a PLY file".into());
        }
        let end = line.trim_ascii() == b"end_header";
        lines.push(format!(
            "{}\n",
            String::from_utf8_lossy(line.trim_ascii_end())
        ));
        if end {
            return Ok(lines);
        }
    }
}

/// Returns the line with the name of a property replaced by its number.
///
/// The name itself is added to `names`, element by element.
fn number_properties(line: &str, names: &mut Vec<Vec<String>>) -> String {
    let words: Vec<&str> = line.split_whitespace().collect();
    match words.first() {
        Some(&"element") => names.push(Vec::new()),
        Some(&"property") => {
            if let (Some(element), Some((name, rest))) = (names.last_mut(), words.split_last()) {
                let numbered = format!("{} c{}\n", rest.join(" "), element.len());
                element.push((*name).to_string());
                return numbered;
            }
        }
        _ => {}
    }
    line.to_string()
}

/// Returns the slot of each property.
///
/// The best-ranked name wins a slot; the other properties get [`VertexSlot::Other`].
fn slots(
    names: &[String],
    properties: impl Iterator<Item = PropertyDef>,
) -> Vec<(PropertyType, VertexSlot)> {
    let mut best: BTreeMap<u8, (usize, usize)> = BTreeMap::new();
    let mut columns = Vec::new();
    for (column, property) in properties.enumerate() {
        let scalar = matches!(property.data_type, PropertyType::Scalar(_));
        let meaning = names
            .get(column)
            .filter(|_| scalar)
            .and_then(|name| slot_of(name));
        if let Some((slot, rank)) = meaning {
            let first = best.entry(slot as u8).or_insert((rank, column));
            *first = (*first).min((rank, column));
        }
        columns.push((
            property.data_type,
            meaning.map_or(VertexSlot::Other, |(slot, _)| slot),
        ));
    }
    for (column, (_, slot)) in columns.iter_mut().enumerate() {
        if best
            .get(&(*slot as u8))
            .is_some_and(|&(_, winner)| winner != column)
        {
            *slot = VertexSlot::Other;
        }
    }
    columns
}

/// Returns the slot that a property name stands for, and its rank in the list of names for it.
fn slot_of(name: &str) -> Option<(VertexSlot, usize)> {
    const NAMES: [(VertexSlot, &[&str]); 11] = [
        (VertexSlot::X, &["x", "px", "pos_x"]),
        (VertexSlot::Y, &["y", "py", "pos_y"]),
        (VertexSlot::Z, &["z", "pz", "pos_z"]),
        (VertexSlot::Nx, &["nx", "normal_x"]),
        (VertexSlot::Ny, &["ny", "normal_y"]),
        (VertexSlot::Nz, &["nz", "normal_z"]),
        (VertexSlot::Red, &["red", "r", "diffuse_red"]),
        (VertexSlot::Green, &["green", "g", "diffuse_green"]),
        (VertexSlot::Blue, &["blue", "b", "diffuse_blue"]),
        (
            VertexSlot::Label,
            &[
                "label",
                "labels",
                "label_id",
                "class",
                "classification",
                "class_id",
                "instance",
                "category",
            ],
        ),
        (VertexSlot::Confidence, &["confidence"]),
    ];
    let lower = name.to_ascii_lowercase();
    let plain = lower.strip_prefix("scalar_").unwrap_or(&lower);
    NAMES
        .iter()
        .find_map(|&(slot, names)| Some((slot, names.iter().position(|&known| known == plain)?)))
}

impl StoredColors {
    /// Returns the storage of all channels after adding one stored as `scalar`.
    fn with(self, scalar: &ScalarType) -> Self {
        let floating = match scalar {
            ScalarType::Char | ScalarType::UChar => return self,
            ScalarType::Float | ScalarType::Double => true,
            _ => false,
        };
        Self::Wide {
            floating: floating || self == Self::Wide { floating: true },
        }
    }
}

/// Returns the minimum number of bytes of a property in a binary file.
fn least_bytes(data_type: &PropertyType) -> u64 {
    let scalar = match data_type {
        PropertyType::Scalar(scalar) => scalar,
        PropertyType::List(count, _) => count,
    };
    match scalar {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    }
}

/// Returns the first line of a message of ply-rs, which may have several.
pub(super) fn first_line(text: &str) -> &str {
    text.lines()
        .next()
        .unwrap_or_default()
        .trim_end_matches('.')
}
