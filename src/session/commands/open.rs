use std::path::{Path, absolute};
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};

use crate::Event;
use crate::session::{Background, PIXEL_BYTES};
use crate::{JobCompletion, JobKind};
use crate::{NewProject, Session};
use ostra_cloud::ply::read_ply;
use ostra_core::job::JobId;
use ostra_core::job::Progress;
use ostra_frames::cameras::{GivenCameras, attach_intrinsics};
use ostra_frames::{self, Frame, FrameStore, ImageSource, OpenRequest, Opened};
use ostra_project::OpenProject;
use ostra_project::store::{Folder, Loaded, LockError};
use ostra_project::{Coordinates, Edit, Project};
use ostra_project::{make_relative, origin_near};

impl Session {
    pub(crate) fn new_project(&mut self, new: &NewProject) -> Result<JobId> {
        let new = NewProject {
            root: full_path(&new.root)?,
            ..new.clone()
        };
        Folder::check_new(&new.root)?;
        Ok(self.start("Open frames", JobKind::Short, move |context| {
            let mut opened = read_frames(&new, &context.progress)?;
            let origin = origin_near(&opened.frames);
            make_relative(&mut opened.frames, origin);
            let project = Project {
                frames: Arc::default(),
                origin,
                ..Project::default()
            };
            let project = with_frames(project, opened.frames)?;
            let open = OpenProject::create(&new.root, project)?;
            Ok(take_open(open, opened.warnings))
        }))
    }

    pub(crate) fn open_project(&mut self, root: &Path) -> Result<JobId> {
        let root = full_path(root)?;
        ensure!(
            self.root() != Some(root.as_path()),
            "{}: is open already",
            root.display()
        );
        Ok(self.start("Open project", JobKind::Short, move |context| {
            let mut loaded = open_or_view(&root, &context.progress)?;
            let warnings = std::mem::take(&mut loaded.warnings);
            Ok(take_open(OpenProject::loaded(loaded), warnings))
        }))
    }

    pub(crate) fn view_project(&mut self, root: &Path) -> Result<JobId> {
        let root = full_path(root)?;
        ensure!(
            self.root() != Some(root.as_path()),
            "{}: is open already",
            root.display()
        );
        Ok(self.start("Open project", JobKind::Short, move |context| {
            let mut loaded = Folder::view(&root, "it was opened read-only", &context.progress)?;
            let warnings = std::mem::take(&mut loaded.warnings);
            Ok(take_open(OpenProject::loaded(loaded), warnings))
        }))
    }

    pub(crate) fn inspect(&mut self, path: &Path) -> Result<JobId> {
        let path = std::path::absolute(path)
            .with_context(|| format!("{}: is not a valid path", path.display()))?;
        Ok(self.start("Open cloud", JobKind::Short, move |context| {
            let read = read_ply(&path, &context.progress)?;
            Ok(Box::new(move |session: &mut Self| {
                session.close();
                session.background.cloud.put(None, read.cloud, None);
                session.inspected = Some(path.clone());
                session
                    .events
                    .extend([Event::Inspecting(path), Event::CloudChanged]);
                session.warn_all(read.warnings);
                Ok(())
            }) as JobCompletion)
        }))
    }

    /// Closes the open project or PLY.
    ///
    /// The project is closed even if its last checkpoint cannot be written, because the journal
    /// holds every step.
    pub(crate) fn close(&mut self) {
        self.discard_jobs();
        if let Err(error) = self.save() {
            self.events.push(Event::Warning(format!(
                "{error:#}; the project is safe in its journal"
            )));
        }
        self.prompting.preparing = None;
        // Results are identified by number, and every project has its own numbering.
        self.background = Background::default();
        self.suggestions.clear();
        self.grounding = None;
        self.unfinished = None;
        self.running_record = None;
        let was_open = self.open.take().is_some() | self.inspected.take().is_some();
        if was_open {
            self.events.push(Event::Closed);
        }
    }

