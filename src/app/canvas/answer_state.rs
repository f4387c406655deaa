use ostra_masks::LabelId;

/// What is known about the last answer besides the project.
#[derive(Debug, Clone, Default)]
pub struct AnswerBar {
    /// Frame and message of a prompt that changed nothing.
    pub(super) unchanged: Option<(usize, String)>,
    /// Frame and label whose bar the user closed.
    pub(super) closed: Option<(usize, LabelId)>,
    /// Turn of the wheel that does not make a whole step yet.
    pub(super) turn: f32,
}

impl AnswerBar {
    /// Notes that a prompt changed nothing.
    pub fn note_unchanged(&mut self, frame: usize, text: String) {
        self.unchanged = Some((frame, text));
    }

    /// Drops what is known about the last answer, because another one follows.
    pub fn forget(&mut self) {
        self.unchanged = None;
        self.closed = None;
    }
}
