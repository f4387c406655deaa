//! The labelled mesh: parts by label, borders between labels, fewer triangles.
//!
//! May use: masks, engine::job. Must not touch: files.

mod collapse;
mod edges;
mod fans;
mod labelled_mesh;
mod quadric;
mod simplify;
#[cfg(test)]
mod tests;
mod weld;

pub use labelled_mesh::LabelledMesh;
