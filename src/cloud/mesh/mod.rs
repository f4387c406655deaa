//! Labelled meshes: splitting by label, label borders, simplification.

mod labelled_mesh;
mod quadric;
mod simplify;
#[cfg(test)]
mod tests;
mod welded;

pub use labelled_mesh::LabelledMesh;
