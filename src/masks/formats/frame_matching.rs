//! Which file or entry belongs to which frame, and what imports and exports hand on.

use std::collections::BTreeMap;
use std::path::Path;

use super::files::{FoundFile, invalid};
use crate::{Label, LabelTree, MaskError, RunMask};
use ostra_frames::{Frame, file_of, without_ending};

/// What masks are matched to: a frame's name and its size in pixels as shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MaskFrame<'a> {
    /// Unique in the project, parts joined by `/`.
    pub name: &'a str,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// What was read; nothing of it is in the project yet.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Imported {
    /// By frame number.
    pub masks: BTreeMap<usize, RunMask>,
    /// Labels that the project lacks, each after its parent.
    pub new_labels: Vec<Label>,
    /// What was left out or decided, for the user.
    pub warnings: Vec<String>,
}

/// What an export writes: frames and labels with checked masks and a file name per frame.
pub(super) struct Export<'a> {
    pub frames: &'a [MaskFrame<'a>],
    /// Per frame, a path below the folder without ending.
    pub stems: Vec<String>,
    /// (frame number, mask), in the order given.
    pub masks: Vec<(usize, &'a RunMask)>,
    pub tree: &'a LabelTree,
}

impl<'a> From<&'a Frame> for MaskFrame<'a> {
    fn from(frame: &'a Frame) -> Self {
        Self {
            name: &frame.name,
            width: frame.width,
            height: frame.height,
        }
    }
}

/// Finds names by their path without ending, then by file name alone; a name that fits two is not found.
pub(crate) struct NameIndex {
    /// One map per way to match, the surest first; `None` = two have this name.
    levels: [BTreeMap<String, Option<usize>>; 3],
}

/// Which of several files belongs to which frame.
#[derive(Debug)]
pub(crate) struct Matched<'f> {
    /// (frame number, file), ordered by frame.
    pub pairs: Vec<(usize, &'f FoundFile)>,
    /// Files that belong to no frame.
    pub unmatched: Vec<&'f FoundFile>,
}

impl NameIndex {
    /// An index of names, each of which answers with its place.
    pub(crate) fn new<'n>(names: impl IntoIterator<Item = &'n str>) -> Self {
        let mut levels = [const { BTreeMap::new() }; 3];
        for (at, name) in names.into_iter().enumerate() {
            let keys = [name, without_ending(name), file_of(without_ending(name))];
            for (level, key) in levels.iter_mut().zip(keys) {
                level
                    .entry(key.to_owned())
                    .and_modify(|place| *place = None)
                    .or_insert(Some(at));
            }
        }
        Self { levels }
    }

    /// The place of the name that a stem (a path without ending) fits, and how sure that is (0 = surest).
    fn find(&self, stem: &str) -> Option<(usize, usize)> {
        let keys = [stem, stem, file_of(stem)];
        let hits = self
            .levels
            .iter()
            .zip(keys)
            .map(|(level, key)| level.get(key).copied().flatten());
        hits.enumerate()
            .find_map(|(sureness, hit)| Some((hit?, sureness)))
    }

    /// What a file's full name is matched by: itself where a name is exactly that, else without its ending.
    pub(super) fn stem_of<'n>(&self, file_name: &'n str) -> &'n str {
        let exact = self.levels[0].contains_key(file_name);
        if exact {
            file_name
        } else {
            without_ending(file_name)
        }
    }

    /// Gives every file to its frame; where several fit one frame, the surest gets it.
    ///
    /// # Errors
    /// [`MaskError::Invalid`] when two files fit the same frame equally well.
    pub fn match_files<'f>(
        &self,
        dir: &Path,
        files: &'f [FoundFile],
    ) -> Result<Matched<'f>, MaskError> {
        let mut best: BTreeMap<usize, (usize, &FoundFile)> = BTreeMap::new();
        let mut unmatched = Vec::new();
        for file in files {
            let Some((frame, sureness)) = self.find(&file.stem) else {
                unmatched.push(file);
                continue;
            };
            match best.insert(frame, (sureness, file)) {
                Some((other, rival)) if other == sureness => {
                    let what = format!(
                        "'{}' and '{}' both fit the same frame; keep one of them, or put the path of its frame before its name",
                        rival.stem, file.stem
                    );
                    return Err(invalid(dir, what));
                }
                Some((other, rival)) if other < sureness => {
                    best.insert(frame, (other, rival));
                    unmatched.push(file);
                }
                Some((_, rival)) => unmatched.push(rival),
                None => {}
            }
        }
        Ok(Matched {
            pairs: best
                .into_iter()
                .map(|(frame, (_, file))| (frame, file))
                .collect(),
            unmatched,
        })
    }
}

