//! Where the sources of frames lie: relative to the project in `project.toml`, absolute in memory, and found again after
//! the project was moved together with them.

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use crate::Project;
use ostra_frames::{Frame, check_source, sources, sources_mut};

/// The folders above a moved project in which its sources are looked for, itself included.
const LEVELS: usize = 5;

/// How many files of a folder are looked into before it is taken for the one that was meant.
const SAMPLES: usize = 16;

/// Makes the paths of a frame's sources relative to the project's folder where they share a folder with it.
pub fn make_relative(frame: &mut Frame, folder: &Path) {
    // What `..` means in a path depends on the links in front of it; such a path stays as it is.
    let is_plain = |path: &Path| !path.components().any(|part| part == Component::ParentDir);
    for path in sources_mut(frame).filter(|path| is_plain(path)) {
        if let Some(relative) = relative(folder, path) {
            *path = relative;
        }
    }
}

/// Makes relative paths of a frame's sources absolute. What looks like a URL or an option becomes a plain file below the
/// folder by that, too.
pub fn make_absolute(frame: &mut Frame, folder: &Path) {
    for path in sources_mut(frame).filter(|path| !path.is_absolute()) {
        *path = joined(folder, path);
    }
}

/// Points sources to their place relative to the project where it was moved, from `former`, together with them. Where it is
/// not known from where, they are looked for near the project. Every file that is taken has the size in pixels that the
/// frame has. Returns what the user should check.
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

/// The sources of one folder: of each file a frame that is read from it, and whether it is that frame's depth.
struct Group<'a> {
    folder: &'a Path,
    files: BTreeMap<PathBuf, (&'a Frame, usize)>,
}

fn groups(frames: &[Frame]) -> BTreeMap<&Path, Group<'_>> {
    let mut groups: BTreeMap<&Path, Group<'_>> = BTreeMap::new();
    for frame in frames {
        for (place, path) in sources(frame).enumerate() {
            let (Some(folder), Some(name)) = (path.parent(), path.file_name()) else {
                continue;
            };
            let group = groups.entry(folder).or_insert_with(|| Group {
                folder,
                files: BTreeMap::new(),
            });
            group.files.insert(name.into(), (frame, place));
        }
    }
    groups
}

impl Group<'_> {
    /// Whether any of the files is in a folder.
    fn is_there(&self, folder: &Path) -> bool {
        self.files.keys().any(|name| folder.join(name).exists())
    }

    /// Whether most of the files are in another folder too and have the right sizes.
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

    /// Whether the files are in a folder, and no longer where they were, or a copy of them.
    fn is_better_at(&self, folder: &Path) -> bool {
        let length = |path: PathBuf| std::fs::metadata(path).ok().map(|found| found.len());
        let is_copy = |name: &PathBuf| {
            let before = length(self.folder.join(name));
            before.is_none() || before == length(folder.join(name))
        };
        self.fits(folder) && self.files.keys().all(is_copy)
    }
}

/// Folders near a project that may be the one that another folder has become, the likeliest first: the longer the end of
/// their paths that agrees, the likelier.
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
    let beside: Vec<PathBuf> = above.iter().take(2).cloned().collect();
    ends.flat_map(move |end| above.clone().into_iter().map(move |above| above.join(&end)))
        .chain(beside)
}

/// The way from a folder to a path; `None` where they share no folder but the root of the disk.
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

/// A path as it is seen from a folder. `..` is taken by the names, not by where links on the way lead.
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
    fn relative_paths_lead_back_to_where_they_came_from() {
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
    fn what_looks_like_an_address_or_option_becomes_a_file() {
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
