/// What can be wrong with geometry that was given.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GeometryError {
    /// A number is NaN or infinite.
    #[error("the {what} has a value that is not a finite number; remove or repair it")]
    NotFinite {
        /// What was being read, e.g. `pose`.
        what: String,
    },
    /// A 3×3 matrix too far from a rotation to be put right.
    #[error("the matrix is no rotation (off by {error:.3}); check the file's convention")]
    NotARotation {
        /// Frobenius distance to the nearest rotation.
        error: f64,
    },
    /// Too few or degenerate correspondences for an alignment.
    #[error("{count} points are too few (or in one line) for a {kind} alignment")]
    TooFewPoints {
        /// How many points were given.
        count: usize,
        /// `se3` or `sim3`.
        kind: &'static str,
    },
    /// An image that must be mirrored to be seen upright; a pose only turns.
    #[error(
        "EXIF orientation {orientation} mirrors the picture, which no camera pose can; save the picture upright"
    )]
    Mirrored {
        /// The orientation, 1 to 8 where it is one.
        orientation: u8,
    },
    /// Two lists that belong together have different lengths.
    #[error("there are {left} {what} on one side and {right} on the other")]
    Unpaired {
        /// What is paired, e.g. `cameras`.
        what: &'static str,
        /// How many on the first side.
        left: usize,
        /// How many on the second.
        right: usize,
    },
}
