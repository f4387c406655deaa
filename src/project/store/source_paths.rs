//! Paths of the frames' sources.
//!
//! They are relative to the project in `project.toml`, absolute in memory, and found again after
//! the project was moved together with them.

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use crate::Project;
use ostra_frames::{Frame, check_source, sources, sources_mut};

/// Number of folders, from a moved project upwards, in which its sources are searched.
const LEVELS: usize = 5;

/// Maximum number of files that are checked before a folder is accepted as the right one.
const SAMPLES: usize = 16;

/// Makes source paths relative to the project's folder if they share a folder with it.
pub fn make_relative(frame: &mut Frame, folder: &Path) {
    // The meaning of `..` in a path depends on the links before it, so such a path is not changed.
    let is_plain = |path: &Path| !path.components().any(|part| part == Component::ParentDir);
    for path in sources_mut(frame).filter(|path| is_plain(path)) {
        if let Some(relative) = relative(folder, path) {
            *path = relative;
        }
    }
}

/// Makes relative source paths of a frame absolute.
///
/// This also turns anything that looks like a URL or an option into a plain file below the folder.
pub fn make_absolute(frame: &mut Frame, folder: &Path) {
    for path in sources_mut(frame).filter(|path| !path.is_absolute()) {
        *path = joined(folder, path);
    }
}

/// Updates the paths of sources that were moved together with the project.
///
/// Sources are looked up at the same place relative to the project as in the folder `former`. If
/// that fails, they are searched near the project. Every file that is accepted has the pixel size
/// of its frame. Returns warnings that the user should check.
pub fn find_moved(project: &mut Project, former: Option<&Path>, root: &Path) -> Vec<String> {
    let root = std::path::absolute(root).unwrap_or_else(|_| root.to_owned());
    let frames = &project.frames;
    if frames
        .iter()
        .flat_map(sources)
        .any(|path| !path.is_absolute())
    {
        Arc::make_mut(&mut project.frames)
            .iter_mut()
            .for_each(|frame| make_absolute(frame, &root));
    }
    if former == Some(root.as_path()) {
        return Vec::new();
    }
    let mut moved = BTreeMap::new();
    let mut warnings = Vec::new();
    for (folder, group) in groups(&project.frames) {
        let related = former.and_then(|former| Some(joined(&root, &relative(former, folder)?)));
        let found = match related.filter(|related| *related != folder && group.is_better_at(related)) {
            Some(related) => Some(related),
            None if group.is_there(folder) => None,
            None => near(folder, &root).find(|place| place != folder && group.fits(place)).inspect(|place| {
                warnings.push(format!(
                    "{}: is missing; {} files with the same names and sizes were found in {} and are used instead; if these \
                     are others, run 'ostra relocate'",
                    folder.display(),
                    group.files.len(),
                    place.display()
                ));
            }),
        };
        moved.extend(found.map(|place| (folder.to_owned(), place)));
    }
    if !moved.is_empty() {
        for path in Arc::make_mut(&mut project.frames)
            .iter_mut()
            .flat_map(sources_mut)
        {
            let place = path
                .parent()
                .and_then(|folder| moved.get(folder))
                .zip(path.file_name());
            if let Some(place) = place.map(|(folder, name)| folder.join(name)) {
                *path = place;
            }
        }
    }
    warnings
}

/// The sources in one folder.
///
/// For each file, this holds a frame that uses it and the file's index among the frame's sources.
struct FolderSources<'a> {
    folder: &'a Path,
    files: BTreeMap<PathBuf, (&'a Frame, usize)>,
}

fn groups(frames: &[Frame]) -> BTreeMap<&Path, FolderSources<'_>> {
    let mut groups: BTreeMap<&Path, FolderSources<'_>> = BTreeMap::new();
    for frame in frames {
        for (place, path) in sources(frame).enumerate() {
            let (Some(folder), Some(name)) = (path.parent(), path.file_name()) else {
                continue;
            };
            let group = groups.entry(folder).or_insert_with(|| FolderSources {
                folder,
                files: BTreeMap::new(),
            });
            group.files.insert(name.into(), (frame, place));
        }
    }
    groups
}

