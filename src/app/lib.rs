//! The window: panels are functions that look at the open project and hand out `Command`s.

mod action;
mod canvas;
mod dialogs;
mod menu;
mod notices;
mod panel_state;
mod panels;
mod perform;
mod pointer;
mod prefs;
mod ranges;
mod scene_look;
mod session_view;
mod shell;
mod shortcuts;
mod textures;
mod theme;
mod tips;
mod view_state;
mod window;

pub use action::{Action, MenuName};
pub use canvas::{CanvasMap, Draft, Tool};
pub use notices::{Notice, Notices, Severity};
pub use panels::{Asked, SceneSelect, SelectShape};
pub use prefs::{Panes, Prefs};
pub use scene_look::{ClipSides, SceneLook, ScenePrefs, Slice};
pub use session_view::{Drawn, Layers, SessionView, layers_of};
pub use shell::Shell;
pub use shortcuts::Shortcuts;
pub use theme::set_theme;
pub use view_state::{Dialog, Shown, ViewState};
pub use window::{Window, run};
