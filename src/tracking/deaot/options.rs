/// Settings of a walk of [`super::Deaot`] through pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DeaotOptions {
    /// Longest side of what the network sees, px; larger pictures are shrunk to it. Time grows with its fourth power.
    pub longest_side: u32,
    /// Every how many pictures one more is remembered for long, at least 1.
    pub remembered_every: usize,
    /// Pictures remembered for long at most, at least 1: those whose mask was given, and the latest others. The official
    /// code sets no bound; up to `remembered_every · most_remembered` pictures nothing differs from it.
    pub most_remembered: usize,
}

impl Default for DeaotOptions {
    /// As the official evaluation runs R50-DeAOT-L, with its memory bounded.
    fn default() -> Self {
        Self {
            longest_side: 1040,
            remembered_every: 5,
            most_remembered: 16,
        }
    }
}
