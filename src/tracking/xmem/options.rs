/// How much XMem sees and remembers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct XMemOptions {
    /// Shorter side of the pictures that the networks see, in pixels; `None` = as they are. More shows thinner things and
    /// takes longer.
    pub short_side: Option<u32>,
    /// Every so many frames one is remembered, at least 1.
    pub remember_every: usize,
    /// Frames in working memory at which it is consolidated, at least 2.
    pub most_frames: usize,
    /// Frames that then stay, the first among them: at least 1, fewer than `most_frames`.
    pub least_frames: usize,
    /// Elements of long-term memory that a consolidation makes.
    pub prototypes: usize,
    /// Elements of long-term memory at most; those least used are forgotten.
    pub most_prototypes: usize,
    /// Elements of memory that each cell of a picture is matched with.
    pub matches: usize,
}

impl Default for XMemOptions {
    fn default() -> Self {
        Self {
            short_side: Some(480),
            remember_every: 5,
            most_frames: 10,
            least_frames: 5,
            prototypes: 128,
            most_prototypes: 10_000,
            matches: 30,
        }
    }
}
