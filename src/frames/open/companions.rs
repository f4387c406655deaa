//! Depth, cameras and intrinsics that lie next to images.

use std::path::{Path, PathBuf};

use super::source::{COLOR_FOLDERS, DEPTH_FOLDERS};

/// Names of files and folders of cameras, most likely first.
const CAMERAS: [&str; 11] = [
    "sparse/0",
    "sparse",
    "colmap/sparse/0",
    "colmap/sparse",
    "colmap",
    "transforms.json",
    "groundtruth.txt",
    "trajectory.log",
    "trajectory.txt",
    "poses",
    "pose",
];

/// Files that make their folder a COLMAP model.
const MODEL_FILES: [&str; 2] = ["images.bin", "images.txt"];

/// Names of files of intrinsics, most likely first.
const INTRINSICS: [&str; 8] = [
    "intrinsic.json",
    "intrinsics.json",
    "camera_intrinsic.json",
    "intrinsic/intrinsic_color.txt",
    "intrinsic_color.txt",
    "intrinsics.txt",
    "intrinsic.txt",
    "camera-intrinsics.txt",
];

/// Files that lie next to images and may describe them.
///
/// They are found by name; whether they belong to the images shows when they are read.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Companions {
    /// Folder of depth images.
    pub depth: Option<PathBuf>,
    /// Files and folders of cameras, most likely first.
    pub cameras: Vec<PathBuf>,
    /// Files of intrinsics, most likely first.
    pub intrinsics: Vec<PathBuf>,
}

impl Companions {
    /// Finds what lies next to the images in a folder, or next to a single image or video.
    ///
    /// The folder above is searched too if the folder has a name that recordings use for their
    /// colour images. Otherwise, the folder above may hold other recordings.
    #[must_use]
    pub fn find(frames: &Path) -> Self {
        let folder = if frames.is_dir() {
            Some(frames)
        } else {
            frames.parent()
        };
        let Some(folder) = folder else {
            return Self::default();
        };
        let above = folder.parent().filter(|_| is_color_folder(folder));
        let places: Vec<&Path> = [Some(folder), above].into_iter().flatten().collect();
        let mut cameras = existing(&places, &CAMERAS);
        let models = places
            .iter()
            .filter(|place| MODEL_FILES.iter().any(|name| place.join(name).is_file()));
        cameras.extend(models.map(|place| (*place).to_owned()));
        Self {
            depth: Self::depth_of(frames),
            cameras,
            intrinsics: existing(&places, &INTRINSICS),
        }
    }

    /// Finds the folder of depth images next to a folder of colour images.
    #[must_use]
    pub fn depth_of(frames: &Path) -> Option<PathBuf> {
        if !is_color_folder(frames) || !frames.is_dir() {
            return None;
        }
        DEPTH_FOLDERS
            .map(|name| frames.with_file_name(name))
            .into_iter()
            .find(|place| place.is_dir())
    }
}

fn existing(places: &[&Path], names: &[&str]) -> Vec<PathBuf> {
    let all = names
        .iter()
        .flat_map(|name| places.iter().map(move |place| place.join(name)));
    all.filter(|path| path.exists()).collect()
}

/// Returns whether recordings use this folder's name for their colour images.
fn is_color_folder(folder: &Path) -> bool {
    let name = folder.file_name().unwrap_or_default().to_string_lossy();
    COLOR_FOLDERS
        .iter()
        .any(|known| name.eq_ignore_ascii_case(known))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn depth_and_cameras_next_to_a_colour_folder_are_found() {
        let root = tempfile::tempdir().unwrap();
        let at = |name: &str| root.path().join(name);
        for folder in ["color", "depth", "sparse/0", "photos"] {
            fs::create_dir_all(at(folder)).unwrap();
        }
        fs::write(at("intrinsic.json"), "{}").unwrap();
        let found = Companions::find(&at("color"));
        assert_eq!(found.depth, Some(at("depth")));
        assert_eq!(found.cameras, [at("sparse/0"), at("sparse")]);
        assert_eq!(found.intrinsics, [at("intrinsic.json")]);
        assert_eq!(
            Companions::find(&at("photos")),
            Companions::default(),
            "the folder above may hold other recordings"
        );
    }

    #[test]
    fn cameras_inside_the_folder_of_images_are_found() {
        let root = tempfile::tempdir().unwrap();
        fs::write(root.path().join("transforms.json"), "{}").unwrap();
        fs::write(root.path().join("images.txt"), "").unwrap();
        let expected = [root.path().join("transforms.json"), root.path().to_owned()];
        assert_eq!(Companions::find(root.path()).cameras, expected);
        let photo = root.path().join("1.jpg");
        fs::write(&photo, "").unwrap();
        assert_eq!(Companions::find(&photo).cameras, expected);
    }
}
