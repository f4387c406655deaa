//! What files chosen for a new project hold.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Result;

use crate::query::QueryKey;
use ostra_core::disk::AtomicFile;
use ostra_core::job::Progress;
use ostra_frames::cameras::{DepthCameraSource, GivenCameras, IntrinsicsSource, attach_intrinsics};
use ostra_frames::{
    Companions, Frame, FrameFolder, ImageSource, OpenRequest, Opened, natural_order, open,
};
use ostra_project::store::Folder;

/// Files that are chosen for a new project.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SurveyRequest {
    /// Folders, images and videos.
    pub paths: Vec<PathBuf>,
    /// Depth folder; `None` searches for one.
    pub depth: Option<PathBuf>,
    /// World units per step of the 16-bit depth.
    pub depth_unit: f64,
    /// Camera that measured the depth, if it is not that of the images.
    pub depth_camera: Option<DepthCameraSource>,
}

impl QueryKey for SurveyRequest {
    const TITLE: &'static str = "Read files";
}

/// What the files of a new project hold.
#[derive(Debug, Clone, PartialEq)]
pub struct Survey {
    /// Files that were read.
    pub request: SurveyRequest,
    /// Sources to open, with the depth that was found for them.
    pub sources: Vec<FrameFolder>,
    /// All frames, without cameras; empty if they cannot be opened.
    pub frames: Arc<Vec<Frame>>,
    /// Depth, if some frames have any.
    pub depth: Option<FoundDepth>,
    /// Cameras that fit the frames.
    pub cameras: Option<FoundCameras>,
    /// File of intrinsics that fit the frames, if the cameras have none.
    pub intrinsics: Option<PathBuf>,
    /// Suggested folder of the project.
    pub root: Option<PathBuf>,
    /// Warnings, one line each.
    pub warnings: Vec<String>,
    /// Why the files cannot be opened.
    pub error: Option<String>,
}

/// Depth of frames.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FoundDepth {
    /// Number of frames that have depth.
    pub frames: usize,
    /// Folder of the first depth image.
    pub folder: PathBuf,
}

/// Cameras of frames.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FoundCameras {
    /// File or folder of the cameras.
    pub path: PathBuf,
    /// Number of frames that have a camera with a pose.
    pub frames: usize,
}

impl Survey {
    /// Returns the most common size of the frames and the number of frames with another size.
    #[must_use]
    pub fn size(&self) -> Option<((u32, u32), usize)> {
        let mut counts = BTreeMap::<(u32, u32), usize>::new();
        for frame in self.frames.iter() {
            *counts.entry((frame.width, frame.height)).or_default() += 1;
        }
        let (&size, &count) = counts.iter().max_by_key(|&(_, &count)| count)?;
        Some((size, self.frames.len() - count))
    }

    /// Returns whether the frames are those of videos.
    #[must_use]
    pub fn is_video(&self) -> bool {
        self.frames
            .first()
            .is_some_and(|frame| matches!(frame.image, ImageSource::Video { .. }))
    }
}

/// Reads what files hold, as opening them would.
///
/// # Errors
///
/// Returns an error only if stopped. Files that cannot be opened are a part of the result.
pub(crate) fn survey_frames(request: &SurveyRequest, progress: &Progress) -> Result<Survey> {
    let given = sources(request);
    let first = given.first().map(|source| source.frames.clone());
    let companions = first.as_deref().map(Companions::find).unwrap_or_default();
    let (sources, opened) = open_with_depth(request, given, progress);
    progress.check()?;
    let mut survey = Survey {
        request: request.clone(),
        sources,
        frames: Arc::default(),
        depth: None,
        cameras: None,
        intrinsics: None,
        root: first.as_deref().and_then(suggested_root),
        warnings: Vec::new(),
        error: None,
    };
    match opened {
        Err(error) => survey.error = Some(error),
        Ok(Opened { frames, warnings }) => {
            survey.warnings = warnings;
            survey.depth = found_depth(&frames);
            find_cameras(&mut survey, &companions, &frames);
            progress.check()?;
            survey.frames = Arc::new(frames);
        }
    }
    Ok(survey)
}

/// Returns the sources of a request.
///
/// A folder of depth that is given together with the folder of its images is its depth.
fn sources(request: &SurveyRequest) -> Vec<FrameFolder> {
    let mut paths = request.paths.clone();
    // File choosers return a selection in any order.
    if paths.iter().all(|path| is_image(path)) {
        let name = |path: &PathBuf| path.to_string_lossy().into_owned();
        paths.sort_by(|a, b| natural_order(&name(a), &name(b)));
    }
    let mut sources = Vec::new();
    while !paths.is_empty() {
        let frames = paths.remove(0);
        let depth = Companions::depth_of(&frames);
        let given = depth.and_then(|depth| paths.iter().position(|path| *path == depth));
        let depth = given.map(|place| paths.remove(place));
        sources.push(FrameFolder { frames, depth });
    }
    // The depth may have been given before the images.
    let depths: Vec<PathBuf> = sources
        .iter()
        .filter_map(|source| Companions::depth_of(&source.frames))
        .filter(|depth| sources.iter().any(|source| source.frames == *depth))
        .collect();
    sources.retain(|source| !depths.contains(&source.frames));
    for source in sources.iter_mut().filter(|source| source.depth.is_none()) {
        source.depth = Companions::depth_of(&source.frames).filter(|depth| depths.contains(depth));
    }
    if let ([source], Some(depth)) = (&mut sources[..], &request.depth) {
        source.depth = Some(depth.clone());
    }
    sources
}

