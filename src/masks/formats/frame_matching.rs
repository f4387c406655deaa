//! Matching of files or entries to frames, and the data that imports and exports exchange.

use std::collections::BTreeMap;
use std::path::Path;

use super::files::{FoundFile, invalid};
use crate::{Label, LabelTree, MaskError, RunMask};
use ostra_frames::{Frame, file_of, without_ending};

/// Name and displayed size of a frame that masks are matched to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MaskFrame<'a> {
    /// Name, unique in the project, with parts joined by `/`.
    pub name: &'a str,
    /// Number of columns.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
}

/// Result of an import, not yet part of the project.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Imported {
    /// Masks by frame number.
    pub masks: BTreeMap<usize, RunMask>,
    /// Labels missing from the project, each after its parent.
    pub new_labels: Vec<Label>,
    /// Skipped data and decisions, for the user.
    pub warnings: Vec<String>,
}

/// Input of an export: frames, labels, checked masks and a file name per frame.
pub(super) struct Export<'a> {
    pub frames: &'a [MaskFrame<'a>],
    /// Path of each frame below the folder, without extension.
    pub stems: Vec<String>,
    /// Pairs of frame number and mask, in the order given.
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

/// Index of names by path without extension, then by file name alone.
///
/// A name that fits two entries is not found.
pub(crate) struct NameIndex {
    /// One map per kind of match, the most reliable first; `None` when two entries share a name.
    levels: [BTreeMap<String, Option<usize>>; 3],
}

/// Assignment of files to frames.
#[derive(Debug)]
pub(crate) struct MatchedFiles<'f> {
    /// Pairs of frame number and file, ordered by frame.
    pub pairs: Vec<(usize, &'f FoundFile)>,
    /// Files that match no frame.
    pub unmatched: Vec<&'f FoundFile>,
}

impl NameIndex {
    /// Creates an index of names; each is found as its position in the sequence.
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

    /// Returns the position of the name that matches a stem, and the level of the match.
    ///
    /// A stem is a path without extension. Level 0 is the most reliable.
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

    /// Returns the key by which a file name is matched.
    ///
    /// It is the name itself if an entry has exactly that name, else the name without its
    /// extension.
    pub(super) fn stem_of<'n>(&self, file_name: &'n str) -> &'n str {
        let exact = self.levels[0].contains_key(file_name);
        if exact {
            file_name
        } else {
            without_ending(file_name)
        }
    }

    /// Assigns every file to its frame.
    ///
    /// When several files fit a frame, it gets the one with the most reliable match.
    ///
    /// # Errors
    /// [`MaskError::Invalid`] when two files fit the same frame equally well.
    pub fn match_files<'f>(
        &self,
        dir: &Path,
        files: &'f [FoundFile],
    ) -> Result<MatchedFiles<'f>, MaskError> {
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
        Ok(MatchedFiles {
            pairs: best
                .into_iter()
                .map(|(frame, (_, file))| (frame, file))
                .collect(),
            unmatched,
        })
    }
}

/// Returns one file name per frame, without the extension of the mask file.
///
/// It is the frame's name without extension. When two frames would share a file (`a.jpg` and
/// `a.png`), the extension stays.
///
/// # Errors
/// [`MaskError::Request`] for a name that leads out of the folder.
pub fn file_stems(frames: &[MaskFrame<'_>]) -> Result<Vec<String>, MaskError> {
    let mut uses: BTreeMap<String, usize> = BTreeMap::new();
    for frame in frames {
        // Some file systems are case-insensitive.
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
                "the frame name '{stem}' cannot be a file name; rename its source"
            ))
        };
        inside.then(|| stem.to_owned()).ok_or_else(fault)
    };
    frames.iter().map(stem).collect()
}

/// Returns the warning about files or entries that match no frame.
pub(super) fn unmatched_warning(names: &[&str]) -> Option<String> {
    let first = names.first()?;
    Some(format!(
        "{} of the masks match no frame's name and were left out (first: {first})",
        names.len()
    ))
}

/// Returns the error for an import in which nothing matches a frame.
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
    fn files_match_by_path_then_by_file_name() {
        let names = ["a/0.jpg", "a/1.jpg", "b/1.jpg", "film.mp4/000007"];
        let found = matched(&names, &["a/1", "x/0", "000007", "1", "9"]).unwrap();
        assert_eq!(
            found,
            [(0, "x/0".into()), (1, "a/1".into()), (3, "000007".into())],
            "'1' alone fits two frames"
        );
    }

    #[test]
    fn better_match_wins_and_equal_matches_are_an_error() {
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
    fn frames_that_share_a_stem_keep_their_extensions() {
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
