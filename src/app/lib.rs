//! The window: panels are functions that look at the open project and hand out `Command`s.

mod action;
mod canvas;
mod dialogs;
mod layers;
mod look;
mod menu;
mod notices;
mod panels;
mod perform;
mod prefs;
mod presence;
mod ranges;
mod rest;
mod scene_look;
mod shell;
mod shortcuts;
mod textures;
mod theme;
mod tips;
mod trail;
mod view_state;
mod window;

pub use action::{Action, MenuName};
pub use canvas::{CanvasMap, Draft, Tool};
pub use layers::{Drawn, Layers, layers_of};
pub use look::Look;
pub use notices::{Notice, Notices, Severity};
pub use panels::{Asked, SceneSelect, SelectShape};
pub use prefs::Prefs;
pub use scene_look::{ClipSides, SceneLook, ScenePrefs, Slice};
pub use shell::Shell;
pub use shortcuts::Shortcuts;
pub use theme::set_theme;
pub use view_state::{Dialog, Panes, Shown, ViewState};
pub use window::{Window, run};
