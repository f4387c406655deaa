use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;

use super::error::NnError;
use super::network_file::{Dialect, FileAddress, FileKind, NetworkFile};
use super::runtime::library_name;
use super::runtime_package::RuntimePackage;
use super::tensor::{Port, Signature};

/// The known networks, in the order in which they are listed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Catalogue {
    entries: Vec<CatalogueEntry>,
}

/// One network, or ONNX Runtime itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CatalogueEntry {
    /// Name on the command line.
    pub name: String,
    /// Purpose, as shown to users.
    pub purpose: String,
    /// Licence of the weights, as shown to users.
    pub licence: String,
    /// Address of the licence if the user has to accept it before a download.
    pub accept_licence: Option<String>,
    /// Where to get it.
    pub source: String,
    is_library: bool,
    variants: Vec<NetworkVariant>,
}

/// One set of files of a network: a precision or an export.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NetworkVariant {
    /// Name on the command line; empty if it is the only one.
    pub name: String,
    /// What distinguishes it, as shown to users.
    pub summary: String,
    /// Its interface, if several are in use.
    pub dialect: Option<Dialect>,
    /// Least memory that it needs, in MB, if known.
    pub memory_mb: Option<u64>,
    /// Its files.
    pub files: Vec<NetworkFile>,
}

impl NetworkVariant {
    /// Returns whether all files can be downloaded.
    #[must_use]
    pub fn has_address(&self) -> bool {
        self.files.iter().all(|file| !file.addresses.is_empty())
    }

    /// Returns the number of bytes to download, if known; an archive counts once.
    #[must_use]
    pub fn download_bytes(&self) -> Option<u64> {
        self.total(NetworkFile::download_bytes)
    }

    /// Returns the estimated number of bytes to download, if the exact one is not known.
    #[must_use]
    pub fn about_bytes(&self) -> Option<u64> {
        let estimate = || self.total(NetworkFile::about_download_bytes);
        self.download_bytes().map_or_else(estimate, |_| None)
    }

    fn total(&self, bytes: fn(&NetworkFile) -> Option<u64>) -> Option<u64> {
        let first = |file: &NetworkFile| file.addresses.first().map(|address| address.url.clone());
        let mut seen = Vec::new();
        let mut total = 0;
        for file in &self.files {
            let url = first(file)?;
            if !seen.contains(&url) {
                total += bytes(file)?;
                seen.push(url);
            }
        }
        Some(total)
    }
}

impl Catalogue {
    /// Returns the catalogue: the file named in `OSTRA_NETWORKS`, or that of the program.
    ///
    /// # Errors
    /// Fails if the file cannot be read or parsed.
    pub fn load() -> Result<Self, NnError> {
        let named = std::env::var_os("OSTRA_NETWORKS").filter(|path| !path.is_empty());
        let Some(path) = named else {
            return Self::bundled();
        };
        let path = Path::new(&path);
        let text = std::fs::read_to_string(path).map_err(|reason| NnError::Io {
            path: path.to_owned(),
            reason,
        })?;
        Self::parse(&text).map_err(|error| NnError::Request(format!("{}: {error}", path.display())))
    }

    /// Returns the catalogue that is compiled into the program.
    ///
    /// # Errors
    /// Fails if it cannot be parsed, which a test rules out.
    pub fn bundled() -> Result<Self, NnError> {
        let text = include_str!(concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../../assets/models.toml"
        ));
        Self::parse(text).map_err(|error| NnError::Request(format!("assets/models.toml: {error}")))
    }

    /// Parses a catalogue.
    ///
    /// # Errors
    /// Fails if the text is not TOML of the form described in `assets/models.toml`.
    pub fn parse(text: &str) -> Result<Self, NnError> {
        let one_line = |error: &toml::de::Error| {
            let words: Vec<&str> = error.message().split_whitespace().collect();
            let line = error
                .span()
                .map(|span| text[..span.start].lines().count().max(1));
            line.map_or_else(
                || words.join(" "),
                |line| format!("line {line}: {}", words.join(" ")),
            )
        };
        let parsed: CatalogueText =
            toml::from_str(text).map_err(|error| NnError::Request(one_line(&error)))?;
        let entries = parsed
            .entries
            .into_iter()
            .map(|entry| entry.into_entry(&parsed.interfaces))
            .collect::<Result<_, _>>()
            .map_err(NnError::Request)?;
        Ok(Self { entries })
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
        self.is_library
    }

    /// Returns all variants, the recommended one first; none for ONNX Runtime.
    #[must_use]
    pub fn variants(&self) -> &[NetworkVariant] {
        &self.variants
    }

    /// Returns the files of the recommended variant; none for ONNX Runtime.
    #[must_use]
    pub fn files(&self) -> &[NetworkFile] {
        self.variants
            .first()
            .map_or(&[], |variant| variant.files.as_slice())
    }

    /// Returns the names of the files in the folder of networks.
    #[must_use]
    pub fn file_names(&self) -> Vec<String> {
        if self.is_library {
            return vec![library_name()];
        }
        self.files().iter().map(|file| file.name.clone()).collect()
    }

    /// Returns the variant called `name`.
    pub(super) fn variant(&self, name: &str) -> Option<&NetworkVariant> {
        self.variants.iter().find(|variant| variant.name == name)
    }

    /// Returns whether it can be downloaded for this system.
    #[must_use]
    pub fn has_address(&self) -> bool {
        if self.is_library {
            return RuntimePackage::for_this_system().is_ok();
        }
        self.variants.iter().any(NetworkVariant::has_address)
    }

    /// Creates the error for files without a download address.
    pub(super) fn without_address(&self) -> NnError {
        let Self { name, source, .. } = self;
        NnError::Request(format!(
            "`{name}` has no address to be fetched from; get it from {source} and run `ostra models add {name} {}`",
            self.file_words()
        ))
    }

    /// Creates the error for a file that is missing in `folder`.
    pub(super) fn missing(&self, folder: &Path) -> NnError {
        let Self { name, source, .. } = self;
        let remedy = if self.has_address() {
            format!("run `ostra models install {name}`")
        } else {
            format!(
                "get it from {source} and run `ostra models add {name} {}`",
                self.file_words()
            )
        };
        NnError::Request(format!(
            "`{name}` is not installed ({}); {remedy}",
            folder.display()
        ))
    }

    fn file_words(&self) -> &'static str {
        if self.file_names().len() == 1 {
            "FILE"
        } else {
            "FILE…"
        }
    }
}

