use std::future::Future;
use std::path::PathBuf;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Poll, Wake, Waker};
use std::time::Instant;

use egui::{Context, TextEdit, Ui};

use ostra_frames::IMAGE_ENDINGS;

/// Native file chooser that does not block the window.
///
/// The paths are taken when the answer arrives. On systems without a chooser, paths are typed.
#[derive(Default)]
pub struct PathPicker {
    is_native: bool,
    open: Option<OpenChooser>,
    is_unavailable: bool,
}

struct OpenChooser {
    target: PickTarget,
    answer: Answer,
    since: Instant,
}

type Answer = Pin<Box<dyn Future<Output = Option<Vec<PathBuf>>>>>;

/// Text where no file chooser can be opened.
pub(super) const NO_CHOOSER: &str =
    "No file chooser on this system: type a path or drop files here";

/// Time within which no person can close a chooser, in seconds.
///
/// An answer without a path within this time means that no chooser could be opened. The portal of
/// Linux does not distinguish the two.
const TOO_FAST_S: f32 = 0.6;

/// Field that receives a chosen path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum PickTarget {
    /// Frames of a new project.
    Frames,
    /// Depth maps of a new project.
    Depth,
    /// Cameras of a new project.
    Cameras,
    /// Intrinsics of a new project's frames.
    Intrinsics,
    /// Intrinsics of a new project's depth camera.
    DepthIntrinsics,
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
    /// Folders, one or more.
    Folders,
    /// Existing file.
    File(FileKind),
    /// Existing images and videos, one or more.
    ImagesAndVideos,
    /// File to write.
    Save(FileKind),
}

/// Files that a chooser lists.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct FileKind {
    /// Name of the filter.
    name: &'static str,
    /// File extensions.
    endings: &'static [&'static str],
    /// Suggested name of a file to write.
    suggested: &'static str,
}

impl FileKind {
    pub(crate) const CLOUD: Self = Self::read("Point clouds", &["ply"]);
    pub(crate) const NETWORK: Self = Self::read(
        "Networks",
        &["onnx", "zip", "gz", "so", "dll", "dylib", "whl"],
    );
    pub(crate) const TEXT: Self = Self::read("Text files", &["txt", "json", "yml", "yaml"]);
    pub(crate) const TABLE: Self = Self::write("Tables", &["csv"], "traits.csv");
    pub(crate) const RECIPE: Self = Self::write("Recipes", &["json"], "recipe.json");
    pub(crate) const IMAGE: Self = Self::write("Images", &["png"], "view.png");
    pub(crate) const VIDEO: Self = Self::write("Videos", &["mp4", "mkv", "webm"], "turntable.mp4");

    const fn read(name: &'static str, endings: &'static [&'static str]) -> Self {
        Self::write(name, endings, "")
    }

    const fn write(
        name: &'static str,
        endings: &'static [&'static str],
        suggested: &'static str,
    ) -> Self {
        Self {
            name,
            endings,
            suggested,
        }
    }
}

/// File extensions that most videos have.
const VIDEO_ENDINGS: [&str; 10] = [
    "mp4", "mov", "mkv", "avi", "webm", "m4v", "mts", "mpg", "mpeg", "wmv",
];

/// Returns the filters of the chooser of images and videos, as names with file extensions.
fn filters() -> [(&'static str, Vec<&'static str>); 3] {
    let videos = VIDEO_ENDINGS.to_vec();
    let images = IMAGE_ENDINGS.to_vec();
    let both = [images.as_slice(), videos.as_slice()].concat();
    [
        ("Images and videos", both),
        ("Images", images),
        ("Videos", videos),
    ]
}

impl PathPicker {
    /// Returns a picker that opens the chooser of the system.
    ///
    /// The default one opens none, which keeps tests from showing windows.
    #[must_use]
    pub fn native() -> Self {
        Self {
            is_native: true,
            ..Self::default()
        }
    }

    /// Returns whether the last chooser could not be opened.
    pub(super) fn is_unavailable(&self) -> bool {
        self.is_unavailable
    }

    /// Opens the chooser if the system has one, and shows nothing otherwise.
    pub(crate) fn ask_if_native(&mut self, pick: Pick, target: PickTarget) {
        if self.is_native {
            self.ask(pick, target);
        }
    }

    /// Opens the chooser. The answer of one that is already open is discarded.
    pub(super) fn ask(&mut self, pick: Pick, target: PickTarget) {
        self.is_unavailable = !self.is_native;
        if self.is_native {
            self.open = Some(OpenChooser {
                target,
                answer: answer(pick),
                since: Instant::now(),
            });
        }
    }

    /// Returns the chosen paths, once. The window is repainted when the answer arrives.
    pub(super) fn poll(&mut self, ctx: &Context) -> Option<(PickTarget, Vec<PathBuf>)> {
        let open = self.open.as_mut()?;
        let waker = Waker::from(Arc::new(Repaint(ctx.clone())));
        let mut task = std::task::Context::from_waker(&waker);
        let Poll::Ready(paths) = open.answer.as_mut().poll(&mut task) else {
            return None;
        };
        let (target, since) = (open.target, open.since);
        self.open = None;
        let paths = paths.filter(|paths| !paths.is_empty());
        self.is_unavailable = paths.is_none() && since.elapsed().as_secs_f32() < TOO_FAST_S;
        Some((target, paths?))
    }
}

/// Opens a chooser; `None` is the answer if it is cancelled or cannot be opened.
fn answer(pick: Pick) -> Answer {
    let dialog = rfd::AsyncFileDialog::new();
    match pick {
        Pick::Folder => Box::pin(async move { dialog.pick_folder().await.as_ref().map(path_of) }),
        Pick::Folders => {
            Box::pin(async move { dialog.pick_folders().await.as_deref().map(paths_of) })
        }
        Pick::File(kind) => {
            let dialog = dialog
                .add_filter(kind.name, kind.endings)
                .add_filter("All files", &["*"]);
            Box::pin(async move { dialog.pick_file().await.as_ref().map(path_of) })
        }
        Pick::ImagesAndVideos => {
            let dialog = filters()
                .into_iter()
                .fold(dialog, |dialog, (name, endings)| {
                    dialog.add_filter(name, &endings)
                });
            // Videos may have any ending.
            let dialog = dialog.add_filter("All files", &["*"]);
            Box::pin(async move { dialog.pick_files().await.as_deref().map(paths_of) })
        }
        Pick::Save(kind) => {
            let dialog = dialog
                .add_filter(kind.name, kind.endings)
                .set_file_name(kind.suggested);
            Box::pin(async move { dialog.save_file().await.as_ref().map(path_of) })
        }
    }
}

fn path_of(file: &rfd::FileHandle) -> Vec<PathBuf> {
    vec![file.path().to_owned()]
}

fn paths_of(files: &[rfd::FileHandle]) -> Vec<PathBuf> {
    files.iter().map(|file| file.path().to_owned()).collect()
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
    let tip = if picker.is_unavailable {
        NO_CHOOSER
    } else {
        "Open the file chooser"
    };
    let browse = ui.button("Browse…").on_hover_text(tip);
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
