use std::future::Future;
use std::path::PathBuf;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Poll, Wake, Waker};

use egui::{Context, TextEdit, Ui};

/// The system's file chooser, asked without waiting: the window goes on, and the path is taken when it comes. Where the
/// system has none, paths are typed.
#[derive(Default)]
pub struct PathPicker {
    asked: Option<(PickTarget, Answer)>,
}

type Answer = Pin<Box<dyn Future<Output = Option<PathBuf>>>>;

/// Which field a chosen path is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum PickTarget {
    /// Frames of the n-th source.
    Frames(usize),
    /// Depths of the n-th source.
    Depth(usize),
    /// Cameras of a new project.
    Cameras,
    /// Pose of a new project's depth camera.
    DepthPose,
    /// Folder of a new project.
    Root,
    /// Folder to export into.
    ExportInto,
    /// The cloud whose points are voted on.
    Onto,
    /// Folder that moved frames were in.
    MovedFrom,
    /// Folder that they are in now.
    MovedTo,
    /// Files of a network.
    Network,
    /// A picture or film of the 3-D view.
    Picture,
    /// The path of a dialog with nothing but a path.
    Path(PathRequest),
}

/// What the chooser offers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Pick {
    /// A folder.
    Folder,
    /// A file that exists.
    File,
    /// A file to be written.
    Save,
}

impl PathPicker {
    /// Opens the chooser; one that is already open is forgotten.
    fn ask(&mut self, pick: Pick, target: PickTarget) {
        let dialog = rfd::AsyncFileDialog::new();
        let answer: Answer = match pick {
            Pick::Folder => Box::pin(async {
                dialog
                    .pick_folder()
                    .await
                    .map(|file| file.path().to_owned())
            }),
            Pick::File => {
                Box::pin(async { dialog.pick_file().await.map(|file| file.path().to_owned()) })
            }
            Pick::Save => {
                Box::pin(async { dialog.save_file().await.map(|file| file.path().to_owned()) })
            }
        };
        self.asked = Some((target, answer));
    }

    /// The path chosen, once; the window is painted anew when the answer comes.
    pub(super) fn poll(&mut self, ctx: &Context) -> Option<(PickTarget, PathBuf)> {
        let (target, answer) = self.asked.as_mut()?;
        let target = *target;
        let waker = Waker::from(Arc::new(Repaint(ctx.clone())));
        match answer
            .as_mut()
            .poll(&mut std::task::Context::from_waker(&waker))
        {
            Poll::Pending => None,
            Poll::Ready(path) => {
                self.asked = None;
                path.map(|path| (target, path))
            }
        }
    }
}

/// Wakes the window.
struct Repaint(Context);

impl Wake for Repaint {
    fn wake(self: Arc<Self>) {
        self.0.request_repaint();
    }
}

/// Width of a field for a path where there is room for it, and of the button beside it, in points.
const FIELD_WIDTH: f32 = 360.0;
const BROWSE_WIDTH: f32 = 86.0;

/// A path to type, with a button for the system's chooser.
pub(crate) fn path_field_ui(
    ui: &mut Ui,
    picker: &mut PathPicker,
    (name, hint): (&str, &str),
    text: &mut String,
    (pick, target): (Pick, PickTarget),
) -> egui::Response {
    let narrow = ui.available_width() < FIELD_WIDTH;
    let width = if narrow {
        (ui.available_width() - BROWSE_WIDTH).max(60.0)
    } else {
        FIELD_WIDTH
    };
    let edit = TextEdit::singleline(text)
        .hint_text(hint)
        .desired_width(width);
    let edit = ui.add(edit).accessible_name(name);
    let browse = ui.button("Browse…").on_hover_text("Open the file chooser");
    if browse.accessible_name(format!("Browse {name}")).clicked() {
        picker.ask(pick, target);
    }
    edit
}

/// What a path is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PathRequest {
    /// A project folder to open.
    OpenProject,
    /// A PLY to look at.
    InspectPly,
    /// A folder of masks to read.
    ImportMasks,
    /// A recipe to write.
    SaveRecipe,
    /// A table of traits to write.
    SaveTraits,
}

/// The text of a path as typed: blanks around it are dropped, `~/` is the home folder.
#[must_use]
pub(crate) fn typed_path(text: &str) -> Option<PathBuf> {
    let text = text.trim();
    if text.is_empty() {
        return None;
    }
    match text
        .strip_prefix("~/")
        .and_then(|rest| Some(dirs::home_dir()?.join(rest)))
    {
        Some(path) => Some(path),
        None => Some(PathBuf::from(text)),
    }
}
