use std::path::PathBuf;

use ostra_core::disk;

/// Why a network cannot be loaded or run; each says what the user can do.
#[derive(Debug, thiserror::Error)]
pub enum NnError {
    /// No ONNX Runtime anywhere.
    #[error(
        "ONNX Runtime is not installed (looked for {}); get version 1.24 or newer from \
         https://github.com/microsoft/onnxruntime/releases and run `ostra models add onnxruntime FILE` with its \
         library, or set ORT_DYLIB_PATH to it",
        looked.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ")
    )]
    RuntimeMissing {
        /// Where it was looked for.
        looked: Vec<PathBuf>,
    },
    /// A file that should be ONNX Runtime is too old, damaged or something else.
    #[error(
        "{}: cannot be used as ONNX Runtime ({what}); get the library of version 1.24 or newer for this system from \
         https://github.com/microsoft/onnxruntime/releases",
        path.display()
    )]
    RuntimeUnusable {
        /// The library.
        path: PathBuf,
        /// What the loader said.
        what: String,
    },
    /// A file cannot be read or written.
    #[error("{}: {}", path.display(), disk::fault(reason))]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said. Part of the message, so it is not this error's source: it would be printed twice.
        reason: std::io::Error,
    },
    /// A file is no network, or one that ONNX Runtime cannot run.
    #[error("{}: cannot be loaded as an ONNX network ({what}); check that the file is complete and of that format", path.display())]
    NotANetwork {
        /// The file.
        path: PathBuf,
        /// What ONNX Runtime said.
        what: String,
    },
    /// Names, element types or shapes are others than those that are fed and read.
    #[error("{}: {what}; this is another network or another export of it", path.display())]
    Mismatch {
        /// The file.
        path: PathBuf,
        /// What was expected and what is there.
        what: String,
    },
    /// A file could not be got from the net.
    #[error(
        "{url}: cannot be fetched ({what}); what is there is kept for another try; or get it by other means and run `ostra models add`"
    )]
    Fetch {
        /// Its address.
        url: String,
        /// Why not.
        what: String,
        /// Whether the user stopped it.
        is_stopped: bool,
    },
    /// What an address gave is not the file whose digest is known.
    #[error(
        "{url}: the file has another SHA-256 than it should ({expected} expected, {found} received); it was deleted and \
         nothing was installed; try again, or get the file by other means and run `ostra models add`"
    )]
    WrongDownload {
        /// Its address.
        url: String,
        /// The digest that is known.
        expected: String,
        /// The digest of what was received.
        found: String,
    },
    /// An installed file is another one than was added.
    #[error(
        "{}: was changed since it was added (SHA-256 {expected} then, {found} now); add it again with `ostra models add`",
        path.display()
    )]
    Changed {
        /// The file.
        path: PathBuf,
        /// The digest when it was added.
        expected: String,
        /// Its digest.
        found: String,
    },
    /// A file is not the one whose digest is known, and nothing else could prove it.
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
        /// Hexadecimal digest of this one.
        found: String,
    },
    /// A network failed while running.
    #[error("{}: failed while running ({what})", path.display())]
    Run {
        /// The file.
        path: PathBuf,
        /// What ONNX Runtime said.
        what: String,
    },
    /// Something is asked for that there is not: an unknown name, a wrong number of files, a network not installed.
    #[error("{0}")]
    Request(String),
}
