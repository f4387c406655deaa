use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

use glam::DVec2;

use super::adopt::{Adoption, Newcomer};
use super::exchange::{Export, Imported, MaskFrame, nothing_fits, unmatched_warning};
use super::files::{FoundFile, in_parallel, invalid, io_error, list_files, write_whole};
use super::frame_names::NameIndex;
use super::labels_json::{read_labels_json, write_labels_json};
use super::layers::{contested_warning, stacked};
use super::yolo_names::{read_names, yaml};
use crate::engine::job::Progress;
use crate::masks::edit::polygon_spans;
use crate::masks::{LabelId, LabelTree, MaskError, RunMask, outlines};

/// Coordinates are shares of the picture; farther out than this they must be something else (pixels).
const MAX_SHARE: f64 = 1.5;

/// One line of a file: an outline in shares of width and height.
struct Line {
    class: usize,
    ring: Vec<DVec2>,
}

/// Reads `labels/FRAME.txt` (or `FRAME.txt`), one outline a line: class, then x and y of its corners as shares of width
/// and height, filled by the even-odd rule. A class is a label by its name; without names class k is label k + 1. An
/// empty file is a frame without any label.
pub(super) fn import(
    dir: &Path,
    frames: &[MaskFrame<'_>],
    tree: &LabelTree,
    progress: &Progress,
) -> Result<Imported, MaskError> {
    let below = dir.join("labels");
    let files = list_files(if below.is_dir() { &below } else { dir }, &["txt"])?;
    let first = files.first().ok_or_else(|| invalid(dir, "holds no .txt file; give the folder above `labels`"))?;
    let matched = NameIndex::new(frames.iter().map(|frame| frame.name)).match_files(dir, &files)?;
    if matched.pairs.is_empty() {
        return Err(nothing_fits(dir, &first.stem, frames));
    }
    let lines = in_parallel(&matched.pairs, progress, |&(_, file)| read_lines(&file.path))?;
    let classes = lines.iter().flat_map(|(lines, _)| lines.iter().map(|line| line.class));
    let (labels, adoption) = adopted(dir, classes.collect(), tree)?;
    let jobs: Vec<(usize, &Vec<Line>)> =
        matched.pairs.iter().map(|pair| pair.0).zip(lines.iter().map(|(lines, _)| lines)).collect();
    let read =
        in_parallel(&jobs, progress, |(frame, lines)| frame_mask(&frames[*frame], lines, &labels, adoption.tree()))?;
    let contested = read.iter().map(|(_, contested)| contested).sum();
    let boxes: usize = lines.iter().map(|(_, boxes)| boxes).sum();
    let boxes = (boxes > 0).then(|| format!("{boxes} lines hold boxes, no outlines, and were left out"));
    let unmatched: Vec<&str> = matched.unmatched.iter().map(|file: &&FoundFile| file.stem.as_str()).collect();
    Ok(Imported {
        masks: jobs.iter().map(|job| job.0).zip(read.into_iter().map(|(mask, _)| mask)).collect(),
        new_labels: adoption.into_added(),
        warnings: unmatched_warning(&unmatched).into_iter().chain(contested_warning(contested)).chain(boxes).collect(),
    })
}

/// Writes `labels/FRAME.txt`, `data.yaml` and `labels.json`. Classes are the labels in the order of their ids. Outlines
/// follow the pixels' corners, so that reading them gives the same pixels; a hole is joined to the outline around it by
/// a seam of no width.
pub(super) fn export(dir: &Path, export: &Export<'_>, progress: &Progress) -> Result<(), MaskError> {
    let mut adoption = Adoption::new(export.tree, LabelId::NONE);
    for id in super::davis::ids_in(export.masks.iter().map(|(_, mask)| *mask)) {
        adoption.number(id)?;
    }
    let tree = adoption.tree();
    let classes: BTreeMap<LabelId, usize> = tree.iter().map(|label| label.id).zip(0..).collect();
    let names: Vec<String> = tree.iter().map(|label| label.name.clone()).collect();
    write_labels_json(dir, tree)?;
    write_whole(&dir.join("data.yaml"), yaml(&names).as_bytes())?;
    in_parallel(&export.masks, progress, |&(frame, mask)| {
        let path = dir.join("labels").join(format!("{}.txt", export.stems[frame]));
        write_whole(&path, lines(mask, &classes).as_bytes())
    })?;
    Ok(())
}

/// The label of every class that is used, by its number.
fn adopted(
    dir: &Path,
    mut classes: Vec<usize>,
    tree: &LabelTree,
) -> Result<(BTreeMap<usize, LabelId>, Adoption), MaskError> {
    classes.sort_unstable();
    classes.dedup();
    let names = read_names(dir)?;
    let highest = classes.last().map_or(0, |&class| class as u64 + 1);
    let mut adoption = Adoption::new(tree, LabelId(u16::try_from(highest).unwrap_or(u16::MAX)));
    if let Some(listed) = read_labels_json(dir)? {
        adoption.tree_of(&listed)?;
    }
    let mut labels = BTreeMap::new();
    for class in classes {
        let name = names.get(class).filter(|name| !name.is_empty());
        let number = u16::try_from(class + 1).map(LabelId);
        let label = match (name, number) {
            (Some(name), _) => adoption.named(&Newcomer { name, id: number.ok(), parent: None, color: None })?,
            (None, Ok(number)) => adoption.number(number)?,
            (None, Err(_)) => {
                return Err(invalid(dir, format!("class {class} is too high; give it a name in data.yaml")));
            }
        };
        labels.insert(class, label);
    }
    Ok((labels, adoption))
}

/// The outlines of a file, and how many lines hold only a box.
fn read_lines(path: &Path) -> Result<(Vec<Line>, usize), MaskError> {
    let text = std::fs::read_to_string(path).map_err(io_error(path))?;
    let mut lines = Vec::new();
    let mut boxes = 0;
    for (number, text) in (1..).zip(text.lines()).filter(|(_, text)| !text.trim().is_empty()) {
        let fault = |what: &str| invalid(path, format!("line {number}: {what}"));
        let mut words = text.split_whitespace();
        let class = words.next().and_then(|word| word.parse().ok()).filter(|&class: &usize| class < usize::MAX);
        let class = class.ok_or_else(|| fault("does not begin with the number of a class"))?;
        let numbers: Vec<f64> = words
            .map(|word| word.parse().ok().filter(|share: &f64| share.is_finite() && share.abs() <= MAX_SHARE))
            .collect::<Option<_>>()
            .ok_or_else(|| fault("coordinates must be numbers from 0 to 1, as shares of width and height"))?;
        match numbers.len() {
            4 => boxes += 1,
            count if count < 6 || count % 2 == 1 => {
                return Err(fault("an outline needs x and y of three corners or more"));
            }
            _ => {
                let ring = numbers.chunks_exact(2).map(|corner| DVec2::new(corner[0], corner[1])).collect();
                lines.push(Line { class, ring });
            }
        }
    }
    Ok((lines, boxes))
}

fn frame_mask(
    frame: &MaskFrame<'_>,
    lines: &[Line],
    labels: &BTreeMap<usize, LabelId>,
    tree: &LabelTree,
) -> Result<(RunMask, usize), MaskError> {
    let size = DVec2::new(f64::from(frame.width), f64::from(frame.height));
    let layers = lines.iter().map(|line| (labels.get(&line.class).copied().unwrap_or_default(), line)).collect();
    let (mask, contested) = stacked((frame.width, frame.height), layers, tree, |line: &&Line, emit| {
        let ring = line.ring.iter().map(|&corner| corner * size).collect();
        polygon_spans(frame.width, frame.height, &[ring], emit)
    })?;
    Ok((RunMask::encode(&mask), contested))
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
