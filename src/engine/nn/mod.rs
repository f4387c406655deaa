//! Networks in the ONNX format: find ONNX Runtime, load, check names and shapes, run; the catalogue of weights.
//!
//! May use: `ort` (only here). Must not touch: what the tensors mean.

mod catalogue;
mod digest;
mod error;
mod install;
mod installed;
mod network;
mod runtime;
mod search;
mod signature;
mod tensor;

#[cfg(test)]
mod tests;

pub use catalogue::{Catalogue, Entry, NetworkFile};
pub use error::NnError;
pub use install::{Added, Proof, add};
pub use installed::{CheckedFile, Installed, Row, check, list, load, load_text};
pub use network::Network;
pub use runtime::Runtime;
pub use search::models_folder;
pub use signature::{Element, Port, Signature};
pub use tensor::{Tensor, TensorValues};
