use std::collections::BTreeMap;
use std::path::Path;

use super::adopt::{Adoption, Newcomer};
use super::exchange::{Export, Imported, MaskFrame, nothing_fits, unmatched_warning};
use super::files::{FoundFile, in_parallel, invalid, list_files, write_whole};
use super::frame_names::NameIndex;
use super::labels_json::{listed_labels, write_labels_json};
use super::layers::{contested_warning, stacked};
use super::png_values::{PngValues, Stored, encode_png};
use crate::engine::job::Progress;
use crate::masks::{LabelId, LabelTree, MaskError, RunMask};

/// Reads `LABEL/FRAME.png`. A folder is a label by its name, else by its number; a pixel is inside where its value is
/// more than half of the highest in the file.
pub(super) fn import(
    dir: &Path,
    frames: &[MaskFrame<'_>],
    tree: &LabelTree,
    progress: &Progress,
) -> Result<Imported, MaskError> {
    let folders = label_folders(dir)?;
    let index = NameIndex::new(frames.iter().map(|frame| frame.name));
    let mut adoption = Adoption::new(tree, highest_number(folders.keys()));
    let listed = listed_labels(dir)?;
    let names = adopted_folders(&mut adoption, listed.tree.as_ref())?;
    let mut unmatched = Vec::new();
    let mut by_frame: BTreeMap<usize, Vec<(LabelId, &FoundFile)>> = BTreeMap::new();
    for (folder, files) in &folders {
        let label = folder_label(folder, &names, &mut adoption)?;
        let matched = index.match_files(&dir.join(folder), files)?;
        unmatched.extend(matched.unmatched.iter().map(|file| file.stem.as_str()));
        for (frame, file) in matched.pairs {
            by_frame.entry(frame).or_default().push((label, file));
        }
    }
    if by_frame.is_empty() {
        return Err(nothing_fits(dir, unmatched.first().copied().unwrap_or_default(), frames));
    }
    let jobs: Vec<(usize, Vec<(LabelId, &FoundFile)>)> = by_frame.into_iter().collect();
    let read = in_parallel(&jobs, progress, |(frame, files)| frame_mask(&frames[*frame], files, adoption.tree()))?;
    let contested = read.iter().map(|(_, contested)| contested).sum();
    let masks = jobs.iter().map(|job| job.0).zip(read.into_iter().map(|(mask, _)| mask)).collect();
    let decided = unmatched_warning(&unmatched).into_iter().chain(contested_warning(contested));
    let warnings = listed.warning.into_iter().chain(decided).collect();
    Ok(Imported { masks, new_labels: adoption.into_added(), warnings })
}

/// Writes one folder per label that any frame has, with a picture of every frame in each.
pub(super) fn export(dir: &Path, export: &Export<'_>, progress: &Progress) -> Result<(), MaskError> {
    write_labels_json(dir, export.tree)?;
    let mut ids = super::davis::ids_in(export.masks.iter().map(|(_, mask)| *mask));
    ids.remove(&LabelId::NONE);
    let folders = folder_names(export.tree);
    in_parallel(&export.masks, progress, |&(frame, mask)| {
        for id in &ids {
            let folder = folders.get(id).cloned().unwrap_or_else(|| id.0.to_string());
            let path = dir.join(folder).join(format!("{}.png", export.stems[frame]));
            write_whole(&path, &encode_black_and_white(mask, *id)?)?;
        }
        Ok(())
    })?;
    Ok(())
}

/// PNG files by the label folder that they lie in, their stems without it.
fn label_folders(dir: &Path) -> Result<BTreeMap<String, Vec<FoundFile>>, MaskError> {
    let mut folders: BTreeMap<String, Vec<FoundFile>> = BTreeMap::new();
    for file in list_files(dir, &["png"])? {
        let Some((folder, stem)) = file.stem.split_once('/') else {
            let what = "is not in the folder of a label; binary masks lie as LABEL/FRAME.png (for label ids in one image use --format davis)";
            return Err(invalid(&file.path, what));
        };
        let found = FoundFile { path: file.path.clone(), stem: stem.to_owned() };
        folders.entry(folder.to_owned()).or_default().push(found);
    }
    if folders.is_empty() {
        return Err(invalid(dir, "holds no PNG; give the folder that holds LABEL/FRAME.png"));
    }
    Ok(folders)
}

/// The labels that folders stand for: those of `labels.json` and of the project.
fn adopted_folders(
    adoption: &mut Adoption,
    listed: Option<&LabelTree>,
) -> Result<BTreeMap<String, LabelId>, MaskError> {
    let mut names: BTreeMap<String, LabelId> =
        folder_names(adoption.tree()).into_iter().map(|(id, name)| (name, id)).collect();
    if let Some(listed) = listed {
        let ids = adoption.tree_of(listed)?;
        names.extend(folder_names(listed).into_iter().filter_map(|(id, name)| Some((name, *ids.get(&id)?))));
    }
    Ok(names)
}

fn folder_label(
    folder: &str,
    names: &BTreeMap<String, LabelId>,
    adoption: &mut Adoption,
) -> Result<LabelId, MaskError> {
    if let Some(&known) = names.get(folder) {
        return Ok(known);
    }
    match folder.parse() {
        Ok(number) if number > 0 => adoption.number(LabelId(number)),
        _ => adoption.named(&Newcomer { name: folder, id: None, parent: None, color: None }),
    }
}

fn highest_number<'n>(folders: impl Iterator<Item = &'n String>) -> LabelId {
    LabelId(folders.filter_map(|folder| folder.parse().ok()).max().unwrap_or(0))
}

