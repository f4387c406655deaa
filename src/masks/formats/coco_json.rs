//! The JSON of a COCO data set, as far as masks need it.

use serde::{Deserialize, Serialize};

/// The whole file.
#[derive(Serialize, Deserialize)]
pub(super) struct Dataset {
    pub images: Vec<ImageEntry>,
    #[serde(default)]
    pub annotations: Vec<Annotation>,
    #[serde(default)]
    pub categories: Vec<Category>,
}

/// A picture.
#[derive(Serialize, Deserialize)]
pub(super) struct ImageEntry {
    pub id: i64,
    pub file_name: String,
    pub width: u32,
    pub height: u32,
}

/// A kind of object.
#[derive(Serialize, Deserialize)]
pub(super) struct Category {
    pub id: i64,
    pub name: String,
    /// Name of the category above; its own name, nothing or `none` at the top.
    #[serde(default)]
    pub supercategory: Option<String>,
    /// sRGB, as in COCO's panoptic files.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub color: Option<[u8; 3]>,
}

/// One object on one picture.
#[derive(Serialize, Deserialize)]
pub(super) struct Annotation {
    #[serde(default)]
    pub id: i64,
    pub image_id: i64,
    pub category_id: i64,
    #[serde(default)]
    pub segmentation: Option<Segmentation>,
    /// Pixels.
    #[serde(default)]
    pub area: f64,
    /// Left, top, width, height in pixels.
    #[serde(default)]
    pub bbox: Vec<f64>,
    #[serde(default)]
    pub iscrowd: u8,
}

/// The pixels of an object.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
pub(super) enum Segmentation {
    /// Polygons as x, y, x, y, … in pixels; the object is all of them together.
    Polygons(Vec<Vec<f64>>),
    /// Run lengths down the columns.
    Runs {
        /// Height, width.
        size: [u32; 2],
        counts: Counts,
    },
}

/// Run lengths, plain or packed.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
pub(super) enum Counts {
    Plain(Vec<u32>),
    Packed(String),
}
