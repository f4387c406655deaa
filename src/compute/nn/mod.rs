//! Networks in the ONNX format.
//!
//! The module finds and loads ONNX Runtime, loads networks, checks the names and shapes of their
//! inputs and outputs, and runs them. It also has the catalogue of weights and installs them.

mod add;
mod addresses;
mod catalogue;
mod digests;
mod download;
mod error;
mod fitting;
mod install;
mod installed;
mod mirror;
mod network;
mod network_file;
mod obtain;
mod records;
mod runtime;
mod runtime_package;
mod tensor;
mod transfer;
mod unfinished;
mod unpack;

#[cfg(test)]
mod tests;

pub use add::{Added, Verification, add};
pub use addresses::{ListedAddress, addresses};
pub use catalogue::{Catalogue, CatalogueEntry, NetworkVariant};
pub use error::NnError;
pub use install::{InstallOptions, install, remove};
pub use installed::{
    CheckedFile, Installed, LoadedNetworks, ModelStatus, TestResult, VariantStatus, check, list,
    load, load_text, load_with_dialect, record_test,
};
pub use network::Network;
pub use network_file::{Dialect, FileAddress, FileKind, NetworkFile};
pub use obtain::Fetched;
pub use runtime::{Provider, Runtime, models_folder, take_fall_backs};
pub use tensor::{Element, Port, Signature, Tensor, TensorValues};
