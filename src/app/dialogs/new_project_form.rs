//! State of the dialog for a new project.

use std::path::{Path, PathBuf};

use super::picker::typed_path;
use ostra_frames::OpenRequest;
use ostra_frames::cameras::{DepthCameraSource, IntrinsicsSource};
use ostra_session::{NewProject, Survey, SurveyRequest};

/// What the user said that the frames are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SourceKind {
    /// Not said.
    #[default]
    Any,
    /// Photos of an object.
    Photos,
    /// A video.
    Video,
    /// A recording of colour and depth.
    Recording,
}

/// Progress of the request made from the form.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum Stage {
    /// The form is being filled in.
    #[default]
    Editing,
    /// The request is sent once the files are read.
    Waiting,
    /// The request was sent; its job runs.
    Sent,
}

/// State of the dialog for a new project, which also adds frames to an open project.
#[derive(Debug, Clone, PartialEq)]
pub struct NewProjectForm {
    pub(super) kind: SourceKind,
    /// Typed or chosen path; several are separated by semicolons.
    pub(super) frames: String,
    /// Chosen or dropped paths, in place of the typed one.
    pub(super) chosen: Vec<PathBuf>,
    /// Whether depth, cameras and intrinsics that were found are used.
    pub(super) take_depth: bool,
    pub(super) take_cameras: bool,
    pub(super) take_intrinsics: bool,
    /// Folder of the new project; if empty, the suggested one is used.
    pub(super) root: String,
    /// Folder of depth images; if empty, depth that was found is used.
    pub(super) depth: String,
    /// File of cameras in any known format; if empty, cameras that were found are used.
    pub(super) cameras: String,
    pub(super) intrinsics: String,
    pub(super) depth_unit: f64,
    pub(super) depth_intrinsics: String,
    /// File with the pose of the depth camera.
    pub(super) depth_pose: String,
    pub(super) every: usize,
    pub(super) from: Option<usize>,
    pub(super) to: Option<usize>,
    pub(super) stage: Stage,
    /// Why the last request failed.
    pub(super) error: Option<String>,
    /// Whether the first field has got the keyboard since the dialog was opened.
    pub(super) was_focused: bool,
}

impl Default for NewProjectForm {
    fn default() -> Self {
        Self {
            kind: SourceKind::Any,
            frames: String::new(),
            chosen: Vec::new(),
            take_depth: true,
            take_cameras: true,
            take_intrinsics: true,
            root: String::new(),
            depth: String::new(),
            cameras: String::new(),
            intrinsics: String::new(),
            depth_unit: 0.001,
            depth_intrinsics: String::new(),
            depth_pose: String::new(),
            every: 1,
            from: None,
            to: None,
            stage: Stage::Editing,
            error: None,
            was_focused: false,
        }
    }
}

impl NewProjectForm {
    /// Returns an empty form for one kind of frames.
    #[must_use]
    pub fn of(kind: SourceKind) -> Self {
        Self {
            kind,
            ..Self::default()
        }
    }

    /// Returns a form with chosen folders, images or videos.
    #[must_use]
    pub fn with_paths(paths: Vec<PathBuf>) -> Self {
        let mut form = Self::default();
        form.set_paths(paths);
        form
    }

    /// Prepares the form for being shown again; what was filled in is kept.
    pub(crate) fn reopen(&mut self) {
        self.kind = SourceKind::Any;
        self.was_focused = false;
    }

    /// Adds dropped folders, images or videos to those in the form.
    pub fn add_paths(&mut self, paths: Vec<PathBuf>) {
        let mut all = self.paths();
        all.extend(paths);
        let mut seen = Vec::new();
        all.retain(|path| {
            !seen.contains(path) && {
                seen.push(path.clone());
                true
            }
        });
        self.set_paths(all);
    }

    /// Replaces what is chosen. A single path is put into the field, where it can be edited.
    pub(super) fn set_paths(&mut self, paths: Vec<PathBuf>) {
        self.error = None;
        self.frames.clear();
        match &paths[..] {
            [one] if !one.to_string_lossy().contains(';') => {
                self.frames = one.display().to_string();
                self.chosen.clear();
            }
            _ => self.chosen = paths,
        }
    }

