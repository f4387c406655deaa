//! Import and export of masks, with one file per format and shared parts.

mod binary;
mod coco;
mod coco_categories;
mod coco_draw;
mod coco_json;
mod davis;
mod exchange;
mod files;
mod frame_matching;
mod grey_kinds;
mod label_import;
mod labels_json;
mod layers;
mod mask_folder;
mod png_decode;
mod png_values;
mod rle;
mod yolo;
mod yolo_names;

pub use davis::{encode_palette_png, read_palette_png, read_palette_png_of};
pub use exchange::MaskFormat;
pub use frame_matching::{Imported, MaskFrame, file_stems};
pub use labels_json::{read_labels_json, write_labels_json};
pub use mask_folder::{MaskFolder, MatchedMask, MatchedMasks};

#[cfg(test)]
mod tests;
