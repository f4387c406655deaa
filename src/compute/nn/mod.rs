//! Networks in the ONNX format: find ONNX Runtime, load, check names and shapes, run; the catalogue of weights, and
//! getting them.

mod catalogue;
mod digest;
mod error;
mod fetch;
mod get;
mod install;
mod installed;
mod network;
mod provider;
mod records;
mod runtime;
mod search;
mod signature;
mod tensor;
mod unzip;
mod watched;
mod wheel;

#[cfg(test)]
mod tests;

pub use catalogue::{Catalogue, Entry, NetworkFile};
pub use error::NnError;
pub use get::{Fetched, install};
pub use install::{Added, Proof, add};
pub use installed::{CheckedFile, Installed, Row, check, list, load, load_text};
pub use network::Network;
pub use provider::{Provider, take_fall_backs};
pub use runtime::Runtime;
pub use search::models_folder;
pub use signature::{Element, Port, Signature};
pub use tensor::{Tensor, TensorValues};
