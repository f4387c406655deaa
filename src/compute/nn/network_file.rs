use std::path::Path;

use serde::{Deserialize, Serialize};

use super::error::NnError;
use super::tensor::Signature;

/// One file of a network, or a file that belongs to it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NetworkFile {
    /// Name in the folder of networks.
    pub name: String,
    /// How the file is used.
    pub kind: FileKind,
    /// Size in bytes, if known.
    pub bytes: Option<u64>,
    /// Estimated size in MB, if the exact one is not known.
    pub about_mb: Option<u64>,
    /// Digest of a file that is known to work, lower-case hexadecimal.
    pub sha256: Option<String>,
    /// Digests of other files that are known to work, lower-case hexadecimal.
    pub other_sha256: Vec<String>,
    /// Download addresses, the preferred one first; none if the file must be exported.
    pub addresses: Vec<FileAddress>,
    /// Expected inputs and outputs; `None` if they are not specified.
    pub signature: Option<Signature>,
}

/// How a file of a network is used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileKind {
    /// An ONNX network, which is loaded.
    Network,
    /// UTF-8 text, such as a vocabulary.
    Text,
    /// Weights that a network reads itself, by this name, from its own folder.
    Data,
}

/// An address from which a file can be downloaded.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileAddress {
    /// Address of the file, or of the archive that contains it.
    pub url: String,
    /// Path of the file in a ZIP archive.
    #[serde(default)]
    pub member: Option<String>,
    /// Whether the address has the file compressed by gzip.
    #[serde(default, rename = "gzip")]
    pub is_gzip: bool,
    /// Size of the archive in bytes, if known.
    #[serde(default)]
    pub bytes: Option<u64>,
    /// Digest of the archive, lower-case hexadecimal.
    #[serde(default)]
    pub sha256: Option<String>,
}

/// Interface of a network for which several are in use.
///
/// Public files of the same weights differ in the names of their inputs and in what they do to an
/// image themselves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Dialect {
    /// Segment Anything: the encoder takes `image`, normalised and padded, channels first.
    Sam,
    /// As [`Dialect::Sam`], but the input is called `x`.
    SamX,
    /// Segment Anything: the encoder takes `input_image`, rows × columns × RGB from 0 to 255.
    ///
    /// It normalises and pads the image itself. The longer side has the side of the square already.
    SamHwc,
    /// `EfficientSAM`: the encoder takes `batched_images` of any size, RGB from 0 to 1.
    EfficientSam,
    /// Segment Anything 2: the encoder takes `input`, stretched to a square and normalised.
    ///
    /// It returns features in three resolutions, which the decoder takes.
    Sam2,
    /// Grounding DINO with a mask of the phrases; images of any size.
    GroundingDino,
    /// Grounding DINO as exported by Hugging Face, for images of 800 × 800.
    GroundingDinoHf,
}

impl FileAddress {
    /// Creates an address of an unpacked file.
    #[must_use]
    pub fn plain(url: &str) -> Self {
        Self {
            url: url.to_owned(),
            member: None,
            is_gzip: false,
            bytes: None,
            sha256: None,
        }
    }

    /// Returns whether the file must be unpacked after the download.
    #[must_use]
    pub fn is_packed(&self) -> bool {
        self.is_gzip || self.member.is_some()
    }

    /// Returns the name of the server.
    #[must_use]
    pub fn server(&self) -> &str {
        let url = self.url.as_str();
        let path = url.split_once("://").map_or(url, |(_, path)| path);
        path.split('/').next().unwrap_or(path)
    }

    /// Returns the last part of the address.
    #[must_use]
    pub fn file_name(&self) -> &str {
        self.url.rsplit('/').next().unwrap_or(&self.url)
    }
}

impl NetworkFile {
    /// Returns whether a digest is that of a file that is known to work.
    pub(super) fn knows(&self, digest: &str) -> bool {
        self.sha256.as_deref() == Some(digest)
            || self.other_sha256.iter().any(|other| other == digest)
    }

    /// Returns the number of bytes to download from the preferred address, if known.
    pub(super) fn download_bytes(&self) -> Option<u64> {
        let address = self.addresses.first()?;
        if address.is_packed() {
            address.bytes
        } else {
            self.bytes
        }
    }

    /// Returns the number of bytes to download like [`Self::download_bytes`], or an estimate.
    pub(super) fn about_download_bytes(&self) -> Option<u64> {
        let estimate = || Some(self.about_mb? * 1_000_000);
        self.download_bytes().or_else(estimate)
    }
}

/// Reads a UTF-8 text file that belongs to a network.
pub(super) fn read_text(path: &Path) -> Result<String, NnError> {
    std::fs::read_to_string(path).map_err(|reason| NnError::Io {
        path: path.to_owned(),
        reason,
    })
}
