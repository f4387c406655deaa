//! Errors, and lists of names in their messages.

use std::fmt::Display;
use std::path::{Path, PathBuf};

use ostra_core::disk;
use ostra_core::job::Stopped;
use ostra_geometry::GeometryError;

/// Errors of opening and reading frames; each says what the user can do.
#[derive(Debug, thiserror::Error)]
pub enum FrameError {
    /// A file or folder cannot be read, or a camera file cannot be written.
    #[error("{}: {}", path.display(), disk::read_fault(reason))]
    Io {
        /// The file.
        path: PathBuf,
        /// Reason given by the system.
        ///
        /// It is part of the message and therefore not the error's source, which would print it
        /// twice.
        reason: std::io::Error,
    },
    /// A source file or folder is missing.
    #[error("{}: is missing; if it was moved, run 'ostra relocate PROJECT OLD NEW' or choose File › Locate missing frames", path.display())]
    Missing {
        /// The file or folder.
        path: PathBuf,
    },
    /// A file's content is damaged or not of the expected kind.
    #[error("{}: {what}", path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// What is wrong and what to do.
        what: String,
    },
    /// A path without frames, or a request that matches no frame.
    #[error("{0}")]
    NotFound(String),
    /// An impossible pose or camera.
    #[error("{}: {reason}", path.display())]
    Geometry {
        /// The file.
        path: PathBuf,
        /// Reason; see `Io` for why it is not the source.
        reason: GeometryError,
    },
    /// The user stopped the operation.
    #[error(transparent)]
    Stopped(#[from] Stopped),
}

impl FrameError {
    /// Returns [`Self::Missing`] for a missing path and [`Self::Io`] for any other error.
    pub(super) fn io(path: &Path, reason: std::io::Error) -> Self {
        if reason.kind() == std::io::ErrorKind::NotFound {
            return Self::Missing { path: path.into() };
        }
        Self::Io {
            path: path.into(),
            reason,
        }
    }
}

/// Maximum number of names that a message lists.
pub(super) const NAMED: usize = 3;

/// Returns the first items of a list and the number of others: `a, b, c and 5 more`.
pub(super) fn first_of<T: Display>(
    all: impl ExactSizeIterator<Item = T>,
    separator: &str,
) -> String {
    let more = all.len().saturating_sub(NAMED);
    let first: Vec<String> = all.take(NAMED).map(|item| item.to_string()).collect();
    let more = if more > 0 {
        format!(" and {more} more")
    } else {
        String::new()
    };
    format!("{}{more}", first.join(separator))
}

#[cfg(test)]
mod tests {
    use super::first_of;

    #[test]
    fn items_beyond_the_limit_are_counted() {
        assert_eq!(first_of([1, 2, 3].iter(), ", "), "1, 2, 3");
        assert_eq!(first_of([1, 2, 3, 4, 5].iter(), "; "), "1; 2; 3 and 2 more");
        assert_eq!(first_of([""; 0].iter(), ", "), "");
    }
}
