use std::path::{Path, PathBuf};

use super::lines::{TextFile, invalid};
use super::{
    GivenCameras, colmap_binary, colmap_text, dtu, middlebury, pose_files, trajectory_log,
    transforms, tum,
};
use crate::FrameError;

/// Maximum number of files that are read to detect poses: the first ones may be damaged.
const MAX_TRIED: usize = 8;

impl GivenCameras {
    /// Reads the cameras in `path`, whose format is detected from names and content.
    ///
    /// The formats are: a COLMAP model (its folder or one with `sparse/` or `sparse/0`),
    /// `transforms.json`, a TUM trajectory, a `.log` trajectory, a folder of 4×4 pose files,
    /// Middlebury `*_par.txt`, and a folder of DTU `pos_NNN.txt`.
    ///
    /// # Errors
    ///
    /// [`FrameError`] if a file cannot be read; it names the file, and the line if there is one.
    pub fn read(path: &Path) -> Result<Self, FrameError> {
        let cameras = if path.is_dir() {
            read_folder(path)?
        } else {
            read_file(path)?
        };
        Self::new(path.to_owned(), cameras)
    }
}

/// Returns the folder of a COLMAP model in `path`: itself, `sparse/` or `sparse/0`.
pub fn colmap_folder(path: &Path) -> Option<PathBuf> {
    ["", "sparse", "sparse/0"]
        .iter()
        .map(|below| path.join(below))
        .find(|folder| model_ending(folder).is_some())
}

/// Returns `bin` or `txt`; as in COLMAP, the binary model wins if both exist.
fn model_ending(folder: &Path) -> Option<&'static str> {
    let whole = |ending: &str| {
        ["cameras", "images"]
            .iter()
            .all(|name| folder.join(format!("{name}.{ending}")).is_file())
    };
    ["bin", "txt"].into_iter().find(|ending| whole(ending))
}

fn read_model(folder: &Path) -> Result<Vec<super::GivenCamera>, FrameError> {
    if model_ending(folder) == Some("bin") {
        colmap_binary::read(folder)
    } else {
        colmap_text::read(folder)
    }
}

fn read_folder(path: &Path) -> Result<Vec<super::GivenCamera>, FrameError> {
    if let Some(folder) = colmap_folder(path) {
        return read_model(&folder);
    }
    let json = path.join("transforms.json");
    if json.is_file() {
        return transforms::read(&json);
    }
    let texts = text_files(path)?;
    let named = |ending: &str| {
        texts
            .iter()
            .filter(|file| file_name(file).ends_with(ending))
            .cloned()
            .collect::<Vec<_>>()
    };
    if let [parameters] = named("_par.txt").as_slice() {
        return middlebury::read(&TextFile::read(parameters)?);
    }
    if texts.iter().any(|file| dtu::number_of(file).is_some()) {
        return dtu::read(&texts);
    }
    let poses = named(".pose.txt");
    if !poses.is_empty() {
        return pose_files::read(&poses);
    }
    let is_pose =
        |path: &PathBuf| TextFile::read(path).is_ok_and(|file| file.numbers::<16>().is_ok());
    if texts.iter().take(MAX_TRIED).any(is_pose) {
        return pose_files::read(&texts);
    }
    Err(invalid(
        path,
        "holds no cameras: a COLMAP model, transforms.json, *_par.txt, pos_NNN.txt or *.pose.txt files belong here",
    ))
}

fn file_name(path: &Path) -> std::borrow::Cow<'_, str> {
    path.file_name().unwrap_or_default().to_string_lossy()
}

/// Returns the `.txt` files of a folder in order of name, without hidden ones.
fn text_files(folder: &Path) -> Result<Vec<PathBuf>, FrameError> {
    let failed = |reason| FrameError::Io {
        path: folder.to_owned(),
        reason,
    };
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let is_hidden = file_name(&path).starts_with('.'); // macOS writes "._NAME" next to a file
        if !is_hidden && path.extension().is_some_and(|ending| ending == "txt") && path.is_file() {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

fn read_file(path: &Path) -> Result<Vec<super::GivenCamera>, FrameError> {
    let name = file_name(path);
    if name.ends_with(".json") {
        return transforms::read(path);
    }
    if let "cameras.txt" | "images.txt" | "points3D.txt" | "cameras.bin" | "images.bin"
    | "points3D.bin" = &*name
    {
        let folder = path
            .parent()
            .filter(|folder| model_ending(folder).is_some())
            .ok_or_else(|| {
                invalid(
                    path,
                    "is one part of a COLMAP model; cameras and images belong in its folder",
                )
            })?;
        return read_model(folder);
    }
    let file = TextFile::read(path)?;
    let words: Vec<usize> = file
        .content()
        .take(2)
        .map(|line| line.words().count())
        .collect();
    match words.as_slice() {
        [] => Err(invalid(path, "is empty; give a file of cameras")),
        [1, 22] => middlebury::read(&file),
        [3, ..] => trajectory_log::read(&file),
        [8, ..] => tum::read(&file),
        [4, 4] => pose_files::read(&[path.to_owned()]),
        _ => Err(invalid(
            path,
            "is not a known camera file; known are COLMAP model, transforms.json, TUM or .log trajectory, *_par.txt",
        )),
    }
}
