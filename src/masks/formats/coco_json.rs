//! JSON structure of a COCO data set, as far as masks need it.
//!
//! Parsing is lenient: an unreadable entry does not affect the others, ids may be numbers or text,
//! and fields that masks do not need may hold anything.

use std::fmt;

use serde::de::IgnoredAny;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// A COCO file.
#[derive(Serialize, Deserialize)]
pub(super) struct Dataset {
    pub images: Vec<ListEntry<ImageEntry>>,
    #[serde(default)]
    pub annotations: Vec<ListEntry<Annotation>>,
    #[serde(default)]
    pub categories: Vec<ListEntry<Category>>,
}

/// An entry of a list, which may lack required fields.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
pub(super) enum ListEntry<T> {
    Read(T),
    #[serde(skip_serializing)]
    Unreadable(IgnoredAny),
}

impl<T> ListEntry<T> {
    /// Returns the entry if it could be read.
    pub(super) fn read(&self) -> Option<&T> {
        match self {
            Self::Read(entry) => Some(entry),
            Self::Unreadable(_) => None,
        }
    }
}

/// An id, given as a number or text.
///
/// `1` and `"1"` are the same id.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Id(String);

impl Id {
    /// Returns the id as a number if it is one from 0 to 65535.
    pub(super) fn number(&self) -> Option<u16> {
        self.0.parse().ok()
    }
}

impl From<i64> for Id {
    fn from(number: i64) -> Self {
        Self(number.to_string())
    }
}

impl fmt::Display for Id {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl Serialize for Id {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.0.parse::<i64>() {
            Ok(number) => serializer.serialize_i64(number),
            Err(_) => serializer.serialize_str(&self.0),
        }
    }
}

impl<'de> Deserialize<'de> for Id {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = Scalar::deserialize(deserializer)?.text();
        text.map(Self)
            .ok_or_else(|| serde::de::Error::custom("an id must be a number or text"))
    }
}

/// A value that tools write either as a number or as text.
#[derive(Deserialize)]
#[serde(untagged)]
enum Scalar {
    Whole(i64),
    Number(f64),
    Text(String),
    Other(IgnoredAny),
}

impl Scalar {
    fn text(self) -> Option<String> {
        match self {
            Self::Whole(number) => Some(number.to_string()),
            Self::Number(number) => Some(number.to_string()),
            Self::Text(text) => Some(text.trim().to_owned()).filter(|text| !text.is_empty()),
            Self::Other(_) => None,
        }
    }
}

fn text<'de, D: Deserializer<'de>>(deserializer: D) -> Result<String, D::Error> {
    let text = Scalar::deserialize(deserializer)?.text();
    text.ok_or_else(|| serde::de::Error::custom("a name must be text"))
}

fn optional_text<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<String>, D::Error> {
    Ok(Scalar::deserialize(deserializer)?.text())
}

fn optional_size<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<u32>, D::Error> {
    let text = Scalar::deserialize(deserializer)?.text();
    Ok(text
        .and_then(|text| text.parse().ok())
        .filter(|&size| size > 0))
}

/// An image.
#[derive(Serialize, Deserialize)]
pub(super) struct ImageEntry {
    pub id: Id,
    #[serde(deserialize_with = "text")]
    pub file_name: String,
    /// Number of columns; missing in some files.
    #[serde(default, deserialize_with = "optional_size")]
    pub width: Option<u32>,
    /// Number of rows; missing in some files.
    #[serde(default, deserialize_with = "optional_size")]
    pub height: Option<u32>,
}

/// A category of objects.
#[derive(Serialize, Deserialize)]
pub(super) struct Category {
    pub id: Id,
    #[serde(deserialize_with = "text")]
    pub name: String,
    /// Name of the category above.
    ///
    /// At the top level it is the own name, missing, empty or `none`.
    #[serde(default, deserialize_with = "optional_text")]
    pub supercategory: Option<String>,
    /// Colour in sRGB, as in COCO's panoptic files; COCO Annotator writes `#rrggbb`.
    #[serde(
        default,
        deserialize_with = "optional_color",
        skip_serializing_if = "Option::is_none"
    )]
    pub color: Option<[u8; 3]>,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum CocoColor {
    Channels([u8; 3]),
    Text(String),
    Other(IgnoredAny),
}

fn optional_color<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<[u8; 3]>, D::Error> {
    Ok(match CocoColor::deserialize(deserializer)? {
        CocoColor::Channels(channels) => Some(channels),
        CocoColor::Text(text) => super::labels_json::parse_color(&text),
        CocoColor::Other(_) => None,
    })
}

