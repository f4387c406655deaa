use std::path::Path;

use serde::Deserialize;

use super::error::NnError;
use super::runtime::library_name;
use super::tensor::{Port, Signature};

/// The known networks, in the order in which they are listed.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Catalogue {
    #[serde(rename = "entry")]
    entries: Vec<CatalogueEntry>,
}

/// One network, or ONNX Runtime itself.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CatalogueEntry {
    /// Name on the command line.
    pub name: String,
    /// Purpose, as shown to users.
    pub purpose: String,
    /// Licence of the weights, as shown to users.
    pub licence: String,
    /// Where to get it.
    pub source: String,
    #[serde(default)]
    library: bool,
    #[serde(default, rename = "file")]
    files: Vec<NetworkFile>,
}

/// One file of a network, or a text file that belongs to it.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NetworkFile {
    /// Name in the folder of networks.
    pub name: String,
    /// Digest of a file that is known to work, lower-case hexadecimal.
    #[serde(default)]
    pub sha256: Option<String>,
    /// Digests of other files that are known to work, lower-case hexadecimal.
    #[serde(default)]
    pub other_sha256: Vec<String>,
    /// Download address; `None` if the file must be exported.
    #[serde(default)]
    pub url: Option<String>,
    /// Size in bytes, if known.
    #[serde(default)]
    pub bytes: Option<u64>,
    /// Whether this is a text file that belongs to a network, such as its vocabulary.
    #[serde(default, rename = "text")]
    pub is_text: bool,
    #[serde(default)]
    inputs: Vec<Port>,
    #[serde(default)]
    outputs: Vec<Port>,
}

impl Catalogue {
    /// Returns the catalogue that is compiled into the program.
    ///
    /// # Errors
    /// Fails if it cannot be parsed, which a test rules out.
    pub fn bundled() -> Result<Self, NnError> {
        let text = include_str!(concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../../assets/models.toml"
        ));
        toml::from_str(text)
            .map_err(|error| NnError::Request(format!("assets/models.toml: {error}")))
    }

    /// Returns all entries.
    #[must_use]
    pub fn entries(&self) -> &[CatalogueEntry] {
        &self.entries
    }

    /// Returns the entry called `name`.
    ///
    /// # Errors
    /// Fails if there is none; the message lists the known names.
    pub fn entry(&self, name: &str) -> Result<&CatalogueEntry, NnError> {
        self.entries
            .iter()
            .find(|entry| entry.name == name)
            .ok_or_else(|| {
                let known = self
                    .entries
                    .iter()
                    .map(|entry| entry.name.as_str())
                    .collect::<Vec<_>>()
                    .join(", ");
                NnError::Request(format!("there is no network `{name}`; known are {known}"))
            })
    }
}

impl CatalogueEntry {
    /// Returns whether this is ONNX Runtime itself and not a network.
    #[must_use]
    pub fn is_library(&self) -> bool {
        self.library
    }

    /// Returns the network's files in the order of the catalogue; none for ONNX Runtime.
    #[must_use]
    pub fn files(&self) -> &[NetworkFile] {
        &self.files
    }

    /// Returns the names of the files in the folder of networks.
    #[must_use]
    pub fn file_names(&self) -> Vec<String> {
        if self.library {
            return vec![library_name()];
        }
        self.files.iter().map(|file| file.name.clone()).collect()
    }

    /// Returns whether all files can be downloaded.
    #[must_use]
    pub fn has_address(&self) -> bool {
        self.files.iter().all(|file| file.url.is_some())
    }

    /// Creates the error for files without a download address.
    pub(super) fn without_address(&self) -> NnError {
        let Self { name, source, .. } = self;
        let words = if self.file_names().len() == 1 {
            "FILE"
        } else {
            "FILE…"
        };
        NnError::Request(format!(
            "`{name}` has no address to be fetched from; get it from {source} and run `ostra models add {name} {words}`"
        ))
    }

    /// Creates the error for a file that is missing in `folder`.
    pub(super) fn missing(&self, folder: &Path) -> NnError {
        let Self { name, source, .. } = self;
        let words = if self.file_names().len() == 1 {
            "FILE"
        } else {
            "FILE…"
        };
        NnError::Request(format!(
            "`{name}` is not installed ({}); get it from {source} and run `ostra models add {name} {words}`",
            folder.display()
        ))
    }
}

impl NetworkFile {
    /// Returns the expected inputs and outputs; `None` if they are not specified.
    #[must_use]
    pub fn signature(&self) -> Option<Signature> {
        let is_given = !(self.inputs.is_empty() && self.outputs.is_empty());
        is_given.then(|| Signature {
            inputs: self.inputs.clone(),
            outputs: self.outputs.clone(),
        })
    }
}
