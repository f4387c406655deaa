//! Masks in files: one file per format, each with import and export, and what they share.

mod adopt;
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
mod labels_json;
mod layers;
mod png_decode;
mod png_values;
mod rle;
mod yolo;
mod yolo_names;

pub use davis::{encode_palette_png, read_palette_png, read_palette_png_of};
pub use exchange::{MaskFormat, export_masks, import_masks};
pub(super) use files::{FoundFile, Skipped, in_parallel, list_files, unless_stopped};
pub(super) use frame_matching::NameIndex;
pub use frame_matching::{Imported, MaskFrame, file_stems};
pub(super) use grey_kinds::{White, ids_in, is_black_and_white, meaning_of_white, white_as_one};
pub(super) use labels_json::{ids_of_colors, listed_labels};
pub use labels_json::{read_labels_json, write_labels_json};
pub(super) use png_values::{PngValues, reconcile_cut_outs};

#[cfg(test)]
mod tests;
