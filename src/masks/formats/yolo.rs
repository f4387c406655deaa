use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::Path;

use glam::DVec2;

use super::files::{
    FoundFile, Skipped, in_parallel, invalid, list_files, read_text, unless_stopped, write_whole,
};
use super::frame_matching::{
    Export, Imported, MaskFrame, NameIndex, nothing_fits, unmatched_warning,
};
use super::label_import::{LabelImport, Newcomer};
use super::labels_json::{listed_labels, write_labels_json};
use super::layers::{Stacked, contested_warning, stacked};
use super::yolo_names::{ClassNames, find_names, is_names_file, yaml};
use crate::edit::polygon_spans;
use crate::{LabelId, LabelTree, MaskError, RunMask, outlines};
use ostra_core::job::Progress;

/// Maximum absolute coordinate, as a share of the image size.
///
/// Larger values must have another unit, such as pixels.
const MAX_SHARE: f64 = 1.5;

/// A line of a file: an outline in shares of width and height.
struct YoloLine {
    class: usize,
    ring: Vec<DVec2>,
}

/// Contents of a label file.
#[derive(Default)]
struct FileLines {
    lines: Vec<YoloLine>,
    /// Number of lines that hold only a box.
    boxes: usize,
    skipped: Skipped,
}

/// Reads `labels/FRAME.txt` (or `FRAME.txt`), with one outline per line.
///
/// A line holds the class, then x and y of the corners as shares of width and height. Outlines are
/// filled by the even-odd rule. A class is matched to a label by its name; without names, class k
/// is label k + 1. An empty file is a frame without labels. Unusable outlines are skipped and
/// counted in the warnings.
pub(super) fn import(
    dir: &Path,
    frames: &[MaskFrame<'_>],
    tree: &LabelTree,
    progress: &Progress,
) -> Result<Imported, MaskError> {
    let below = dir.join("labels");
    let mut files = list_files(if below.is_dir() { &below } else { dir }, &["txt"])?;
    files.retain(|file| !is_names_file(&file.path));
    let first = files
        .first()
        .ok_or_else(|| invalid(dir, "holds no .txt file; give the folder above `labels`"))?;
    let matched = NameIndex::new(frames.iter().map(|frame| frame.name)).match_files(dir, &files)?;
    if matched.pairs.is_empty() {
        return Err(nothing_fits(dir, &first.stem, frames));
    }
    let YoloFiles {
        files: files_lines,
        mut skipped,
    } = read_files(&matched.pairs, progress)?;
    let folders = matched
        .pairs
        .iter()
        .filter_map(|(_, file)| file.path.parent())
        .collect();
    let classes = files_lines
        .iter()
        .flat_map(|(_, file)| file.lines.iter().map(|line| line.class))
        .collect();
    let Classes {
        labels,
        label_import,
        mut warnings,
    } = imported(dir, &folders, classes, tree)?;
    let jobs: Vec<(usize, &Vec<YoloLine>)> = files_lines
        .iter()
        .map(|(frame, file)| (*frame, &file.lines))
        .collect();
    let read = in_parallel(&jobs, progress, |(frame, lines)| {
        frame_mask(&frames[*frame], lines, &labels, label_import.tree())
    })?;
    let contested = read.iter().map(|one| one.contested).sum();
    let mut masks: BTreeMap<usize, RunMask> = jobs
        .iter()
        .map(|job| job.0)
        .zip(read.into_iter().map(|one| one.mask))
        .collect();
    let mut boxes = 0;
    for (frame, file) in files_lines {
        // A file with only boxes or unusable outlines does not mean a frame without labels.
        if file.lines.is_empty() && (file.boxes > 0 || !file.skipped.is_empty()) {
            masks.remove(&frame);
        }
        boxes += file.boxes;
        skipped.join(file.skipped);
    }
    let boxes =
        (boxes > 0).then(|| format!("{boxes} lines hold boxes, no outlines, and were left out"));
    if masks.is_empty() {
        let faults: Vec<String> = boxes.into_iter().chain(skipped.warnings()).collect();
        return Err(invalid(
            dir,
            format!("no outline can be used: {}", faults.join("; ")),
        ));
    }
    let unmatched: Vec<&str> = matched
        .unmatched
        .iter()
        .map(|file: &&FoundFile| file.stem.as_str())
        .collect();
    warnings.extend(
        unmatched_warning(&unmatched)
            .into_iter()
            .chain(contested_warning(contested))
            .chain(boxes),
    );
    warnings.extend(skipped.warnings());
    Ok(Imported {
        masks,
        new_labels: label_import.into_added(),
        warnings,
    })
}

/// Writes `labels/FRAME.txt`, `data.yaml` and `labels.json`.
///
/// Classes are the labels in the order of their ids. Outlines follow pixel corners, so that reading
/// them gives the same pixels. A hole is joined to its outer outline by a seam of zero width.
pub(super) fn export(
    dir: &Path,
    export: &Export<'_>,
    progress: &Progress,
) -> Result<(), MaskError> {
    let mut label_import = LabelImport::new(export.tree, LabelId::NONE);
    for id in super::grey_kinds::ids_in(export.masks.iter().map(|(_, mask)| *mask)) {
        label_import.number(id)?;
    }
    let tree = label_import.tree();
    let classes: BTreeMap<LabelId, usize> = tree.iter().map(|label| label.id).zip(0..).collect();
    let names: Vec<String> = tree.iter().map(|label| label.name.clone()).collect();
    write_labels_json(dir, tree)?;
    write_whole(&dir.join("data.yaml"), yaml(&names).as_bytes())?;
    in_parallel(&export.masks, progress, |&(frame, mask)| {
        let path = dir
            .join("labels")
            .join(format!("{}.txt", export.stems[frame]));
        write_whole(&path, lines(mask, &classes).as_bytes())
    })?;
    Ok(())
}

/// Labels of the classes.
struct Classes {
    /// Label by class number.
    labels: BTreeMap<usize, LabelId>,
    label_import: LabelImport,
    warnings: Vec<String>,
}

/// Finds or adds the label of every used class.
fn imported(
    dir: &Path,
    folders: &BTreeSet<&Path>,
    classes: BTreeSet<usize>,
    tree: &LabelTree,
) -> Result<Classes, MaskError> {
    let ClassNames {
        names,
        place,
        mut warnings,
    } = find_names(dir, folders)?;
    let highest = classes.last().map_or(0, |&class| class as u64 + 1);
    let mut label_import =
        LabelImport::new(tree, LabelId(u16::try_from(highest).unwrap_or(u16::MAX)));
    let listed = listed_labels(dir)?;
    warnings.extend(listed.warning);
    if let Some(listed) = &listed.tree {
        label_import.tree_of(listed)?;
    }
    let mut labels = BTreeMap::new();
    let mut unnamed = Vec::new();
    for class in classes {
        let name = names.get(class).filter(|name| !name.is_empty());
        let number = u16::try_from(class + 1).map(LabelId);
        let label = match (name, number) {
            (Some(name), _) => label_import.named(&Newcomer {
                name,
                id: number.ok(),
                parent: None,
                color: None,
            })?,
            (None, Ok(number)) => {
                unnamed.push(class);
                label_import.number(number)?
            }
            (None, Err(_)) => {
                return Err(invalid(
                    dir,
                    format!("class {class} is too high; give it a name in data.yaml"),
                ));
            }
        };
        labels.insert(class, label);
    }
    let as_label = |class: &usize| {
        let name = labels
            .get(class)
            .map(|&id| label_import.tree().name_path(id))
            .unwrap_or_default();
        format!("{class} as '{name}'")
    };
    if let Some(first) = unnamed.first().filter(|_| listed.tree.is_none()) {
        warnings.push(match place {
            None => format!(
                "no class names were found (data.yaml, classes.txt or obj.names); classes became labels by their numbers, \
                 class {}",
                as_label(first)
            ),
            Some(place) => format!(
                "{} classes have no name in {}; they became labels by their numbers, class {}",
                unnamed.len(),
                place.display(),
                as_label(first)
            ),
        });
    }
    Ok(Classes {
        labels,
        label_import,
        warnings,
    })
}

/// Lines of the files as read.
struct YoloFiles {
    /// Lines by frame, without files that cannot be used.
    files: Vec<(usize, FileLines)>,
    skipped: Skipped,
}

/// Reads the files that can be read.
///
/// # Errors
/// The first file's error when no file can be used.
fn read_files(pairs: &[(usize, &FoundFile)], progress: &Progress) -> Result<YoloFiles, MaskError> {
    let results = in_parallel(pairs, progress, |&(_, file)| {
        unless_stopped(read_lines(file))
    })?;
    let (mut files, mut skipped, mut first_error) = (Vec::new(), Skipped::default(), None);
    for (&(frame, _), result) in pairs.iter().zip(results) {
        match result {
            Ok(lines) => files.push((frame, lines)),
            Err(error) => {
                skipped.add_unreadable(&error);
                first_error.get_or_insert(error);
            }
        }
    }
    match first_error.filter(|_| files.is_empty()) {
        Some(error) => Err(error),
        None => Ok(YoloFiles { files, skipped }),
    }
}

/// Reads the outlines of a file.
fn read_lines(file: &FoundFile) -> Result<FileLines, MaskError> {
    let text = read_text(&file.path)?;
    let mut read = FileLines::default();
    for (number, text) in (1..)
        .zip(text.lines())
        .filter(|(_, text)| !text.trim().is_empty())
    {
        let mut skip = |what| {
            read.skipped
                .add(what, format!("'{}', line {number}", file.stem));
        };
        let mut words = text.split_whitespace();
        let Some(class) = words.next().and_then(class_number) else {
            skip("lines do not begin with the number of a class and were left out");
            continue;
        };
        let numbers: Option<Vec<f64>> = words
            .map(|word| {
                word.parse()
                    .ok()
                    .filter(|share: &f64| !share.is_finite() || share.abs() <= MAX_SHARE)
            })
            .collect();
        let Some(mut numbers) = numbers else {
            skip(
                "lines whose coordinates are not numbers from 0 to 1, as shares of width and height, were left out",
            );
            continue;
        };
        if numbers.iter().any(|share| !share.is_finite()) {
            skip("outlines with a coordinate that is not a number were left out");
            continue;
        }
        match numbers.len() {
            // Predicted boxes end with their confidence.
            4 | 5 => read.boxes += 1,
            count if count < 6 => skip("outlines of fewer than three corners were left out"),
            count => {
                if count % 2 == 1 {
                    skip(
                        "outlines have one number after their corners, which was taken as a confidence",
                    );
                    numbers.pop();
                }
                let ring = numbers
                    .chunks_exact(2)
                    .map(|corner| DVec2::new(corner[0], corner[1]))
                    .collect();
                read.lines.push(YoloLine { class, ring });
            }
        }
    }
    Ok(read)
}

/// Parses a class number; some programs write `1.0` instead of `1`.
fn class_number(word: &str) -> Option<usize> {
    let whole = word
        .split_once('.')
        .filter(|(_, rest)| rest.bytes().all(|digit| digit == b'0'))
        .map(|(whole, _)| whole);
    whole
        .unwrap_or(word)
        .parse()
        .ok()
        .filter(|&class: &usize| class < usize::MAX)
}

fn frame_mask(
    frame: &MaskFrame<'_>,
    lines: &[YoloLine],
    labels: &BTreeMap<usize, LabelId>,
    tree: &LabelTree,
) -> Result<Stacked, MaskError> {
    let size = DVec2::new(f64::from(frame.width), f64::from(frame.height));
    let layers = lines
        .iter()
        .map(|line| (labels.get(&line.class).copied().unwrap_or_default(), line))
        .collect();
    stacked(frame, layers, tree, |line: &&YoloLine, emit| {
        let ring = line.ring.iter().map(|&corner| corner * size).collect();
        polygon_spans(frame.width, frame.height, &[ring], emit)
    })
}

fn lines(mask: &RunMask, classes: &BTreeMap<LabelId, usize>) -> String {
    let size = DVec2::new(f64::from(mask.width), f64::from(mask.height));
    let mut text = String::new();
    for id in mask.extents().keys() {
        let class = classes.get(id).copied().unwrap_or_default();
        for outline in outlines(&mask.region(*id)) {
            // Writing to a String cannot fail.
            let _ = write!(text, "{class}");
            for corner in outline.keyhole() {
                let share = corner / size;
                let _ = write!(text, " {:.6} {:.6}", share.x, share.y);
            }
            text.push('\n');
        }
    }
    text
}
