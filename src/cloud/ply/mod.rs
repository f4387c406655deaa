//! Labelled clouds and meshes in PLY files: writes its own form, reads those of other programs.
//!
//! Files are written as binary little-endian with `x y z nx ny nz` (float), `red green blue`
//! (uchar), `label` (int) and `confidence` (float). The label is an int because Open3D and MeshLab
//! skip ushort; files with a ushort `label` can still be read. The faces of a mesh are the list
//! `vertex_indices`.
//!
//! Comments hold the rest. There is `comment origin X Y Z` if positions are relative to an origin.
//! Each label has `comment label ID PARENT NAME` (PARENT 0 = none) and `comment color ID RRGGBB`.
//! Comments are ASCII; other characters in names are escaped as `\u{HEX}`.

mod comments;
mod elements;
mod header;
mod read;
mod split;
#[cfg(test)]
mod tests;
mod vertex;
mod write;

pub(super) use comments::{comments_of, origin_comment};
pub use read::{PlyCloud, read_mesh, read_ply};
pub use split::{LabelPart, label_paths, save_per_label, split_by_label, twin_path};
pub(super) use split::{file_part, label_name};
pub use write::{SavedColors, save_mesh, save_ply, write_ply};
