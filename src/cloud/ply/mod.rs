//! Labelled clouds and meshes in PLY files: our own form out, anybody's form in.
//!
//! Written: binary little-endian, `x y z nx ny nz` float, `red green blue` uchar, `label` int (Open3D and MeshLab skip
//! ushort), `confidence` float; `comment origin X Y Z` where positions are relative to one; `comment label ID PARENT
//! NAME` (PARENT 0 = none) and `comment color ID RRGGBB` for each label, in ASCII: other characters of names are
//! escaped as `\\u{HEX}`; a mesh's faces as the list `vertex_indices`. Files with a ushort `label` are still read.

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
pub use write::{Coloring, save_mesh, save_ply, write_ply};
