//! State of the dialogs and the requests made from it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::picker::typed_path;
use crate::Action;
use ostra_frames::{DepthSource, Frame, ImageSource};
use ostra_masks::LabelId;
use ostra_session::Command;

/// State of the dialog that saves the 3-D view.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageForm {
    pub(super) path: String,
    pub(super) size: (u32, u32),
    pub(super) transparent: bool,
    pub(super) overwrite: bool,
    pub(super) is_video: bool,
    pub(super) seconds: f32,
    pub(super) fps: u32,
}

impl Default for ImageForm {
    fn default() -> Self {
        let size = (1920, 1080);
        Self {
            path: String::new(),
            size,
            transparent: false,
            overwrite: false,
            is_video: false,
            seconds: 12.0,
            fps: 30,
        }
    }
}

impl ImageForm {
    /// Largest width or height, in pixels.
    pub(super) const MOST: u32 = 8192;

    /// Switches the file extension between image and video to match the chosen kind.
    pub(super) fn follow_take(&mut self) {
        let path = Path::new(self.path.trim_end());
        let Some(ending) = path
            .extension()
            .map(|ending| ending.to_string_lossy().to_lowercase())
        else {
            return;
        };
        let other = match self.is_video {
            true => (ending == "png").then_some("mp4"),
            false => ["mp4", "mkv", "webm"]
                .contains(&ending.as_str())
                .then_some("png"),
        };
        if let Some(other) = other {
            self.path = path.with_extension(other).to_string_lossy().into_owned();
        }
    }

    /// Returns the request; a name without an extension gets one.
    ///
    /// Returns `None` without a name, for an image that is not a PNG and for a video named as a
    /// PNG.
    pub(super) fn request(&self) -> Option<ScreenshotRequest> {
        let mut path = typed_path(&self.path)?;
        if path.extension().is_none() {
            path.set_extension(if self.is_video { "mp4" } else { "png" });
        }
        let is_png = |path: &Path| {
            path.extension()
                .is_some_and(|ending| ending.eq_ignore_ascii_case("png"))
        };
        let count = (self.seconds * self.fps as f32).round().max(1.0) as usize;
        let take = match self.is_video {
            true => Take::Turntable {
                count,
                fps: self.fps,
            },
            false => Take::Still {
                transparent: self.transparent,
            },
        };
        (self.is_video != is_png(&path)).then_some(ScreenshotRequest {
            path,
            size: self.size,
            overwrite: self.overwrite,
            take,
        })
    }
}

/// Request to save the 3-D view to a file.
#[derive(Debug, Clone, PartialEq)]
pub struct ScreenshotRequest {
    /// File to write.
    pub path: PathBuf,
    /// Width and height, in pixels.
    pub size: (u32, u32),
    /// Whether an earlier export may be replaced even if it was changed since.
    pub overwrite: bool,
    /// Still image or video.
    pub take: Take,
}

/// Kind of file made from the 3-D view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Take {
    /// PNG image.
    Still {
        /// Whether the background is transparent.
        transparent: bool,
    },
    /// Video of one turn about the vertical.
    Turntable {
        /// Number of video frames, at least 1.
        count: usize,
        /// Video frames per second.
        fps: u32,
    },
}

/// Old and new location of frames.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RelocateForm {
    pub(super) from: String,
    pub(super) to: String,
}

impl RelocateForm {
    /// Returns a form that starts with the folder common to all images, videos and depth maps.
    #[must_use]
    pub fn of(frames: &[Frame]) -> Self {
        let common = frames
            .iter()
            .flat_map(folders)
            .reduce(|a, b| shared(&a, &b))
            .unwrap_or_default();
        Self {
            from: common.display().to_string(),
            to: String::new(),
        }
    }

    pub(super) fn command(&self) -> Option<Command> {
        Some(Command::Relocate {
            from: typed_path(&self.from)?,
            to: typed_path(&self.to)?,
        })
    }
}

fn folders(frame: &Frame) -> impl Iterator<Item = PathBuf> {
    let image = match &frame.image {
        ImageSource::File { path, .. } => path.parent(),
        ImageSource::Video { path, .. } => Some(path.as_path()),
    };
    let depth = frame
        .depth
        .as_ref()
        .and_then(DepthSource::sensor_path)
        .and_then(Path::parent);
    image.into_iter().chain(depth).map(Path::to_owned)
}

