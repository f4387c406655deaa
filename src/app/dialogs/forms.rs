//! Forms of the dialogs as filled in so far, and the requests that they make.

use std::path::{Path, PathBuf};

use super::picker::typed_path;
use crate::Action;
use ostra_frames::cameras::{DepthCameraSource, IntrinsicsSource};
use ostra_frames::{DepthSource, Frame, FrameFolder, OpenRequest, PictureSource};
use ostra_session::{Command, NewProject};

/// One source of frames as typed.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct SourceForm {
    pub frames: String,
    pub depth: String,
}

impl SourceForm {
    /// The source; `None` while no frames are named.
    pub fn source(&self) -> Option<FrameFolder> {
        Some(FrameFolder {
            frames: typed_path(&self.frames)?,
            depth: typed_path(&self.depth),
        })
    }
}

/// The dialog for a new project (and for more frames) as typed so far.
#[derive(Debug, Clone, PartialEq)]
pub struct NewProjectForm {
    pub(super) sources: Vec<SourceForm>,
    /// Folder of the new project; beside the frames when empty.
    pub(super) root: String,
    /// Cameras in one of the formats known.
    pub(super) cameras: String,
    pub(super) intrinsics: String,
    pub(super) depth_unit: f64,
    pub(super) depth_intrinsics: String,
    /// Where the depth camera stands.
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
    /// A form with one source filled in.
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

    /// The folder beside the frames that is taken when none is typed.
    pub(super) fn suggested_root(&self) -> Option<PathBuf> {
        let frames = typed_path(&self.sources.first()?.frames)?;
        let name = frames.file_stem()?.to_string_lossy().into_owned();
        Some(frames.with_file_name(format!("{name}-ostra")))
    }

    /// The request, or what is still missing.
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
                // Floats are metres unless another unit than that of most integers is chosen.
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

    pub(super) fn tells_of_depth(&self) -> bool {
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

/// The dialog for a picture of the 3-D view as filled in so far.
#[derive(Debug, Clone, PartialEq)]
pub struct PictureForm {
    pub(super) path: String,
    pub(super) size: (u32, u32),
    pub(super) transparent: bool,
    pub(super) overwrite: bool,
    pub(super) is_film: bool,
    pub(super) seconds: f32,
    pub(super) fps: u32,
}

impl Default for PictureForm {
    fn default() -> Self {
        let size = (1920, 1080);
        Self {
            path: String::new(),
            size,
            transparent: false,
            overwrite: false,
            is_film: false,
            seconds: 12.0,
            fps: 30,
        }
    }
}

impl PictureForm {
    /// The largest side, pixels.
    pub(super) const MOST: u32 = 8192;

    /// Gives a name with the ending of a film that of a picture, and the other way round, as is written now.
    pub(super) fn follow_take(&mut self) {
        let path = Path::new(self.path.trim_end());
        let Some(ending) = path
            .extension()
            .map(|ending| ending.to_string_lossy().to_lowercase())
        else {
            return;
        };
        let other = match self.is_film {
            true => (ending == "png").then_some("mp4"),
            false => ["mp4", "mkv", "webm"]
                .contains(&ending.as_str())
                .then_some("png"),
        };
        if let Some(other) = other {
            self.path = path.with_extension(other).to_string_lossy().into_owned();
        }
    }

    /// What is asked for; a name without an ending gets one. `None` without a name, or where a picture's is not that of a PNG.
    pub(super) fn request(&self) -> Option<ScreenshotRequest> {
        let mut path = typed_path(&self.path)?;
        if path.extension().is_none() {
            path.set_extension(if self.is_film { "mp4" } else { "png" });
        }
        let is_png = |path: &Path| {
            path.extension()
                .is_some_and(|ending| ending.eq_ignore_ascii_case("png"))
        };
        let count = (self.seconds * self.fps as f32).round().max(1.0) as usize;
        let take = match self.is_film {
            true => Take::Turntable {
                count,
                fps: self.fps,
            },
            false => Take::Still {
                transparent: self.transparent,
            },
        };
        (self.is_film != is_png(&path)).then_some(ScreenshotRequest {
            path,
            size: self.size,
            overwrite: self.overwrite,
            take,
        })
    }
}

/// A picture of what the 3-D view shows, and where to.
#[derive(Debug, Clone, PartialEq)]
pub struct ScreenshotRequest {
    /// The file.
    pub path: PathBuf,
    /// Columns and rows.
    pub size: (u32, u32),
    /// Whether a picture written before may be replaced though it was changed since.
    pub overwrite: bool,
    /// A still or a film.
    pub take: Take,
}

/// What is made of the view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Take {
    /// A PNG; without its background where that is transparent.
    Still {
        /// Whether the background is left out.
        transparent: bool,
    },
    /// A film of one turn about the vertical.
    Turntable {
        /// Number of pictures, at least 1.
        count: usize,
        /// Pictures a second.
        fps: u32,
    },
}

/// Where frames were and where they are now.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RelocateForm {
    pub(super) from: String,
    pub(super) to: String,
}

impl RelocateForm {
    /// Begins with the folder that all pictures, films and depths of the project lie in.
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
    let picture = match &frame.picture {
        PictureSource::File { path, .. } => path.parent(),
        PictureSource::Film { path, .. } => Some(path.as_path()),
    };
    let depth = frame
        .depth
        .as_ref()
        .and_then(DepthSource::sensor_path)
        .and_then(Path::parent);
    picture.into_iter().chain(depth).map(Path::to_owned)
}

/// The part that two paths have in common.
fn shared(a: &Path, b: &Path) -> PathBuf {
    a.components()
        .zip(b.components())
        .take_while(|(a, b)| a == b)
        .map(|(part, _)| part)
        .collect()
}

/// The network that files are being named for.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ModelsForm {
    pub(super) adding: Option<String>,
    pub(super) path: String,
}

/// The shortcut sheet: which action waits for new keys.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SheetState {
    pub(super) changing: Option<Action>,
    /// The action that lost its keys to the one changed last.
    pub(super) robbed: Option<Action>,
}

impl SheetState {
    /// Whether the next key press is a new shortcut and does nothing else.
    #[must_use]
    pub fn is_listening(&self) -> bool {
        self.changing.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_project_folder_beside_the_frames_is_suggested() {
        let form = NewProjectForm::with_frames("/photos/rice".into());
        assert_eq!(
            form.request(true).unwrap().root,
            PathBuf::from("/photos/rice-ostra")
        );
        assert!(NewProjectForm::default().request(true).is_err());
    }

    #[test]
    fn intrinsics_are_four_numbers_or_a_file_or_nothing() {
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
    fn a_depth_camera_has_intrinsics_and_may_have_a_pose() {
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
    fn begins_with_the_folder_of_all_files() {
        let frame = |path: &str, depth: Option<&str>| Frame {
            name: path.into(),
            width: 4,
            height: 3,
            picture: PictureSource::File {
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
    fn names_get_the_ending_of_what_is_written_and_others_are_refused() {
        let mut form = PictureForm {
            path: " /out/plant ".into(),
            transparent: true,
            ..PictureForm::default()
        };
        let request = form.request().unwrap();
        assert_eq!(
            (request.path, request.take),
            ("/out/plant.png".into(), Take::Still { transparent: true })
        );
        form.path = "/out/plant.jpg".into();
        assert_eq!(form.request(), None);
        (form.is_film, form.seconds, form.fps) = (true, 2.0, 25);
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