    /// Returns the given paths.
    pub(super) fn paths(&self) -> Vec<PathBuf> {
        if self.chosen.is_empty() {
            typed_paths(&self.frames)
        } else {
            self.chosen.clone()
        }
    }

    /// Returns the request to read the given files; `None` while none are given.
    #[must_use]
    pub fn survey_request(&self) -> Option<SurveyRequest> {
        let paths = self.paths();
        (!paths.is_empty()).then(|| SurveyRequest {
            paths,
            depth: typed_path(&self.depth),
            depth_unit: self.depth_unit,
            depth_camera: self.depth_camera().ok().flatten(),
        })
    }

    /// Returns the request, or a message about what is wrong.
    pub(super) fn request(&self, survey: &Survey, needs_root: bool) -> Result<NewProject, String> {
        if let Some(error) = &survey.error {
            return Err(error.clone());
        }
        let root = typed_path(&self.root).or_else(|| survey.root.clone());
        let root = match (needs_root, root) {
            (false, _) => PathBuf::new(),
            (true, root) => root.ok_or("Choose a folder for the project")?,
        };
        if let (Some(from), Some(to)) = (self.from, self.to)
            && from > to
        {
            return Err("The first frame lies behind the last".into());
        }
        let mut sources = survey.sources.clone();
        if !self.uses_depth() {
            sources.iter_mut().for_each(|source| source.depth = None);
        }
        let found_cameras = survey.cameras.as_ref().filter(|_| self.take_cameras);
        let found_intrinsics = survey.intrinsics.clone().filter(|_| self.take_intrinsics);
        Ok(NewProject {
            root,
            open: OpenRequest {
                sources,
                depth_unit: self.depth_unit,
                float_depth_unit: OpenRequest::float_unit_for(self.depth_unit),
                depth_camera: self.depth_camera()?.filter(|_| self.uses_depth()),
                ignore_depth: !self.uses_depth(),
                every: self.every,
                from: self.from,
                to: self.to,
            },
            cameras: typed_path(&self.cameras).or(found_cameras.map(|found| found.path.clone())),
            intrinsics: intrinsics(&self.intrinsics)?
                .or(found_intrinsics.map(IntrinsicsSource::File)),
        })
    }

    /// Returns whether depth is used: typed depth always, depth that was found if it is ticked.
    fn uses_depth(&self) -> bool {
        self.take_depth || !self.depth.trim().is_empty()
    }

    pub(super) fn has_depth_camera(&self) -> bool {
        !self.depth_intrinsics.trim().is_empty() || !self.depth_pose.trim().is_empty()
    }

    /// Returns whether the request was sent and its job has not ended.
    pub(crate) fn is_sent(&self) -> bool {
        self.stage == Stage::Sent
    }

