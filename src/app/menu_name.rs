//! Menus of the menu bar and the submenus in them.

/// Menu or submenu that contains actions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MenuName {
    /// Projects and files.
    File,
    /// Undo, labels, masks.
    Edit,
    /// Tools that draw on the image.
    Tools,
    /// Selection of points in 3-D and their labels.
    Points,
    /// Masks made by the vote of all views.
    Vote,
    /// Changes of a label over a range of frames.
    Range,
    /// Appearance of the image and the 3-D view.
    View,
    /// Panes and panels.
    Layout,
    /// Viewpoint and projection of the 3-D view.
    Viewpoint,
    /// Navigation between frames.
    Go,
    /// Long-running jobs.
    Run,
    /// Palette and shortcut sheet.
    Help,
}

impl MenuName {
    /// Menus of the menu bar, from left to right.
    pub const BAR: [Self; 7] = [
        Self::File,
        Self::Edit,
        Self::Range,
        Self::View,
        Self::Go,
        Self::Run,
        Self::Help,
    ];

    /// Returns the name that is shown.
    #[must_use]
    pub fn text(self) -> &'static str {
        match self {
            Self::File => "File",
            Self::Edit => "Edit",
            Self::Tools => "Tools",
            Self::Points => "Points in 3-D",
            Self::Vote => "3-D vote",
            Self::Range => "Range",
            Self::View => "View",
            Self::Layout => "Layout",
            Self::Viewpoint => "3-D view",
            Self::Go => "Go",
            Self::Run => "Run",
            Self::Help => "Help",
        }
    }

    /// Returns the menu that a submenu is in; `None` for a menu of the menu bar.
    #[must_use]
    pub fn parent(self) -> Option<Self> {
        match self {
            Self::Tools | Self::Points | Self::Vote => Some(Self::Edit),
            Self::Layout | Self::Viewpoint => Some(Self::View),
            _ => None,
        }
    }

    /// Returns the menu of the menu bar that leads here.
    #[must_use]
    pub fn top(self) -> Self {
        self.parent().unwrap_or(self)
    }

    /// Returns the way to the menu, as text.
    #[must_use]
    pub fn path(self) -> String {
        match self.parent() {
            Some(parent) => format!("{} › {}", parent.text(), self.text()),
            None => self.text().into(),
        }
    }
}
