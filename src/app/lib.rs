//! Window of OSTRA, drawn with egui.
//!
//! [`run`] opens the window. Each frame, [`Window`] takes the events of its
//! `ostra_session::Session`, collects a read-only [`SessionView`] of the open project and passes it
//! to [`Shell`], which draws everything. Panels are functions: they borrow the view and return
//! `Command`s, which change the project, and [`Action`]s, which change what is shown or become
//! commands. State of the window that does not belong to the project, such as the shown frame, is
//! in [`ViewState`]; the part kept between sessions is in [`Prefs`].
//!
//! - `canvas`: image pane with its tools.
//! - `centre`: arrangement of the panes.
//! - `panels`: labels, tracking, reconstruction, fusion, traits, timeline and the 3-D view.
//! - `dialogs`: dialogs and their forms.
//! - `action`, `menu`, `shortcuts`, `perform`: list of actions, and how they are started and
//!   performed; `action_state` says which are available and why others are not.
//! - `frame_review`: confirmed frames and frames to check.
//! - `playback`, `player`: playback of the frames.
//! - `ranges`: changes of a label over a range of frames.
//! - `last_frames`: frames that were shown last in projects.
//! - `opening`: dropped files, the form of a new project, recent projects and the example.
//! - `option_names`: names of controls in place of options of the command line.
//! - `textures`, `mask_drawings`: images and masks on the GPU.
//!
//! Fields ending in `_px` are image positions in pixels, with the centre of the top-left pixel at
//! (0.5, 0.5). Positions on the screen are in egui's points. Lengths in 3-D are in world units.
//!
//! # Example
//!
//! ```rust
//! use egui::{Key, KeyboardShortcut, Modifiers};
//! use ostra_app::{Action, Shortcuts};
//!
//! let mut shortcuts = Shortcuts::default();
//! assert_eq!(shortcuts.conflicts(), []);
//!
//! // A key given to one action is taken from the action that had it.
//! let q = KeyboardShortcut::new(Modifiers::NONE, Key::Q);
//! assert_eq!(shortcuts.set(Action::Fuse, q), Some(Action::IncludeHere));
//! assert_eq!(shortcuts.keys(Action::Fuse), Some(q));
//! assert_eq!(shortcuts.keys(Action::IncludeHere), None);
//! ```

mod action;
mod action_state;
mod arrangement;
mod attention;
mod canvas;
mod centre;
mod dialogs;
mod file_manager;
mod focus_ring;
mod frame_review;
mod icons;
mod last_frames;
mod leave;
mod mask_drawings;
mod menu;
mod menu_entry;
mod menu_name;
mod network_offer;
mod notices;
mod opening;
mod option_names;
mod pane_buttons;
mod panel_state;
mod panels;
mod perform;
mod playback;
mod player;
mod pointer;
mod prefs;
mod ranges;
mod scene_image;
mod scene_prefs;
mod session_view;
mod shell;
mod shortcuts;
mod steps_state;
mod textures;
mod theme;
mod tone;
mod tool_row;
mod tooltips;
mod view_state;
mod window;
mod window_icon;

pub use action::Action;
pub use arrangement::{Arrangement, Pane};
pub use canvas::{CanvasMap, Draft, Tool};
pub use dialogs::{HelpPage, NewProjectForm, PathPicker, SourceKind};
pub use frame_review::FrameReview;
pub use last_frames::LastFrames;
pub use menu_name::MenuName;
pub use notices::{Notice, Notices, Severity};
pub use opening::MakeExample;
pub use panels::{InspectedPoint, SceneSelect, SelectShape};
pub use playback::{PlaySpeed, Playback, PlaybackPrefs};
pub use prefs::{Panes, Prefs};
pub use scene_prefs::{ClipSides, SceneLook, ScenePrefs, Slice};
pub use session_view::{Drawn, Layers, SessionView, layers_of};
pub use shell::Shell;
pub use shortcuts::Shortcuts;
pub use steps_state::StepsState;
pub use theme::set_theme;
pub use tone::Tone;
pub use view_state::{Dialog, Shown, ViewState};
pub use window::{Window, run};
