//! State of the dialogs and the requests made from it.

use std::path::{Path, PathBuf};

use super::picker::typed_path;
use crate::Action;
use ostra_frames::cameras::{DepthCameraSource, IntrinsicsSource};
use ostra_frames::{DepthSource, Frame, FrameFolder, ImageSource, OpenRequest};
use ostra_session::{Command, NewProject};

/// Source of frames, as typed.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct SourceForm {
    pub frames: String,
    pub depth: String,
}

impl SourceForm {
    /// Returns the source; `None` while no frames are given.
    pub fn source(&self) -> Option<FrameFolder> {
        Some(FrameFolder {
            frames: typed_path(&self.frames)?,
            depth: typed_path(&self.depth),
        })
    }
}

/// State of the dialog for a new project, which also adds frames to an open project.
#[derive(Debug, Clone, PartialEq)]
pub struct NewProjectForm {
    pub(super) sources: Vec<SourceForm>,
    /// Folder of the new project; if empty, a folder next to the frames is used.
    pub(super) root: String,
    /// File of cameras in any known format.
    pub(super) cameras: String,
    pub(super) intrinsics: String,
    pub(super) depth_unit: f64,
    pub(super) depth_intrinsics: String,
    /// File with the pose of the depth camera.
    pub(super) depth_pose: String,
    pub(super) every: usize,
    pub(super) from: Option<usize>,
    pub(super) to: Option<usize>,
}

impl Default for NewProjectForm {
    fn default() -> Self {
        Self {
            sources: vec![SourceForm::default()],
            root: String::new(),
            cameras: String::new(),
            intrinsics: String::new(),
            depth_unit: 0.001,
            depth_intrinsics: String::new(),
            depth_pose: String::new(),
            every: 1,
            from: None,
            to: None,
        }
    }
}

impl NewProjectForm {
    /// Returns a form with one source filled in.
    #[must_use]
    pub fn with_frames(frames: String) -> Self {
        let mut form = Self::default();
        form.set_frames(0, frames);
        form
    }

    pub(super) fn set_frames(&mut self, index: usize, text: String) {
        if let Some(source) = self.sources.get_mut(index) {
            source.frames = text;
        }
    }

    pub(super) fn set_depth(&mut self, index: usize, text: String) {
        if let Some(source) = self.sources.get_mut(index) {
            source.depth = text;
        }
    }

    /// Returns the folder next to the frames that is used if none is typed.
    pub(super) fn suggested_root(&self) -> Option<PathBuf> {
        let frames = typed_path(&self.sources.first()?.frames)?;
        let name = frames.file_stem()?.to_string_lossy().into_owned();
        Some(frames.with_file_name(format!("{name}-ostra")))
    }

    /// Returns the request, or a message about what is missing.
    ///
    /// # Errors
    /// One sentence to show under the form.
    pub fn request(&self, needs_root: bool) -> Result<NewProject, String> {
        let sources: Vec<_> = self.sources.iter().filter_map(SourceForm::source).collect();
        if sources.is_empty() {
            return Err("Choose a folder of images or a video".into());
        }
        let root = typed_path(&self.root).or_else(|| self.suggested_root());
        let root = if needs_root {
            root.ok_or("Choose a folder for the project")?
        } else {
            PathBuf::new()
        };
        if let (Some(from), Some(to)) = (self.from, self.to)
            && from > to
        {
            return Err("The first frame lies behind the last".into());
        }
        Ok(NewProject {
            root,
            open: OpenRequest {
                sources,
                depth_unit: self.depth_unit,
                // Floating-point depths are in metres unless the unit differs from the default for
                // integers.
                float_depth_unit: if self.depth_unit == 0.001 {
                    1.0
                } else {
                    self.depth_unit
                },
                depth_camera: self.depth_camera()?,
                every: self.every,
                from: self.from,
                to: self.to,
            },
            cameras: typed_path(&self.cameras),
            intrinsics: intrinsics(&self.intrinsics)?,
        })
    }

    pub(super) fn describes_depth(&self) -> bool {
        self.sources
            .iter()
            .any(|source| !source.depth.trim().is_empty())
            || self.has_depth_camera()
    }

    pub(super) fn has_depth_camera(&self) -> bool {
        !self.depth_intrinsics.trim().is_empty() || !self.depth_pose.trim().is_empty()
    }

    fn depth_camera(&self) -> Result<Option<DepthCameraSource>, String> {
        let pose = typed_path(&self.depth_pose);
        let given =
            intrinsics(&self.depth_intrinsics).map_err(|what| format!("Depth camera: {what}"))?;
        if given.is_none() && pose.is_some() {
            return Err("Give the depth camera's intrinsics with its pose".into());
        }
        Ok(given.map(|intrinsics| DepthCameraSource { intrinsics, pose }))
    }
}

fn intrinsics(text: &str) -> Result<Option<IntrinsicsSource>, String> {
    let text = text.trim();
    let source = (!text.is_empty()).then(|| text.parse()).transpose()?;
    Ok(source.map(|source| match source {
        IntrinsicsSource::File(path) => IntrinsicsSource::File(typed_path(text).unwrap_or(path)),
        values => values,
    }))
}

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
}

/// State of the shortcut sheet: the action that waits for new keys.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SheetState {
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
    fn project_folder_next_to_frames_is_suggested() {
        let form = NewProjectForm::with_frames("/photos/rice".into());
        assert_eq!(
            form.request(true).unwrap().root,
            PathBuf::from("/photos/rice-ostra")
        );
        assert!(NewProjectForm::default().request(true).is_err());
    }

    #[test]
    fn intrinsics_are_empty_four_numbers_or_a_file() {
        let mut form = NewProjectForm::with_frames("/a".into());
        form.intrinsics = "500, 500, 320.5, 240".into();
        assert_eq!(
            form.request(true).unwrap().intrinsics,
            Some(IntrinsicsSource::Values([500.0, 500.0, 320.5, 240.0]))
        );
        form.intrinsics = "/recording/intrinsic.json".into();
        let file = Some(IntrinsicsSource::File("/recording/intrinsic.json".into()));
        assert_eq!(form.request(true).unwrap().intrinsics, file);
        form.intrinsics = "500, x".into();
        assert!(form.request(true).unwrap_err().contains("four numbers"));
    }

    #[test]
    fn depth_camera_needs_intrinsics_but_no_pose() {
        let mut form = NewProjectForm::with_frames("/a".into());
        assert_eq!(form.request(true).unwrap().open.depth_camera, None);
        form.depth_intrinsics = "580, 580, 320, 240".into();
        let intrinsics = IntrinsicsSource::Values([580.0, 580.0, 320.0, 240.0]);
        let camera = |pose| {
            Some(DepthCameraSource {
                intrinsics: intrinsics.clone(),
                pose,
            })
        };
        assert_eq!(form.request(true).unwrap().open.depth_camera, camera(None));
        form.depth_pose = "/depth.txt".into();
        assert_eq!(
            form.request(true).unwrap().open.depth_camera,
            camera(Some("/depth.txt".into()))
        );
        form.depth_intrinsics.clear();
        assert!(form.request(true).unwrap_err().contains("intrinsics"));
    }

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
