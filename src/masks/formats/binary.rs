use std::collections::BTreeMap;
use std::path::Path;

use super::files::{
    FoundFile, Skipped, in_parallel, invalid, list_files, unless_stopped, write_whole,
};
use super::frame_matching::{
    Export, Imported, MaskFrame, NameIndex, nothing_fits, unmatched_warning,
};
use super::label_import::{LabelImport, Newcomer};
use super::labels_json::{listed_labels, write_labels_json};
use super::layers::{Stacked, contested_warning, stacked};
use super::png_decode::Stored;
use super::png_values::{HowRead, PngValues, encode_png, reconcile_cut_outs};
use crate::{LabelId, LabelTree, MaskError, RunMask};
use ostra_core::disk;
use ostra_core::job::Progress;

/// Reads `LABEL/FRAME.png`.
///
/// A folder is matched to a label by its name, else by its number. A pixel is inside when its value
/// is more than half of the highest value in the label's files.
pub(super) fn import(
    dir: &Path,
    frames: &[MaskFrame<'_>],
    tree: &LabelTree,
    progress: &Progress,
) -> Result<Imported, MaskError> {
    let folders = label_folders(dir)?;
    let index = NameIndex::new(frames.iter().map(|frame| frame.name));
    let mut label_import = LabelImport::new(tree, highest_number(folders.keys()));
    let listed = listed_labels(dir)?;
    let names = imported_folders(&mut label_import, listed.tree.as_ref())?;
    let mut unmatched = Vec::new();
    let mut files: Vec<LabelFile<'_>> = Vec::new();
    for (folder, found) in &folders {
        let label = folder_label(folder, &names, &mut label_import)?;
        let matched = index.match_files(&dir.join(folder), found)?;
        unmatched.extend(matched.unmatched.iter().map(|file| file.stem.as_str()));
        files.extend(matched.pairs.into_iter().map(|(frame, file)| LabelFile {
            label,
            folder,
            frame,
            file,
        }));
    }
    if files.is_empty() {
        return Err(nothing_fits(
            dir,
            unmatched.first().copied().unwrap_or_default(),
            frames,
        ));
    }
    let mut skipped = Skipped::default();
    let objects = read_files(&files, frames, &mut skipped, progress)?;
    let jobs: Vec<(usize, Vec<(LabelId, ObjectMask)>)> = objects.into_iter().collect();
    let read = in_parallel(&jobs, progress, |(frame, objects)| {
        frame_mask(&frames[*frame], objects, label_import.tree())
    })?;
    let contested = read.iter().map(|one| one.contested).sum();
    let masks = jobs
        .iter()
        .map(|job| job.0)
        .zip(read.into_iter().map(|one| one.mask))
        .collect();
    let decided = unmatched_warning(&unmatched)
        .into_iter()
        .chain(contested_warning(contested));
    let warnings = listed
        .warning
        .into_iter()
        .chain(decided)
        .chain(skipped.warnings())
        .collect();
    Ok(Imported {
        masks,
        new_labels: label_import.into_added(),
        warnings,
    })
}

/// Writes one folder per label that occurs, each with an image of every frame.
pub(super) fn export(
    dir: &Path,
    export: &Export<'_>,
    progress: &Progress,
) -> Result<(), MaskError> {
    write_labels_json(dir, export.tree)?;
    let mut ids = super::grey_kinds::ids_in(export.masks.iter().map(|(_, mask)| *mask));
    ids.remove(&LabelId::NONE);
    let folders = folder_names(export.tree);
    in_parallel(&export.masks, progress, |&(frame, mask)| {
        for id in &ids {
            let folder = folders.get(id).cloned().unwrap_or_else(|| id.0.to_string());
            let path = dir
                .join(folder)
                .join(format!("{}.png", export.stems[frame]));
            write_whole(&path, &encode_black_and_white(mask, *id)?)?;
        }
        Ok(())
    })?;
    Ok(())
}

/// Returns the PNG files by label folder, with their stems relative to that folder.
fn label_folders(dir: &Path) -> Result<BTreeMap<String, Vec<FoundFile>>, MaskError> {
    let mut folders: BTreeMap<String, Vec<FoundFile>> = BTreeMap::new();
    for file in list_files(dir, &["png"])? {
        let Some((folder, stem)) = file.stem.split_once('/') else {
            let what = "is not in the folder of a label; binary masks lie as LABEL/FRAME.png (for label ids in one image use --format davis)";
            return Err(invalid(&file.path, what));
        };
        let found = FoundFile {
            path: file.path.clone(),
            stem: stem.to_owned(),
        };
        folders.entry(folder.to_owned()).or_default().push(found);
    }
    if folders.is_empty() {
        return Err(invalid(
            dir,
            "holds no PNG; give the folder that holds LABEL/FRAME.png",
        ));
    }
    Ok(folders)
}

/// Returns the labels of folder names, from `labels.json` and the project.
fn imported_folders(
    label_import: &mut LabelImport,
    listed: Option<&LabelTree>,
) -> Result<BTreeMap<String, LabelId>, MaskError> {
    let mut names: BTreeMap<String, LabelId> = folder_names(label_import.tree())
        .into_iter()
        .map(|(id, name)| (name, id))
        .collect();
    if let Some(listed) = listed {
        let ids = label_import.tree_of(listed)?;
        names.extend(
            folder_names(listed)
                .into_iter()
                .filter_map(|(id, name)| Some((name, *ids.get(&id)?))),
        );
    }
    Ok(names)
}

fn folder_label(
    folder: &str,
    names: &BTreeMap<String, LabelId>,
    label_import: &mut LabelImport,
) -> Result<LabelId, MaskError> {
    if let Some(&known) = names.get(folder) {
        return Ok(known);
    }
    match folder.parse() {
        Ok(number) if number > 0 => label_import.number(LabelId(number)),
        _ => label_import.named(&Newcomer {
            name: folder,
            id: None,
            parent: None,
            color: None,
        }),
    }
}

fn highest_number<'n>(folders: impl Iterator<Item = &'n String>) -> LabelId {
    LabelId(
        folders
            .filter_map(|folder| folder.parse().ok())
            .max()
            .unwrap_or(0),
    )
}