    pub(crate) fn add_frames(&mut self, new: &NewProject) -> Result<JobId> {
        let project = self.snapshot()?;
        let new = new.clone();
        Ok(self.start("Add frames", JobKind::Short, move |context| {
            let Opened { frames, warnings } = read_frames(&new, &context.progress)?;
            let frames = with_free_names(frames, &project)?;
            Ok(Box::new(move |session: &mut Self| {
                let mut frames = in_scene_scale(frames, &*session.snapshot()?);
                let title = format!("Add {} frames", frames.len());
                let edits = add_in_place(&mut frames, session.snapshot()?.as_ref());
                session.commit(
                    &title,
                    edits
                        .into_iter()
                        .chain([Edit::AddFrames { frames }])
                        .collect(),
                )?;
                session.warn_all(warnings);
                Ok(())
            }))
        }))
    }
}

/// Opens a project for writing, or for viewing if its folder cannot be written.
///
/// Read-only media are an example. A warning reports it.
fn open_or_view(root: &Path, progress: &Progress) -> Result<Loaded> {
    let error = match Folder::open(root, progress) {
        Ok(loaded) => return Ok(loaded),
        Err(error) => error,
    };
    if !matches!(error.downcast_ref(), Some(LockError::NotWritable { .. })) {
        return Err(error);
    }
    let mut loaded = Folder::view(
        root,
        "its folder cannot be written; copy it to one with write access",
        progress,
    )?;
    loaded
        .warnings
        .insert(0, format!("{error:#}; it is open for viewing"));
    Ok(loaded)
}

/// Makes the poses of frames to be added relative to the project's origin.
///
/// If these are the first cameras, or the project needs an origin and has none, the returned edits
/// set it.
fn add_in_place(frames: &mut [Frame], project: &Project) -> Vec<Edit> {
    let mut edits = project.move_origin_near_cameras();
    let moved = edits.iter().find_map(|edit| match edit {
        Edit::SetOrigin { origin } => Some(*origin),
        _ => None,
    });
    let is_posed = project
        .frames
        .iter()
        .any(|frame| frame.posed_camera().is_some());
    let origin = moved.unwrap_or_else(|| {
        if is_posed {
            project.origin
        } else {
            origin_near(frames)
        }
    });
    if moved.is_none() && origin != project.origin {
        edits.push(Edit::SetOrigin { origin });
    }
    make_relative(frames, origin);
    edits
}

/// Replaces the open project.
fn take_open(open: OpenProject, warnings: Vec<String>) -> JobCompletion {
    Box::new(move |session| {
        session.close();
        session.events.push(Event::Opened(open.root().to_owned()));
        session.store = Arc::new(FrameStore::at_home(PIXEL_BYTES, open.root().to_owned()));
        session.open = Some(open);
        session.find_unfinished();
        session.report_changed();
        session.warn_all(warnings);
        Ok(())
    })
}

/// Scales given cameras of added frames like the given cameras of the project.
fn in_scene_scale(mut frames: Vec<Frame>, project: &Project) -> Vec<Frame> {
    let coordinates = project.coordinates();
    if coordinates.world == Coordinates::OF_GIVEN_CAMERAS {
        let poses = frames
            .iter_mut()
            .filter_map(|frame| frame.camera.as_mut()?.camera_from_world.as_mut());
        poses.for_each(|pose| pose.translation *= coordinates.scale);
    }
    frames
}

fn full_path(path: &Path) -> Result<std::path::PathBuf> {
    absolute(path).with_context(|| format!("{}: is not a valid path", path.display()))
}

fn with_frames(mut project: Project, frames: Vec<Frame>) -> Result<Project> {
    project.apply(Edit::AddFrames { frames })?;
    Ok(project)
}

