//! Networks in the ONNX format: find ONNX Runtime, load, check names and shapes, run; the catalogue of weights, and
//! getting them.

mod add;
mod catalogue;
mod digests;
mod download;
mod error;
mod install;
mod installed;
mod network;
mod runtime;
mod tensor;

#[cfg(test)]
mod tests;

pub use add::{Added, Proof, add};
pub use catalogue::{Catalogue, Entry, NetworkFile};
pub use error::NnError;
pub use install::{Fetched, install};
pub use installed::{CheckedFile, Installed, Row, check, list, load, load_text};
pub use network::Network;
pub use runtime::{Provider, Runtime, models_folder, take_fall_backs};
pub use tensor::{Element, Port, Signature, Tensor, TensorValues};
