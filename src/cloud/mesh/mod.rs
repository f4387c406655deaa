//! The labelled mesh: parts by label, borders between labels, fewer triangles.

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