/// An object on an image.
#[derive(Serialize, Deserialize)]
pub(super) struct Annotation {
    #[serde(default = "no_id", deserialize_with = "any_id")]
    pub id: Id,
    pub image_id: Id,
    pub category_id: Id,
    #[serde(default)]
    pub segmentation: Option<Segmentation>,
    /// Area in pixels; only written, because other tools' values are not needed.
    #[serde(skip_deserializing)]
    pub area: f64,
    /// Left, top, width and height in pixels; only written.
    #[serde(skip_deserializing)]
    pub bbox: Vec<f64>,
    /// Always 0; only written.
    #[serde(skip_deserializing)]
    pub iscrowd: u8,
}

fn no_id() -> Id {
    Id("without id".into())
}

fn any_id<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Id, D::Error> {
    Ok(Scalar::deserialize(deserializer)?
        .text()
        .map_or_else(no_id, Id))
}

/// Pixels of an object.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
pub(super) enum Segmentation {
    /// Polygons as x, y, x, y, … in pixels; the object is their union.
    ///
    /// `None` is a coordinate that is not a number.
    Polygons(Vec<Vec<Option<f64>>>),
    /// A single polygon without the enclosing list.
    Polygon(Vec<Option<f64>>),
    /// Run lengths down the columns.
    Runs {
        /// Height and width.
        size: [u32; 2],
        counts: RleCounts,
    },
    /// Any other value.
    #[serde(skip_serializing)]
    Unreadable(IgnoredAny),
}

/// Run lengths, plain or packed.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
pub(super) enum RleCounts {
    Plain(Vec<u32>),
    Packed(String),
}

/// Parses the text of a COCO file.
///
/// Python writes NaN and infinities as words that are not JSON; they are read as null.
///
/// # Errors
/// The parser's error.
pub(super) fn parse(text: &str) -> serde_json::Result<Dataset> {
    serde_json::from_str(text).or_else(|error| match without_number_words(text) {
        Some(text) => serde_json::from_str(&text),
        None => Err(error),
    })
}

/// Replaces `NaN` and `Infinity`, also with a minus sign, outside quotes with `null`.
///
/// Padding keeps the columns of long words. Returns `None` when the text contains no such word.
fn without_number_words(text: &str) -> Option<String> {
    let mut out = String::with_capacity(text.len());
    let (mut rest, mut found) = (text, false);
    while let Some(at) = rest.find(['"', 'N', 'I', '-']) {
        out.push_str(&rest[..at]);
        rest = &rest[at..];
        let word = ["NaN", "-Infinity", "Infinity", "-NaN"]
            .into_iter()
            .find(|word| rest.starts_with(word));
        let length = match word {
            Some(word) => {
                found = true;
                out.push_str("null");
                out.extend(std::iter::repeat_n(' ', word.len().saturating_sub(4)));
                word.len()
            }
            None => {
                let length = if rest.starts_with('"') {
                    quoted_length(rest)
                } else {
                    1
                };
                out.push_str(&rest[..length]);
                length
            }
        };
        rest = &rest[length..];
    }
    out.push_str(rest);
    found.then_some(out)
}

/// Returns the length in bytes of the quoted string at the start of `text`.
fn quoted_length(text: &str) -> usize {
    let mut escaped = false;
    let end = text.bytes().skip(1).position(|byte| {
        let ends = byte == b'"' && !escaped;
        escaped = byte == b'\\' && !escaped;
        ends
    });
    end.map_or(text.len(), |end| end + 2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn non_finite_numbers_outside_quotes_become_null() {
        let text = r#"{"NaN":"NaN -Infinity \" NaN","a":NaN,"b":[-Infinity,Infinity,-1]}"#;
        let expected = r#"{"NaN":"NaN -Infinity \" NaN","a":null,"b":[null     ,null    ,-1]}"#;
        assert_eq!(without_number_words(text).unwrap(), expected);
        assert_eq!(without_number_words(r#"{"a":"NaN"}"#), None);
    }

    #[test]
    fn ids_accept_numbers_and_text() {
        let ids: Vec<Id> = serde_json::from_str(r#"[1, "1", 1.0, " 1 ", "a-b", -3]"#).unwrap();
        assert!(ids[..4].iter().all(|id| *id == Id::from(1i64)));
        assert_eq!(serde_json::to_string(&ids[3..]).unwrap(), r#"[1,"a-b",-3]"#);
        assert!(
            serde_json::from_str::<Id>("null").is_err()
                && serde_json::from_str::<Id>("[1]").is_err()
        );
    }
}
