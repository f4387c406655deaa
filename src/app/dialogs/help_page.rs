/// Page of the help dialog.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HelpPage {
    /// Tutorials and how-to pages.
    Guide,
    /// Changes that users notice.
    News,
    /// What to send with a report of a problem.
    Report,
    /// Version, licence and what the program runs on.
    About,
}
