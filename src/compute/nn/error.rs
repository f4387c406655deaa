use std::path::PathBuf;

use ostra_core::disk;

/// Errors of loading and running networks; each message states what the user can do.
#[derive(Debug, thiserror::Error)]
pub enum NnError {
    /// ONNX Runtime was not found.
    #[error(
        "ONNX Runtime is not installed (looked for {}); get version 1.24 or newer from \
         https://github.com/microsoft/onnxruntime/releases and run `ostra models add onnxruntime FILE` with its \
         library, or set ORT_DYLIB_PATH to it",
        looked.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ")
    )]
    RuntimeMissing {
        /// Paths that were searched.
        looked: Vec<PathBuf>,
    },
    /// The library is not ONNX Runtime, is too old, or is damaged.
    #[error(
        "{}: cannot be used as ONNX Runtime ({what}); get the library of version 1.24 or newer for this system from \
         https://github.com/microsoft/onnxruntime/releases",
        path.display()
    )]
    RuntimeUnusable {
        /// The library.
        path: PathBuf,
        /// Message of the loader.
        what: String,
    },
    /// A file cannot be read or written.
    #[error("{}: {}", path.display(), disk::fault(reason))]
    Io {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        ///
        /// It is part of the message and therefore not this error's source: otherwise it would be
        /// printed twice.
        reason: std::io::Error,
    },
    /// The file is not a network, or ONNX Runtime cannot run it.
    #[error("{}: cannot be loaded as an ONNX network ({what}); check that the file is complete and of that format", path.display())]
    NotANetwork {
        /// The file.
        path: PathBuf,
        /// Message of ONNX Runtime.
        what: String,
    },
    /// Names, element types or shapes of inputs or outputs differ from the expected ones.
    #[error("{}: {what}; this is another network or another export of it", path.display())]
    Mismatch {
        /// The file.
        path: PathBuf,
        /// The expected and the actual interface.
        what: String,
    },
    /// A file could not be downloaded.
    #[error(
        "{url}: cannot be fetched ({what}); what is there is kept for another try; or get it by other means and run `ostra models add`"
    )]
    Fetch {
        /// Address of the file.
        url: String,
        /// The reason.
        what: String,
        /// Whether the user stopped the download.
        is_stopped: bool,
    },
    /// The downloaded file does not have the known digest.
    #[error(
        "{url}: the file has another SHA-256 than it should ({expected} expected, {found} received); it was deleted and \
         nothing was installed; try again, or get the file by other means and run `ostra models add`"
    )]
    WrongDownload {
        /// Address of the file.
        url: String,
        /// Known digest.
        expected: String,
        /// Digest of the downloaded file.
        found: String,
    },
    /// An installed file has changed since it was added.
    #[error(
        "{}: was changed since it was added (SHA-256 {expected} then, {found} now); add it again with `ostra models add`",
        path.display()
    )]
    Changed {
        /// The file.
        path: PathBuf,
        /// Digest when it was added.
        expected: String,
        /// Current digest.
        found: String,
    },
    /// A file does not have the known digest, and cannot be verified otherwise.
    #[error(
        "{}: is not the file that is known (SHA-256 {expected}, this one has {found}); download it again, or install \
         ONNX Runtime so that it can be checked by loading it",
        path.display()
    )]
    Digest {
        /// The file.
        path: PathBuf,
        /// Hexadecimal digest of the known file.
        expected: String,
        /// Hexadecimal digest of this file.
        found: String,
    },
    /// A network failed while running.
    #[error(
        "{}: failed while running ({what}); check it with `ostra models check`, or choose another engine",
        path.display()
    )]
    Run {
        /// The file.
        path: PathBuf,
        /// Message of ONNX Runtime.
        what: String,
    },
    /// Invalid request: an unknown name, a wrong number of files, or a missing network.
    #[error("{0}")]
    Request(String),
}
