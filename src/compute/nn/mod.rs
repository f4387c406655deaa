//! Networks in the ONNX format.
//!
//! The module finds and loads ONNX Runtime, loads networks, checks the names and shapes of their
//! inputs and outputs, and runs them. It also has the catalogue of weights and installs them.

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

pub use add::{Added, Verification, add};
pub use catalogue::{Catalogue, CatalogueEntry, NetworkFile};
pub use error::NnError;
pub use install::{Fetched, install};
pub use installed::{CheckedFile, Installed, ModelStatus, check, list, load, load_text};
pub use network::Network;
pub use runtime::{Provider, Runtime, models_folder, take_fall_backs};
pub use tensor::{Element, Port, Signature, Tensor, TensorValues};
