use std::future::Future;
use std::path::PathBuf;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Poll, Wake, Waker};

use egui::{Context, TextEdit, Ui};

/// Native file chooser that does not block the window.
///
/// The path is taken when the answer arrives. On systems without a chooser, paths are typed.
#[derive(Default)]
pub struct PathPicker {
    inspected_point: Option<(PickTarget, Answer)>,
}

type Answer = Pin<Box<dyn Future<Output = Option<PathBuf>>>>;

/// Field that receives a chosen path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum PickTarget {
    /// Frames of the n-th source.
    Frames(usize),
    /// Depth maps of the n-th source.
    Depth(usize),
    /// Cameras of a new project.
    Cameras,
    /// Pose of a new project's depth camera.
    DepthPose,
    /// Folder of a new project.
    Root,
    /// Folder to export into.
    ExportInto,
    /// Cloud to vote on.
    Onto,
    /// Old folder of moved frames.
    MovedFrom,
    /// New folder of moved frames.
    MovedTo,
    /// Files of a network.
    Network,
    /// Image or video of the 3-D view.
    Image,
    /// Path of a dialog with a single path field.
    Path(PathRequest),
}

/// Kind of path to choose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Pick {
    /// Folder.
    Folder,
    /// Existing file.
    File,
    /// File to write.
    Save,
}

impl PathPicker {
    /// Opens the chooser. The answer of one that is already open is discarded.
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
        self.inspected_point = Some((target, answer));
    }

    /// Returns the chosen path, once. The window is repainted when the answer arrives.
    pub(super) fn poll(&mut self, ctx: &Context) -> Option<(PickTarget, PathBuf)> {
        let (target, answer) = self.inspected_point.as_mut()?;
        let target = *target;
        let waker = Waker::from(Arc::new(Repaint(ctx.clone())));
        match answer
            .as_mut()
            .poll(&mut std::task::Context::from_waker(&waker))
        {
            Poll::Pending => None,
            Poll::Ready(path) => {
                self.inspected_point = None;
                path.map(|path| (target, path))
            }
        }
    }
}

/// Waker that repaints the window.
struct Repaint(Context);

impl Wake for Repaint {
    fn wake(self: Arc<Self>) {
        self.0.request_repaint();
    }
}

/// Preferred width of a path field and width of its button, in points.
const FIELD_WIDTH: f32 = 360.0;
const BROWSE_WIDTH: f32 = 86.0;

/// Field for a path, typed or chosen.
pub(crate) struct PathField<'a> {
    /// Accessible name.
    pub name: &'a str,
    /// Text shown while the field is empty.
    pub hint: &'a str,
    /// Kind of path to choose.
    pub pick: Pick,
    /// Field that receives a chosen path.
    pub target: PickTarget,
}

/// Adds a path field with a button that opens the file chooser.
pub(crate) fn path_field_ui(
    ui: &mut Ui,
    picker: &mut PathPicker,
    field: &PathField<'_>,
    text: &mut String,
) -> egui::Response {
    let name = field.name;
    let narrow = ui.available_width() < FIELD_WIDTH;
    let width = if narrow {
        (ui.available_width() - BROWSE_WIDTH).max(60.0)
    } else {
        FIELD_WIDTH
    };
    let edit = TextEdit::singleline(text)
        .hint_text(field.hint)
        .desired_width(width);
    let edit = ui.add(edit).accessible_name(name);
    let browse = ui.button("Browse…").on_hover_text("Open the file chooser");
    if browse.accessible_name(format!("Browse {name}")).clicked() {
        picker.ask(field.pick, field.target);
    }
    edit
}

/// Purpose of a dialog with a single path field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PathRequest {
    /// Opens a project folder.
    OpenProject,
    /// Views a PLY file.
    InspectPly,
    /// Imports a folder of masks.
    ImportMasks,
    /// Saves the history as a recipe.
    SaveRecipe,
    /// Exports a table of traits.
    SaveTraits,
}

/// Parses a typed path: trims white space and expands `~/` to the home folder.
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