fn frame_mask(
    frame: &MaskFrame<'_>,
    files: &[(LabelId, &FoundFile)],
    tree: &LabelTree,
) -> Result<(RunMask, usize), MaskError> {
    let (mask, contested) = stacked((frame.width, frame.height), files.to_vec(), tree, |file, emit| {
        let values = PngValues::read(&file.path, Some((frame.name, frame.width, frame.height)))?;
        let ids = values.into_ids(&file.path, None)?.mask.ids;
        let half = ids.iter().map(|id| id.0).max().unwrap_or(0) / 2;
        let mut start = 0;
        for run in ids.chunk_by(|a, b| (a.0 > half) == (b.0 > half)) {
            if run[0].0 > half {
                emit(start..start + run.len());
            }
            start += run.len();
        }
        Ok(())
    })?;
    Ok((RunMask::encode(&mask), contested))
}

/// A folder name per label: its name with characters that file systems refuse put as `_`; with its id behind where two
/// labels would share a folder.
fn folder_names(tree: &LabelTree) -> BTreeMap<LabelId, String> {
    let plain = |name: &str| -> String {
        let refused = |c: char| c.is_control() || "/\\:*?\"<>|".contains(c);
        let name: String = name.chars().map(|c| if refused(c) { '_' } else { c }).collect();
        let name = name.trim_matches(['.', ' ']);
        if name.is_empty() { "_".into() } else { name.to_owned() }
    };
    let mut uses: BTreeMap<String, usize> = BTreeMap::new();
    for label in tree.iter() {
        *uses.entry(plain(&label.name).to_lowercase()).or_default() += 1;
    }
    let folder = |name: String, id: LabelId| {
        if uses.get(&name.to_lowercase()) == Some(&1) { name } else { format!("{name}_{}", id.0) }
    };
    tree.iter().map(|label| (label.id, folder(plain(&label.name), label.id))).collect()
}

fn encode_black_and_white(mask: &RunMask, id: LabelId) -> Result<Vec<u8>, MaskError> {
    let mut pixels = Vec::with_capacity(mask.width as usize * mask.height as usize);
    for &(at, length) in &mask.runs {
        pixels.resize(pixels.len() + length as usize, if at == id { 255u8 } else { 0 });
    }
    encode_png(mask.width, mask.height, Stored::Grey, &pixels)
}
