/// An error in geometric input.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GeometryError {
    /// A number is NaN or infinite.
    #[error("the {what} has a value that is not a finite number; remove or repair it")]
    NotFinite {
        /// What was being read, e.g. `pose`.
        what: String,
    },
    /// A 3×3 matrix is too far from a rotation to be corrected.
    #[error("the matrix is not a rotation (off by {error:.3}); check the file's convention")]
    NotARotation {
        /// Frobenius distance to the nearest rotation.
        error: f64,
    },
    /// There are too few or degenerate correspondences for an alignment.
    #[error(
        "{count} points are too few (or in one line) for a {kind} alignment; give at least 3 that are not in one line"
    )]
    TooFewPoints {
        /// Number of points given.
        count: usize,
        /// `se3` or `sim3`.
        kind: &'static str,
    },
    /// An image would have to be mirrored to be seen upright; a pose can only rotate.
    #[error(
        "EXIF orientation {orientation} mirrors the image, which a camera pose cannot describe; save the image upright"
    )]
    Mirrored {
        /// EXIF orientation, 1 to 8 if valid.
        orientation: u8,
    },
    /// Two lists that belong together have different lengths.
    #[error("there are {left} {what} on one side and {right} on the other; give as many on both")]
    Unpaired {
        /// What is paired, e.g. `cameras`.
        what: &'static str,
        /// Length of the first list.
        left: usize,
        /// Length of the second list.
        right: usize,
    },
}