/// Reads the requested frames with their cameras.
///
/// Cameras are matched before frames are left out, because some formats count the frames.
fn read_frames(new: &NewProject, progress: &Progress) -> Result<Opened> {
    let all = OpenRequest {
        every: 1,
        from: None,
        to: None,
        ..new.open.clone()
    };
    let request = if new.cameras.is_some() {
        &all
    } else {
        &new.open
    };
    let mut opened = ostra_frames::open(request, progress)?;
    if let Some(intrinsics) = &new.intrinsics {
        attach_intrinsics(&mut opened.frames, &intrinsics.read()?)?;
    }
    if let Some(path) = &new.cameras {
        let warnings = GivenCameras::read(path)?.match_to(&mut opened.frames)?;
        opened.warnings.extend(warnings);
        opened.frames = thinned(opened.frames, &new.open)?;
        if !opened.frames.iter().any(Frame::has_sensor_depth) {
            opened.warnings.push(UNIT_ASSUMED.to_owned());
        }
    }
    if new.open.depth_camera.is_some() {
        check_seen(&opened.frames)?;
    }
    Ok(opened)
}

/// Warning for given cameras whose unit nothing confirms.
const UNIT_ASSUMED: &str = "the given cameras are taken to be in metres; a model made from photos alone (as by COLMAP) \
     has no unit: set the scale before you measure";

/// Checks that the camera of each frame with depth from another camera is known.
///
/// Such a depth is re-projected to the image's camera.
fn check_seen(frames: &[Frame]) -> Result<()> {
    let unseen = frames
        .iter()
        .find(|frame| frame.depth.is_some() && frame.camera.is_none());
    let name = unseen.map_or("", |frame| &frame.name);
    ensure!(
        unseen.is_none(),
        "frame {name}: a depth camera needs the image's camera too; give it (--intrinsics, or --cameras of all frames)"
    );
    Ok(())
}

fn thinned(frames: Vec<Frame>, request: &OpenRequest) -> Result<Vec<Frame>> {
    ensure!(
        request.every > 0,
        "'every' must be at least 1, got 0: 1 takes each frame, 2 every second one"
    );
    let count = frames.len();
    let (from, to) = (request.from.unwrap_or(0), request.to.unwrap_or(usize::MAX));
    let taken: Vec<Frame> = frames
        .into_iter()
        .enumerate()
        .filter(|(number, _)| {
            (from..=to).contains(number) && (number - from).is_multiple_of(request.every)
        })
        .map(|(_, frame)| frame)
        .collect();
    ensure!(
        !taken.is_empty(),
        "no frame is left between {from} and {to}; the sources have {count}"
    );
    Ok(taken)
}

/// Extends the names of frames that are already taken.
///
/// Leading parts of their path are prepended, as many as are needed to make all names distinct.
fn with_free_names(mut frames: Vec<Frame>, project: &Project) -> Result<Vec<Frame>> {
    let taken: std::collections::BTreeSet<&str> = project
        .frames
        .iter()
        .map(|frame| frame.name.as_str())
        .collect();
    if !frames
        .iter()
        .any(|frame| taken.contains(frame.name.as_str()))
    {
        return Ok(frames);
    }
    for more in 1..64 {
        let names: Vec<String> = frames
            .iter()
            .map(|frame| longer_name(frame, more))
            .collect();
        let distinct = names
            .iter()
            .collect::<std::collections::BTreeSet<_>>()
            .len()
            == names.len();
        if distinct && !names.iter().any(|name| taken.contains(name.as_str())) {
            frames
                .iter_mut()
                .zip(names)
                .for_each(|(frame, name)| frame.name = name);
            return Ok(frames);
        }
    }
    let name = frames
        .iter()
        .find(|frame| taken.contains(frame.name.as_str()))
        .map_or("", |frame| &frame.name);
    bail!("frame '{name}' is in the project already; leave it out")
}

fn longer_name(frame: &Frame, more: usize) -> String {
    let (path, below) = match &frame.image {
        ImageSource::File { path, .. } => (path, 0),
        ImageSource::Video { path, .. } => (path, 1),
    };
    let parts: Vec<_> = path
        .iter()
        .filter_map(|part| part.to_str())
        .filter(|part| !part.contains(['/', '\\']))
        .collect();
    let shown = frame.name.split('/').count() - below;
    let first = parts.len().saturating_sub(shown + more);
    let mut name = parts[first..].join("/");
    if let (1, Some((_, number))) = (below, frame.name.rsplit_once('/')) {
        name = format!("{name}/{number}");
    }
    name
}