impl FolderSources<'_> {
    /// Returns whether any of the files exists in a folder.
    fn is_there(&self, folder: &Path) -> bool {
        self.files.keys().any(|name| folder.join(name).exists())
    }

    /// Returns whether most of the files exist in a folder and have the right sizes.
    ///
    /// At least half must exist. The sizes of at most [`SAMPLES`] of them, evenly spaced, are
    /// checked.
    fn fits(&self, folder: &Path) -> bool {
        let there: Vec<_> = self
            .files
            .iter()
            .filter(|(name, _)| folder.join(name).is_file())
            .collect();
        let mut samples = there.iter().step_by(there.len() / SAMPLES + 1);
        2 * there.len() >= self.files.len().max(1)
            && samples.all(|(name, (frame, place))| {
                check_source(frame, *place, &folder.join(name)).is_ok()
            })
    }

    /// Returns whether the files fit in a folder and are moved or copied there.
    ///
    /// Every file must be missing at its old path, or have the same length at both.
    fn is_better_at(&self, folder: &Path) -> bool {
        let length = |path: PathBuf| std::fs::metadata(path).ok().map(|found| found.len());
        let is_copy = |name: &PathBuf| {
            let before = length(self.folder.join(name));
            before.is_none() || before == length(folder.join(name))
        };
        self.fits(folder) && self.files.keys().all(is_copy)
    }
}

/// Returns folders near a project that may correspond to a moved folder, the most likely first.
///
/// The longer the common end of the paths, the more likely the folder.
fn near(folder: &Path, root: &Path) -> impl Iterator<Item = PathBuf> {
    let parts: Vec<_> = folder
        .components()
        .filter(|part| matches!(part, Component::Normal(_)))
        .collect();
    let above: Vec<PathBuf> = root
        .ancestors()
        .take(LEVELS)
        .filter(|above| above.parent().is_some())
        .map(Path::to_owned)
        .collect();
    let first = parts.len();
    let ends = (0..first).map(move |skipped| parts[skipped..].iter().collect::<PathBuf>());
    let adjacent: Vec<PathBuf> = above.iter().take(2).cloned().collect();
    ends.flat_map(move |end| above.clone().into_iter().map(move |above| above.join(&end)))
        .chain(adjacent)
}

/// Returns the relative path between two paths.
///
/// Returns `None` if they share only the root of the file system.
fn relative(from: &Path, to: &Path) -> Option<PathBuf> {
    let shared: Vec<Component<'_>> = from
        .components()
        .zip(to.components())
        .take_while(|(a, b)| a == b)
        .map(|(part, _)| part)
        .collect();
    shared
        .iter()
        .find(|part| matches!(part, Component::Normal(_)))?;
    let up = from
        .components()
        .skip(shared.len())
        .map(|_| Component::ParentDir);
    let way: PathBuf = up.chain(to.components().skip(shared.len())).collect();
    // A project can be moved between systems.
    Some(if cfg!(windows) {
        way.to_str()?.replace('\\', "/").into()
    } else {
        way
    })
}

/// Joins a path to a folder and resolves `..` by name, without following links.
pub fn joined(folder: &Path, path: &Path) -> PathBuf {
    let mut joined = folder.to_owned();
    for part in path.components() {
        match part {
            Component::ParentDir => drop(joined.pop()),
            Component::CurDir => {}
            part => joined.push(part),
        }
    }
    joined
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn relative_paths_lead_back_to_their_origin() {
        for (from, to, way) in [
            (
                "/data/set/project",
                "/data/set/images/0.png",
                Some("../images/0.png"),
            ),
            (
                "/data/set/project",
                "/data/other/deep/0.png",
                Some("../../other/deep/0.png"),
            ),
            ("/data/set", "/data/set/0.png", Some("0.png")),
            ("/data/set/project", "/home/me/0.png", None),
        ] {
            let found = relative(Path::new(from), Path::new(to));
            assert_eq!(found.as_deref(), way.map(Path::new), "{from} {to}");
            if let Some(found) = found {
                assert_eq!(joined(Path::new(from), &found), Path::new(to));
            }
        }
    }

    #[test]
    fn paths_that_look_like_urls_or_options_become_files() {
        for (path, file) in [
            ("http://evil/x.mp4", "/p/http:/evil/x.mp4"),
            ("-i", "/p/-i"),
            ("../../../../etc", "/etc"),
        ] {
            assert_eq!(joined(Path::new("/p"), Path::new(path)), Path::new(file));
        }
    }

    #[test]
    fn likelier_folders_come_first() {
        let found: Vec<PathBuf> =
            near(Path::new("/old/set/images"), Path::new("/new/set/project")).collect();
        let place = |path: &str| {
            found
                .iter()
                .position(|found| found == Path::new(path))
                .unwrap()
        };
        assert!(place("/new/set/images") < place("/new/images"));
        assert!(place("/new/set/images") < place("/new/set/project/images"));
        assert!(
            place("/new/images") < place("/new/set"),
            "files next to the project"
        );
    }
}