/// Opens the sources with depth that lies next to them, or without it if it does not fit.
fn open_with_depth(
    request: &SurveyRequest,
    given: Vec<FrameFolder>,
    progress: &Progress,
) -> (Vec<FrameFolder>, Result<Opened, String>) {
    let opened = |sources: &[FrameFolder]| {
        let request = OpenRequest {
            sources: sources.to_vec(),
            depth_unit: request.depth_unit,
            float_depth_unit: OpenRequest::float_unit_for(request.depth_unit),
            depth_camera: request.depth_camera.clone(),
            ..OpenRequest::default()
        };
        open(&request, progress).map_err(|error| error.to_string())
    };
    let mut with = given.clone();
    for source in with.iter_mut().filter(|source| source.depth.is_none()) {
        source.depth = Companions::depth_of(&source.frames);
    }
    let first = opened(&with);
    match first {
        Err(why) if with != given => {
            let mut plain = opened(&given);
            if let Ok(plain) = &mut plain {
                let depth = with.iter().find_map(|source| source.depth.as_deref());
                let depth = depth.unwrap_or(Path::new("")).display();
                plain
                    .warnings
                    .push(format!("the depth in {depth} is left out: {why}"));
            }
            (given, plain)
        }
        first => (with, first),
    }
}

fn found_depth(frames: &[Frame]) -> Option<FoundDepth> {
    let mut depths = frames
        .iter()
        .filter_map(|frame| frame.depth.as_ref()?.sensor_path());
    let folder = depths.next()?.parent()?.to_owned();
    Some(FoundDepth {
        frames: depths.count() + 1,
        folder,
    })
}

/// Finds cameras and intrinsics that fit the frames.
///
/// A warning reports cameras that do not fit.
fn find_cameras(survey: &mut Survey, companions: &Companions, frames: &[Frame]) {
    let intrinsics = companions.intrinsics.iter().find_map(|path| {
        let read = IntrinsicsSource::File(path.clone()).read().ok()?;
        let mut frames = frames.to_vec();
        attach_intrinsics(&mut frames, &read).ok()?;
        Some((path.clone(), frames))
    });
    let mut why_unfit = None;
    for path in &companions.cameras {
        let fitted = GivenCameras::read(path).and_then(|given| {
            let mut frames = match &intrinsics {
                Some((_, frames)) if !given.have_intrinsics() => frames.clone(),
                _ => frames.to_vec(),
            };
            let warnings = given.match_to(&mut frames)?;
            Ok((given.have_intrinsics(), warnings, frames))
        });
        match fitted {
            Ok((have_intrinsics, warnings, frames)) => {
                let posed = frames.iter().filter(|frame| frame.posed_camera().is_some());
                survey.cameras = Some(FoundCameras {
                    path: path.clone(),
                    frames: posed.count(),
                });
                survey.warnings.extend(warnings);
                survey.intrinsics = intrinsics
                    .filter(|_| !have_intrinsics)
                    .map(|(path, _)| path);
                return;
            }
            Err(error) => _ = why_unfit.get_or_insert(error),
        }
    }
    if let Some(error) = why_unfit {
        survey
            .warnings
            .push(format!("cameras were found but do not fit: {error}"));
    }
    survey.intrinsics = intrinsics.map(|(path, _)| path);
}

/// Names of folders that say nothing about their content, in lower case.
const PLAIN_NAMES: [&str; 22] = [
    "color",
    "colour",
    "rgb",
    "image",
    "images",
    "img",
    "imgs",
    "photo",
    "photos",
    "frame",
    "frames",
    "jpg",
    "jpeg",
    "png",
    "raw",
    "data",
    "input",
    "inputs",
    "dcim",
    "depth",
    "recording",
    "undistorted",
];

/// Suggests a folder for the project of these frames: next to the data, not inside it.
///
/// Where that folder cannot be written, the user's documents are suggested. The folder does not
/// exist yet.
fn suggested_root(frames: &Path) -> Option<PathBuf> {
    let frames = std::path::absolute(frames).ok()?;
    let is_video = frames.is_file() && !is_image(&frames);
    let mut data: &Path = if frames.is_file() && !is_video {
        frames.parent()?
    } else {
        &frames
    };
    let is_plain = |path: &Path| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        PLAIN_NAMES.contains(&name.to_lowercase().as_str())
    };
    while is_plain(data)
        && let Some(above) = data.parent().filter(|above| above.file_name().is_some())
    {
        data = above;
    }
    let name = if is_video {
        data.file_stem()
    } else {
        data.file_name()
    };
    let name = format!("{}-ostra", name?.to_string_lossy());
    let places = [
        data.parent().map(Path::to_owned),
        dirs::document_dir(),
        dirs::home_dir(),
    ];
    let place = places
        .into_iter()
        .flatten()
        .find(|place| is_writable(place))?;
    let numbered = |number: usize| match number {
        1 => place.join(&name),
        _ => place.join(format!("{name}-{number}")),
    };
    (1..1000)
        .map(numbered)
        .find(|root| Folder::check_new(root).is_ok())
}

fn is_image(path: &Path) -> bool {
    let ending = path.extension().unwrap_or_default().to_string_lossy();
    ostra_frames::IMAGE_ENDINGS.contains(&ending.to_lowercase().as_str())
}

/// Returns whether files can be made in a folder, found out by making one that is removed at once.
fn is_writable(folder: &Path) -> bool {
    AtomicFile::create(&folder.join("ostra-can-write")).is_ok()
}

#[cfg(test)]
mod tests;
