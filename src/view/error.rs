use std::path::PathBuf;

/// What can go wrong while drawing; each says what the user can do.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// The picture cannot be written.
    #[error("{}: the picture cannot be written ({what}); check the folder and its permissions", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the encoder or the system said.
        what: String,
    },
    /// There is nothing to draw.
    #[error("the cloud has no points to draw; run 'fuse' first or lower --min-confidence")]
    Empty,
}