    /// Lets the user edit the form again after its job was stopped or has failed with an error.
    pub(crate) fn resume(&mut self, error: Option<String>) {
        self.stage = Stage::Editing;
        self.error = error;
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

/// Parses typed paths, which are separated by semicolons and may be quoted.
fn typed_paths(text: &str) -> Vec<PathBuf> {
    let unquoted = |text: &str| {
        let text = text.trim();
        let quoted = ['"', '\''].iter().find_map(|&quote| {
            text.strip_prefix(quote)
                .and_then(|rest| rest.strip_suffix(quote))
        });
        typed_path(quoted.unwrap_or(text))
    };
    text.split(';').filter_map(unquoted).collect()
}

/// Returns the whole path that a relative path stands for; `None` for a path that is whole.
pub(super) fn resolved(path: &Path) -> Option<PathBuf> {
    (!path.is_absolute())
        .then(|| std::path::absolute(path).ok())
        .flatten()
}

fn intrinsics(text: &str) -> Result<Option<IntrinsicsSource>, String> {
    let text = text.trim();
    let source = (!text.is_empty()).then(|| text.parse()).transpose()?;
    Ok(source.map(|source| match source {
        IntrinsicsSource::File(path) => IntrinsicsSource::File(typed_path(text).unwrap_or(path)),
        values => values,
    }))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use ostra_frames::FrameFolder;
    use ostra_session::{FoundCameras, FoundDepth};

    fn survey(form: &NewProjectForm) -> Survey {
        let request = form.survey_request().unwrap();
        Survey {
            sources: vec![FrameFolder {
                frames: request.paths[0].clone(),
                depth: Some("/a/depth".into()),
            }],
            request,
            frames: Arc::default(),
            depth: Some(FoundDepth {
                frames: 3,
                folder: "/a/depth".into(),
            }),
            cameras: Some(FoundCameras {
                path: "/a/sparse".into(),
                frames: 3,
            }),
            intrinsics: Some("/a/intrinsic.json".into()),
            root: Some("/a-ostra".into()),
            warnings: Vec::new(),
            error: None,
        }
    }

    fn form() -> NewProjectForm {
        NewProjectForm::with_paths(vec!["/a/color".into()])
    }

    #[test]
    fn what_was_found_is_used_unless_it_is_unticked() {
        let mut form = form();
        let request = form.request(&survey(&form), true).unwrap();
        assert_eq!(request.root, Path::new("/a-ostra"));
        assert_eq!(request.cameras, Some("/a/sparse".into()));
        assert_eq!(
            request.intrinsics,
            Some(IntrinsicsSource::File("/a/intrinsic.json".into()))
        );
        assert_eq!(request.open.sources[0].depth, Some("/a/depth".into()));
        assert!(!request.open.ignore_depth);

        (form.take_depth, form.take_cameras, form.take_intrinsics) = (false, false, false);
        let request = form.request(&survey(&form), true).unwrap();
        assert_eq!((request.cameras, request.intrinsics), (None, None));
        assert_eq!(request.open.sources[0].depth, None);
        assert!(request.open.ignore_depth);
        form.cameras = "/b.json".into();
        let request = form.request(&survey(&form), true).unwrap();
        assert_eq!(request.cameras, Some("/b.json".into()), "typed");
    }

    #[test]
    fn one_path_is_edited_and_several_are_listed() {
        let mut form = form();
        assert_eq!((form.frames.as_str(), form.chosen.len()), ("/a/color", 0));
        form.add_paths(vec!["/b".into(), "/a/color".into()]);
        assert_eq!((form.frames.as_str(), form.chosen.len()), ("", 2));
        form.chosen.clear();
        form.frames = " \"/a b\" ; '/c'; d ".into();
        let expected = ["/a b", "/c", "d"].map(PathBuf::from);
        assert_eq!(form.paths(), expected);
    }

    #[test]
    fn intrinsics_are_empty_four_numbers_or_a_file() {
        let mut form = form();
        form.intrinsics = "500, 500, 320.5, 240".into();
        assert_eq!(
            form.request(&survey(&form), true).unwrap().intrinsics,
            Some(IntrinsicsSource::Values([500.0, 500.0, 320.5, 240.0]))
        );
        form.intrinsics = "/recording/intrinsic.json".into();
        let file = Some(IntrinsicsSource::File("/recording/intrinsic.json".into()));
        assert_eq!(form.request(&survey(&form), true).unwrap().intrinsics, file);
        form.intrinsics = "500, x".into();
        let error = form.request(&survey(&form), true).unwrap_err();
        assert!(error.contains("four numbers"));
    }

    #[test]
    fn depth_camera_needs_intrinsics_but_no_pose() {
        let mut form = form();
        let given = |form: &NewProjectForm| {
            let request = form.request(&survey(form), true);
            request.map(|request| request.open.depth_camera)
        };
        assert_eq!(given(&form), Ok(None));
        form.depth_intrinsics = "580, 580, 320, 240".into();
        let intrinsics = IntrinsicsSource::Values([580.0, 580.0, 320.0, 240.0]);
        let camera = |pose| {
            Some(DepthCameraSource {
                intrinsics: intrinsics.clone(),
                pose,
            })
        };
        assert_eq!(given(&form), Ok(camera(None)));
        form.depth_pose = "/depth.txt".into();
        assert_eq!(given(&form), Ok(camera(Some("/depth.txt".into()))));
        form.depth_intrinsics.clear();
        assert!(given(&form).unwrap_err().contains("intrinsics"));
    }
}