/// Returns the common prefix of two paths.
fn shared(a: &Path, b: &Path) -> PathBuf {
    a.components()
        .zip(b.components())
        .take_while(|(a, b)| a == b)
        .map(|(part, _)| part)
        .collect()
}

/// Network whose files are being added.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ModelsForm {
    pub(super) adding: Option<String>,
    pub(super) path: String,
    /// Chosen variants of networks that have several, by network.
    pub(super) variants: BTreeMap<String, String>,
    /// Network whose licence is shown to be accepted.
    pub(super) accepting: Option<String>,
    /// Network that cannot be downloaded again and is asked about before it is removed.
    pub(super) removing: Option<String>,
    /// Offers of networks outside this dialog.
    pub(crate) offers: NetworkOffers,
}

/// State of the offers and of the installations that they began.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct NetworkOffers {
    /// Whether the offer for clicks is closed until the program ends.
    pub(crate) is_closed: bool,
    pub(crate) for_clicks: Installation,
    pub(crate) for_text: Installation,
}

/// Networks that are installed one after the other; none if nothing is being installed.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Installation {
    pub(crate) queue: Vec<&'static str>,
    /// Number of the drawn frame in which the first of them was asked for; its job runs from the
    /// next one on.
    pub(crate) asked_in: u64,
}

/// File to write the history to as a recipe.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecipeTarget {
    /// File to write.
    pub path: PathBuf,
    /// Whether the user agreed to replace an earlier export that was changed since.
    pub may_replace: bool,
}

/// Request to choose the target label of a merge or split.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IntoRequest {
    /// Label that gives up its pixels.
    pub label: LabelId,
    /// First and last frame, both included.
    pub range: (usize, usize),
    /// Frame and image position of the part to split off; `None` merges the whole label.
    pub piece: Option<(usize, glam::DVec2)>,
}

/// State of the palette.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct PaletteState {
    /// Typed text.
    pub(super) text: String,
    /// Highlighted row.
    pub(super) row: usize,
}

/// State of the shortcut sheet: the action that waits for new keys.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct SheetState {
    /// Typed text that the listed actions contain.
    pub(super) filter: String,
    pub(super) changing: Option<Action>,
    /// Action that lost its shortcut in the latest change.
    pub(super) robbed: Option<Action>,
}

impl SheetState {
    /// Returns `true` if the next key press sets a shortcut and does nothing else.
    #[must_use]
    pub fn is_listening(&self) -> bool {
        self.changing.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn relocation_starts_at_the_common_folder() {
        let frame = |path: &str, depth: Option<&str>| Frame {
            name: path.into(),
            width: 4,
            height: 3,
            image: ImageSource::File {
                path: path.into(),
                orientation: Default::default(),
            },
            depth: depth.map(|path| DepthSource::Sensor {
                path: path.into(),
                unit: 0.001,
                orientation: Default::default(),
                camera: None,
            }),
            camera: None,
        };
        let frames = [
            frame("/a/b/color/0.png", Some("/a/b/depth/0.png")),
            frame("/a/b/color/more/1.png", None),
        ];
        let mut form = RelocateForm::of(&frames);
        assert_eq!(form.from, "/a/b");
        assert_eq!(form.command(), None);
        form.to = "/c".into();
        assert_eq!(
            form.command(),
            Some(Command::Relocate {
                from: "/a/b".into(),
                to: "/c".into()
            })
        );
    }

    #[test]
    fn missing_extension_is_added_and_wrong_one_rejected() {
        let mut form = ImageForm {
            path: " /out/plant ".into(),
            transparent: true,
            ..ImageForm::default()
        };
        let request = form.request().unwrap();
        assert_eq!(
            (request.path, request.take),
            ("/out/plant.png".into(), Take::Still { transparent: true })
        );
        form.path = "/out/plant.jpg".into();
        assert_eq!(form.request(), None);
        (form.is_video, form.seconds, form.fps) = (true, 2.0, 25);
        form.path = "/out/plant".into();
        let request = form.request().unwrap();
        assert_eq!(
            (request.path, request.take),
            (
                "/out/plant.mp4".into(),
                Take::Turntable { count: 50, fps: 25 }
            )
        );
        form.path = "/out/plant.png".into();
        assert_eq!(form.request(), None);
        form.path = "  ".into();
        assert_eq!(form.request(), None);
    }
}
