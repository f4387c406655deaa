//! The JSON of a COCO data set, as far as masks need it. Reading is lenient: an entry that cannot be understood does not
//! cost the others, ids may be numbers or text, and fields that masks do not need may hold anything.

use std::fmt;

use serde::de::IgnoredAny;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// The whole file.
#[derive(Serialize, Deserialize)]
pub(super) struct Dataset {
    pub images: Vec<Entry<ImageEntry>>,
    #[serde(default)]
    pub annotations: Vec<Entry<Annotation>>,
    #[serde(default)]
    pub categories: Vec<Entry<Category>>,
}

/// An entry of a list, which may lack what is needed of it.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
pub(super) enum Entry<T> {
    Read(T),
    #[serde(skip_serializing)]
    Unreadable(IgnoredAny),
}

impl<T> Entry<T> {
    /// The entry, where it could be read.
    pub(super) fn read(&self) -> Option<&T> {
        match self {
            Self::Read(entry) => Some(entry),
            Self::Unreadable(_) => None,
        }
    }
}

/// An id: a number or any text; `1` and `"1"` are the same id.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Id(String);

impl Id {
    /// The id as a number from 0 to 65535, where it is one.
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

/// A value that tools write as a number or as text.
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
    /// Columns; missing in some files.
    #[serde(default, deserialize_with = "optional_size")]
    pub width: Option<u32>,
    /// Rows.
    #[serde(default, deserialize_with = "optional_size")]
    pub height: Option<u32>,
}

/// A kind of object.
#[derive(Serialize, Deserialize)]
pub(super) struct Category {
    pub id: Id,
    #[serde(deserialize_with = "text")]
    pub name: String,
    /// Name of the category above; its own name, nothing or `none` at the top.
    #[serde(default, deserialize_with = "optional_text")]
    pub supercategory: Option<String>,
    /// sRGB, as in COCO's panoptic files; COCO Annotator writes `#rrggbb`.
    #[serde(
        default,
        deserialize_with = "optional_color",
        skip_serializing_if = "Option::is_none"
    )]
    pub color: Option<[u8; 3]>,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Color {
    Channels([u8; 3]),
    Text(String),
    Other(IgnoredAny),
}

fn optional_color<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<[u8; 3]>, D::Error> {
    Ok(match Color::deserialize(deserializer)? {
        Color::Channels(channels) => Some(channels),
        Color::Text(text) => super::labels_json::parse_color(&text),
        Color::Other(_) => None,
    })
}

/// One object on one image.
#[derive(Serialize, Deserialize)]
pub(super) struct Annotation {
    #[serde(default = "no_id", deserialize_with = "any_id")]
    pub id: Id,
    pub image_id: Id,
    pub category_id: Id,
    #[serde(default)]
    pub segmentation: Option<Segmentation>,
    /// Pixels. Only written: masks do not need what others put here.
    #[serde(skip_deserializing)]
    pub area: f64,
    /// Left, top, width, height in pixels. Only written.
    #[serde(skip_deserializing)]
    pub bbox: Vec<f64>,
    /// Only written.
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

/// The pixels of an object.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
pub(super) enum Segmentation {
    /// Polygons as x, y, x, y, … in pixels; the object is all of them together. `None` is a coordinate that is not a number.
    Polygons(Vec<Vec<Option<f64>>>),
    /// One polygon without the list around it.
    Polygon(Vec<Option<f64>>),
    /// Run lengths down the columns.
    Runs {
        /// Height, width.
        size: [u32; 2],
        counts: Counts,
    },
    /// Anything else.
    #[serde(skip_serializing)]
    Unreadable(IgnoredAny),
}

/// Run lengths, plain or packed.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
pub(super) enum Counts {
    Plain(Vec<u32>),
    Packed(String),
}

/// Reads a file's text. Python writes NaN and infinities as words that are not JSON; they are read as null.
///
/// # Errors
/// What the parser found.
pub(super) fn parse(text: &str) -> serde_json::Result<Dataset> {
    serde_json::from_str(text).or_else(|error| match without_number_words(text) {
        Some(text) => serde_json::from_str(&text),
        None => Err(error),
    })
}

/// The text with `NaN`, `Infinity` and `-Infinity` outside of quotes put as `null`, padded so that columns stay; `None`
/// when there is none.
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

/// Length in bytes of the quoted text that `text` begins with.
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
    fn words_for_numbers_become_null_outside_of_quotes() {
        let text = r#"{"NaN":"NaN -Infinity \" NaN","a":NaN,"b":[-Infinity,Infinity,-1]}"#;
        let expected = r#"{"NaN":"NaN -Infinity \" NaN","a":null,"b":[null     ,null    ,-1]}"#;
        assert_eq!(without_number_words(text).unwrap(), expected);
        assert_eq!(without_number_words(r#"{"a":"NaN"}"#), None);
    }

    #[test]
    fn ids_are_numbers_or_text() {
        let ids: Vec<Id> = serde_json::from_str(r#"[1, "1", 1.0, " 1 ", "a-b", -3]"#).unwrap();
        assert!(ids[..4].iter().all(|id| *id == Id::from(1i64)));
        assert_eq!(serde_json::to_string(&ids[3..]).unwrap(), r#"[1,"a-b",-3]"#);
        assert!(
            serde_json::from_str::<Id>("null").is_err()
                && serde_json::from_str::<Id>("[1]").is_err()
        );
    }
}
