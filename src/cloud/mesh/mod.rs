//! The labelled mesh: parts by label, borders between labels, fewer triangles.

mod labelled_mesh;
mod quadric;
mod simplify;
#[cfg(test)]
mod tests;
mod welded;

pub use labelled_mesh::LabelledMesh;
