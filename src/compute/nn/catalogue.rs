use std::path::Path;

use serde::Deserialize;

use super::error::NnError;
use super::runtime::library_name;
use super::tensor::{Port, Signature};

/// The networks that the program knows of, in the order in which they are listed.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Catalogue {
    #[serde(rename = "entry")]
    entries: Vec<Entry>,
}

/// One network, or ONNX Runtime itself.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    /// What it is called on the command line.
    pub name: String,
    /// What it is good for, for people.
    pub purpose: String,
    /// Licence of the weights, for people.
    pub licence: String,
    /// Where it can be had.
    pub source: String,
    #[serde(default)]
    library: bool,
    #[serde(default, rename = "file")]
    files: Vec<NetworkFile>,
}

/// One file of a network, or of text that goes with it.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NetworkFile {
    /// Its name in the folder of networks.
    pub name: String,
    /// Digest of a file that is known to work, lower-case hexadecimal.
    #[serde(default)]
    pub sha256: Option<String>,
    /// Digests of other files that are known to work, lower-case hexadecimal.
    #[serde(default)]
    pub other_sha256: Vec<String>,
    /// Where it can be fetched from; `None` where it has to be made.
    #[serde(default)]
    pub url: Option<String>,
    /// Its size, where known.
    #[serde(default)]
    pub bytes: Option<u64>,
    /// Whether it is text that goes with a network (the words it knows), not a network.
    #[serde(default, rename = "text")]
    pub is_text: bool,
    #[serde(default)]
    inputs: Vec<Port>,
    #[serde(default)]
    outputs: Vec<Port>,
}

impl Catalogue {
    /// The catalogue that the program carries.
    ///
    /// # Errors
    /// When it does not parse, which a test excludes.
    pub fn bundled() -> Result<Self, NnError> {
        let text = include_str!(concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../../assets/models.toml"
        ));
        toml::from_str(text)
            .map_err(|error| NnError::Request(format!("assets/models.toml: {error}")))
    }

    /// All entries.
    #[must_use]
    pub fn entries(&self) -> &[Entry] {
        &self.entries
    }

    /// The entry called `name`.
    ///
    /// # Errors
    /// When there is none; says which there are.
    pub fn entry(&self, name: &str) -> Result<&Entry, NnError> {
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

impl Entry {
    /// Whether this is ONNX Runtime itself and no network.
    #[must_use]
    pub fn is_library(&self) -> bool {
        self.library
    }

    /// The network's files, in the order in which they are given; none for ONNX Runtime itself.
    #[must_use]
    pub fn files(&self) -> &[NetworkFile] {
        &self.files
    }

    /// Names of its files in the folder of networks.
    #[must_use]
    pub fn file_names(&self) -> Vec<String> {
        if self.library {
            return vec![library_name()];
        }
        self.files.iter().map(|file| file.name.clone()).collect()
    }

    /// Whether all of its files can be fetched.
    #[must_use]
    pub fn has_address(&self) -> bool {
        self.files.iter().all(|file| file.url.is_some())
    }

    /// The error for files that cannot be fetched.
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

    /// The error for one of its files that is not in `folder`.
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
    /// What the file must take and give; `None` if that is not specified.
    #[must_use]
    pub fn signature(&self) -> Option<Signature> {
        let is_told = !(self.inputs.is_empty() && self.outputs.is_empty());
        is_told.then(|| Signature {
            inputs: self.inputs.clone(),
            outputs: self.outputs.clone(),
        })
    }
}
