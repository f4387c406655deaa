/// The square that the networks see a part of a picture on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Canvas {
    /// Pixels along each side.
    pub side: usize,
    /// Whether a part fills all of it, whatever its shape; else its longer side does, with nothing right and below.
    pub is_filled: bool,
}
