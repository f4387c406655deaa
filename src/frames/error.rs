//! Errors, and how their texts list names.

use std::fmt::Display;
use std::path::{Path, PathBuf};

use ostra_core::disk;
use ostra_core::job::Stopped;
use ostra_geometry::GeometryError;

/// What can go wrong while frames are opened or read; each says what the user can do.
#[derive(Debug, thiserror::Error)]
pub enum FrameError {
    /// A file or folder cannot be read, or a file of cameras written.
    #[error("{}: {}", path.display(), disk::read_fault(reason))]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said. Part of the message, so it is not this error's source: it would be printed twice.
        reason: std::io::Error,
    },
    /// A source file or folder is gone.
    #[error("{}: is not there; if it was moved, run 'ostra relocate PROJECT OLD NEW' or choose File › Frames were moved", path.display())]
    Missing {
        /// The file or folder.
        path: PathBuf,
    },
    /// A file's content is damaged or not what its place demands.
    #[error("{}: {what}", path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// What is wrong and what to do.
        what: String,
    },
    /// A path where no frames were found, or a request that no frame fits.
    #[error("{0}")]
    NotFound(String),
    /// A pose or camera that cannot be.
    #[error("{}: {reason}", path.display())]
    Geometry {
        /// The file.
        path: PathBuf,
        /// What is wrong; see `Io` for its name.
        reason: GeometryError,
    },
    /// The user stopped it.
    #[error(transparent)]
    Stopped(#[from] Stopped),
}

impl FrameError {
    /// Tells a path that is gone from one that cannot be read.
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

/// How many names a message lists.
pub(super) const NAMED: usize = 3;

/// The first items of a list, and how many more there are: `a, b, c and 5 more`.
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
    fn the_items_that_are_not_listed_are_counted() {
        assert_eq!(first_of([1, 2, 3].iter(), ", "), "1, 2, 3");
        assert_eq!(first_of([1, 2, 3, 4, 5].iter(), "; "), "1; 2; 3 and 2 more");
        assert_eq!(first_of([""; 0].iter(), ", "), "");
    }
}