/// The file of a catalogue.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CatalogueText {
    #[serde(rename = "entry")]
    entries: Vec<EntryText>,
    /// Interfaces that several files share, by name.
    #[serde(default, rename = "interface")]
    interfaces: BTreeMap<String, InterfaceText>,
}

#[derive(Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct InterfaceText {
    inputs: Vec<Port>,
    outputs: Vec<Port>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct EntryText {
    name: String,
    purpose: String,
    licence: String,
    #[serde(default)]
    accept_licence: Option<String>,
    source: String,
    #[serde(default)]
    library: bool,
    #[serde(default)]
    file: Vec<FileText>,
    #[serde(default)]
    variant: Vec<VariantText>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct VariantText {
    name: String,
    summary: String,
    #[serde(default)]
    dialect: Option<Dialect>,
    #[serde(default)]
    memory_mb: Option<u64>,
    file: Vec<FileText>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FileText {
    name: String,
    #[serde(default)]
    text: bool,
    #[serde(default)]
    data: bool,
    #[serde(default)]
    bytes: Option<u64>,
    #[serde(default)]
    about_mb: Option<u64>,
    #[serde(default)]
    sha256: Option<String>,
    #[serde(default)]
    other_sha256: Vec<String>,
    /// The only address, of the file itself.
    #[serde(default)]
    url: Option<String>,
    #[serde(default)]
    from: Vec<FileAddress>,
    /// Name of a shared interface.
    #[serde(default)]
    interface: Option<String>,
    #[serde(default)]
    inputs: Vec<Port>,
    #[serde(default)]
    outputs: Vec<Port>,
}

type Interfaces = BTreeMap<String, InterfaceText>;

impl EntryText {
    fn into_entry(self, interfaces: &Interfaces) -> Result<CatalogueEntry, String> {
        let name = &self.name;
        let mut variants = Vec::new();
        if !self.file.is_empty() {
            if !self.variant.is_empty() {
                return Err(format!("`{name}` has both files and variants"));
            }
            variants.push(NetworkVariant {
                name: String::new(),
                summary: String::new(),
                dialect: None,
                memory_mb: None,
                files: files(self.file, interfaces)?,
            });
        }
        for variant in self.variant {
            variants.push(NetworkVariant {
                name: variant.name,
                summary: variant.summary,
                dialect: variant.dialect,
                memory_mb: variant.memory_mb,
                files: files(variant.file, interfaces)?,
            });
        }
        if self.library != variants.is_empty() {
            return Err(format!("`{name}` needs files, and a library has none"));
        }
        Ok(CatalogueEntry {
            name: self.name,
            purpose: self.purpose,
            licence: self.licence,
            accept_licence: self.accept_licence,
            source: self.source,
            is_library: self.library,
            variants,
        })
    }
}

fn files(texts: Vec<FileText>, interfaces: &Interfaces) -> Result<Vec<NetworkFile>, String> {
    texts
        .into_iter()
        .map(|text| text.into_file(interfaces))
        .collect()
}

impl FileText {
    fn into_file(self, interfaces: &Interfaces) -> Result<NetworkFile, String> {
        let name = &self.name;
        // The name becomes a path in the folder of networks.
        if name.is_empty() || name.starts_with('.') || name.contains(['/', '\\']) {
            return Err(format!("`{name}` is not a file name"));
        }
        let kind = match (self.text, self.data) {
            (false, false) => FileKind::Network,
            (true, false) => FileKind::Text,
            (false, true) => FileKind::Data,
            (true, true) => return Err(format!("`{name}` cannot be both text and data")),
        };
        let mut addresses = self.from;
        addresses.extend(self.url.as_deref().map(FileAddress::plain));
        for FileAddress {
            url,
            member,
            is_gzip,
            bytes,
            sha256,
        } in &addresses
        {
            if member.is_some() && *is_gzip {
                return Err(format!("{url}: is either a ZIP archive or gzip"));
            }
            let is_packed = member.is_some() || *is_gzip;
            if !is_packed && (bytes.is_some() || sha256.is_some()) {
                return Err(format!(
                    "{url}: size and digest of a file that is not packed belong to the file"
                ));
            }
        }
        let signature = match &self.interface {
            Some(interface) => {
                let shared = interfaces
                    .get(interface)
                    .ok_or_else(|| format!("`{name}`: there is no interface `{interface}`"))?;
                Some(Signature {
                    inputs: shared.inputs.clone(),
                    outputs: shared.outputs.clone(),
                })
            }
            None => (!self.inputs.is_empty() || !self.outputs.is_empty()).then_some(Signature {
                inputs: self.inputs,
                outputs: self.outputs,
            }),
        };
        Ok(NetworkFile {
            name: self.name,
            kind,
            bytes: self.bytes,
            about_mb: self.about_mb,
            sha256: self.sha256,
            other_sha256: self.other_sha256,
            addresses,
            signature,
        })
    }
}