/// A mask file of one label on one frame.
struct LabelFile<'f> {
    label: LabelId,
    folder: &'f str,
    frame: usize,
    file: &'f FoundFile,
}

impl LabelFile<'_> {
    fn place(&self) -> String {
        format!("'{}/{}'", self.folder, self.file.stem)
    }
}

/// Values of a label's mask, and the lowest value that counts as inside.
struct ObjectMask {
    mask: RunMask,
    lowest: u32,
}

/// Reads the readable files by frame and counts the others.
///
/// All files of a label share the highest value, so that a frame with slight noise does not become
/// an object.
///
/// # Errors
/// The first file's error when no file can be used.
fn read_files(
    files: &[LabelFile<'_>],
    frames: &[MaskFrame<'_>],
    skipped: &mut Skipped,
    progress: &Progress,
) -> Result<BTreeMap<usize, Vec<(LabelId, ObjectMask)>>, MaskError> {
    let read_file = |label_file: &LabelFile<'_>| {
        let path = &label_file.file.path;
        let frame = &frames[label_file.frame];
        let read = PngValues::read(path, Some(frame))?.into_ids(path, None)?;
        Ok((RunMask::encode(&read.mask), read.how))
    };
    let results = in_parallel(files, progress, |file| unless_stopped(read_file(file)))?;
    let mut first_error = None;
    let mut by_label: BTreeMap<LabelId, Vec<(&LabelFile<'_>, RunMask, HowRead)>> = BTreeMap::new();
    for (file, result) in files.iter().zip(results) {
        match result {
            Ok((mask, how)) => by_label
                .entry(file.label)
                .or_default()
                .push((file, mask, how)),
            Err(error) => {
                skipped.add_unreadable(&error);
                first_error.get_or_insert(error);
            }
        }
    }
    if let Some(error) = first_error.filter(|_| by_label.is_empty()) {
        return Err(error);
    }
    let mut objects: BTreeMap<usize, Vec<(LabelId, ObjectMask)>> = BTreeMap::new();
    for (label, mut read) in by_label {
        reconcile_cut_outs(read.iter_mut().map(|(_, mask, how)| (mask, how)));
        let in_steps = |how: &HowRead| !how.alpha.is_cut_out() && !how.is_bilevel;
        let highest = read
            .iter()
            .filter(|(_, _, how)| in_steps(how))
            .map(|(_, mask, _)| highest_value(mask))
            .max();
        let highest = highest.unwrap_or_default();
        for (file, mask, how) in read {
            // Twice the value must exceed the highest value plus one, because 128 of 255 is the
            // middle of a trimap.
            let lowest = if in_steps(&how) {
                (highest.div_ceil(2) + 1).min(highest).max(1)
            } else {
                1
            };
            for what in how.warnings() {
                skipped.add(what, file.place());
            }
            if (1..lowest).contains(&highest_value(&mask)) {
                let what = "masks have values only up to half of the highest of their label, and became empty";
                skipped.add(what, file.place());
            }
            objects
                .entry(file.frame)
                .or_default()
                .push((label, ObjectMask { mask, lowest }));
        }
    }
    Ok(objects)
}

fn highest_value(mask: &RunMask) -> u32 {
    mask.runs
        .iter()
        .map(|run| u32::from(run.0.0))
        .max()
        .unwrap_or_default()
}

fn frame_mask(
    frame: &MaskFrame<'_>,
    objects: &[(LabelId, ObjectMask)],
    tree: &LabelTree,
) -> Result<Stacked, MaskError> {
    let layers = objects
        .iter()
        .map(|(label, object)| (*label, object))
        .collect();
    stacked(frame, layers, tree, |object: &&ObjectMask, emit| {
        let mut start = 0;
        for &(value, length) in &object.mask.runs {
            let end = start + length as usize;
            if u32::from(value.0) >= object.lowest {
                emit(start..end);
            }
            start = end;
        }
        Ok(())
    })
}

/// Returns a folder name for each label.
///
/// Characters that file systems reject become `_`. The id is appended when two labels would share a
/// folder, or when the import would skip the name as a system folder.
fn folder_names(tree: &LabelTree) -> BTreeMap<LabelId, String> {
    let plain = |name: &str| -> String {
        let refused = |c: char| c.is_control() || "/\\:*?\"<>|".contains(c);
        let name: String = name
            .chars()
            .map(|c| if refused(c) { '_' } else { c })
            .collect();
        let name = name.trim_matches(['.', ' ']);
        if name.is_empty() {
            "_".into()
        } else {
            name.to_owned()
        }
    };
    let mut uses: BTreeMap<String, usize> = BTreeMap::new();
    for label in tree.iter() {
        *uses.entry(plain(&label.name).to_lowercase()).or_default() += 1;
    }
    let folder = |name: String, id: LabelId| {
        let is_free = uses.get(&name.to_lowercase()) == Some(&1) && !disk::is_system_file(&name);
        if is_free {
            name
        } else {
            format!("{name}_{}", id.0)
        }
    };
    tree.iter()
        .map(|label| (label.id, folder(plain(&label.name), label.id)))
        .collect()
}

fn encode_black_and_white(mask: &RunMask, id: LabelId) -> Result<Vec<u8>, MaskError> {
    let mut pixels = Vec::with_capacity(mask.width as usize * mask.height as usize);
    for &(at, length) in &mask.runs {
        pixels.resize(
            pixels.len() + length as usize,
            if at == id { 255u8 } else { 0 },
        );
    }
    encode_png(mask.width, mask.height, Stored::Grey, &pixels)
}