/// One file name per frame without the file's ending: the frame's name without its own, or with it where two frames
/// would share a file (`a.jpg` and `a.png`).
///
/// # Errors
/// [`MaskError::Request`] for a name that leads out of the folder.
pub fn file_stems(frames: &[MaskFrame<'_>]) -> Result<Vec<String>, MaskError> {
    let mut uses: BTreeMap<String, usize> = BTreeMap::new();
    for frame in frames {
        // Some file systems do not tell upper from lower case.
        *uses
            .entry(without_ending(frame.name).to_lowercase())
            .or_default() += 1;
    }
    let stem = |frame: &MaskFrame<'_>| {
        let short = without_ending(frame.name);
        let stem = if uses.get(&short.to_lowercase()) == Some(&1) {
            short
        } else {
            frame.name
        };
        let inside = stem
            .split(['/', '\\'])
            .all(|part| !part.is_empty() && part != "." && part != "..");
        let fault = || {
            MaskError::Request(format!(
                "the frame name '{stem}' is no file name; rename its source"
            ))
        };
        inside.then(|| stem.to_owned()).ok_or_else(fault)
    };
    frames.iter().map(stem).collect()
}

/// The warning about files (or entries) that belong to no frame.
pub(super) fn unmatched_warning(names: &[&str]) -> Option<String> {
    let first = names.first()?;
    Some(format!(
        "{} of the masks match no frame's name and were left out (first: {first})",
        names.len()
    ))
}

/// The error when nothing fits any frame.
pub(super) fn nothing_fits(dir: &Path, first: &str, frames: &[MaskFrame<'_>]) -> MaskError {
    let frame = frames.first().map_or("none", |frame| frame.name);
    invalid(
        dir,
        format!(
            "no mask has a frame's name (first mask '{first}', first frame '{frame}'); name the files as the frames"
        ),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(stem: &str) -> FoundFile {
        FoundFile {
            path: format!("{stem}.png").into(),
            stem: stem.into(),
        }
    }

    fn matched(names: &[&str], stems: &[&str]) -> Result<Vec<(usize, String)>, MaskError> {
        let files: Vec<FoundFile> = stems.iter().map(|stem| file(stem)).collect();
        let index = NameIndex::new(names.iter().copied());
        let matched = index.match_files(Path::new("dir"), &files)?;
        Ok(matched
            .pairs
            .into_iter()
            .map(|(frame, file)| (frame, file.stem.clone()))
            .collect())
    }

    #[test]
    fn by_path_then_by_file_name() {
        let names = ["a/0.jpg", "a/1.jpg", "b/1.jpg", "film.mp4/000007"];
        let found = matched(&names, &["a/1", "x/0", "000007", "1", "9"]).unwrap();
        assert_eq!(
            found,
            [(0, "x/0".into()), (1, "a/1".into()), (3, "000007".into())],
            "'1' alone fits two frames"
        );
    }

    #[test]
    fn the_surer_of_two_files_wins_and_equals_are_an_error() {
        assert_eq!(
            matched(&["a/0.jpg"], &["a/0", "z/0"]).unwrap(),
            [(0, "a/0".into())]
        );
        assert_eq!(
            matched(&["a/0.jpg"], &["0", "a/0"]).unwrap(),
            [(0, "a/0".into())]
        );
        let error = matched(&["0.jpg"], &["a/0", "z/0"])
            .unwrap_err()
            .to_string();
        assert!(error.contains("a/0") && error.contains("z/0"), "{error}");
    }

    #[test]
    fn frames_that_share_a_stem_keep_their_endings() {
        let frames = ["a.jpg", "A.png", "b.c.jpg", "cam/b.jpg"];
        let frames: Vec<MaskFrame<'_>> = frames
            .iter()
            .map(|name| MaskFrame {
                name,
                width: 1,
                height: 1,
            })
            .collect();
        let stems = file_stems(&frames).unwrap();
        assert_eq!(stems, ["a.jpg", "A.png", "b.c", "cam/b"]);
        let index = NameIndex::new(frames.iter().map(|frame| frame.name));
        for (at, stem) in stems.iter().enumerate() {
            assert_eq!(index.find(stem).map(|hit| hit.0), Some(at));
        }
        for name in ["../x.png", "/etc/x.png", "a//b.png"] {
            assert!(
                file_stems(&[MaskFrame {
                    name,
                    width: 1,
                    height: 1
                }])
                .is_err(),
                "{name}"
            );
        }
    }
}
