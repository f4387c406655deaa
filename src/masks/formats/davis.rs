use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use rayon::prelude::*;

use super::adopt::Adoption;
use super::exchange::{Export, Imported, MaskFrame, nothing_fits, unmatched_warning};
use super::files::{FoundFile, in_parallel, invalid, list_files, write_whole};
use super::frame_names::NameIndex;
use super::grey_kinds::{EdgeStatistics, White, is_black_and_white, is_soft, meaning_of_white, white_as_one};
use super::labels_json::{Listed, ids_of_colors, listed_labels, write_labels_json};
use super::png_values::{PngValues, Stored, encode_png};
use super::skipped::Skipped;
use crate::engine::job::Progress;
use crate::masks::{LabelId, LabelMask, LabelTree, MaskError, RunMask};

/// Encodes a mask as PNG: pixel value = label id, 8-bit palette with the labels' colours (0 = black); 16-bit grey once
/// an id exceeds 255. Fast, with light compression.
///
/// # Errors
/// [`MaskError::Request`] for a mask without pixels.
pub fn encode_palette_png(mask: &RunMask, tree: &LabelTree) -> Result<Vec<u8>, MaskError> {
    let highest = mask.runs.iter().map(|run| run.0).max().unwrap_or_default();
    let (stored, pixels) = match u8::try_from(highest.0) {
        Ok(highest) => (Stored::Palette(palette(tree, highest)), fill(mask, |id| [id.0 as u8])),
        Err(_) => (Stored::Grey16, fill(mask, |id| id.0.to_be_bytes())),
    };
    encode_png(mask.width, mask.height, stored, &pixels)
}

/// Reads a mask PNG of any kind whose pixels are ids: palette places, grey values, or colours that are all grey. Exact
/// for ids up to 65535.
///
/// # Errors
/// [`MaskError::Io`], [`MaskError::Invalid`].
pub fn read_palette_png(path: &Path) -> Result<LabelMask, MaskError> {
    Ok(PngValues::read(path, None)?.into_ids(path, None)?.mask)
}

/// All ids in masks, 0 among them.
pub(in crate::masks) fn ids_in<'m>(masks: impl IntoIterator<Item = &'m RunMask>) -> BTreeSet<LabelId> {
    masks.into_iter().flat_map(|mask| mask.runs.iter().map(|run| run.0)).collect()
}

/// What is read of the files before their values are understood.
struct ReadFiles {
    masks: Vec<RunMask>,
    /// Every value in any of them.
    ids: BTreeSet<LabelId>,
    /// What was left out or decided.
    skipped: Skipped,
}

pub(super) fn import(
    dir: &Path,
    frames: &[MaskFrame<'_>],
    tree: &LabelTree,
    progress: &Progress,
) -> Result<Imported, MaskError> {
    let files = list_files(dir, &["png"])?;
    let first = files.first().ok_or_else(|| no_png(dir))?;
    let matched = NameIndex::new(frames.iter().map(|frame| frame.name)).match_files(dir, &files)?;
    if matched.pairs.is_empty() {
        return Err(nothing_fits(dir, &first.stem, frames));
    }
    let listed = listed_labels(dir)?;
    let read = read_files(&matched.pairs, frames, &listed, progress)?;
    let mut warnings: Vec<String> = listed.warning.clone().into_iter().collect();
    let masks = understood(dir, read.masks, &read.ids, (&listed, tree), &mut warnings)?;
    let (masks, adoption) = with_labels(&masks, listed.tree.as_ref(), tree)?;
    let unmatched: Vec<&str> = matched.unmatched.iter().map(|file| file.stem.as_str()).collect();
    warnings.extend(unmatched_warning(&unmatched).into_iter().chain(read.skipped.warnings()));
    Ok(Imported {
        masks: matched.pairs.iter().map(|pair| pair.0).zip(masks).collect(),
        new_labels: adoption.into_added(),
        warnings,
    })
}

fn read_files(
    pairs: &[(usize, &FoundFile)],
    frames: &[MaskFrame<'_>],
    listed: &Listed,
    progress: &Progress,
) -> Result<ReadFiles, MaskError> {
    let colors = listed.tree.as_ref().map(ids_of_colors);
    let read = in_parallel(pairs, progress, |&(frame, file)| {
        let frame = &frames[frame];
        let values = PngValues::read(&file.path, Some((frame.name, frame.width, frame.height)))?;
        let read = values.into_ids(&file.path, colors.as_ref())?;
        Ok((RunMask::encode(&read.mask), read.alpha))
    })?;
    let mut skipped = Skipped::default();
    for ((_, alpha), (_, file)) in read.iter().zip(pairs) {
        if let Some(what) = alpha.warning() {
            skipped.add(what, format!("'{}'", file.stem));
        }
    }
    let masks: Vec<RunMask> = read.into_iter().map(|(mask, _)| mask).collect();
    let ids = ids_in(&masks);
    Ok(ReadFiles { masks, ids, skipped })
}

/// Masks with ids only: values that mean "void", or soft edges, are replaced or refused.
fn understood(
    dir: &Path,
    mut masks: Vec<RunMask>,
    ids: &BTreeSet<LabelId>,
    (listed, tree): (&Listed, &LabelTree),
    warnings: &mut Vec<String>,
) -> Result<Vec<RunMask>, MaskError> {
    let highest = ids.last().copied().unwrap_or_default();
    let count = |mask: &RunMask| EdgeStatistics::of(&mask.decode(), highest);
    // Decoding takes a moment, and masks with few values or low ones are never soft.
    let candidate = ids.len() > 4 && highest.0 >= 128 && listed.tree.is_none();
    let counted = match candidate {
        true => masks.par_iter().map(count).reduce(EdgeStatistics::default, EdgeStatistics::plus),
        false => EdgeStatistics::default(),
    };
    if candidate && is_soft(ids, counted, listed) {
        let half = highest.0 / 2;
        masks = masks.iter().map(|mask| mask.map_ids(|id| LabelId(u16::from(id.0 > half)))).collect();
        warnings.push(format!(
            "the masks have {} grey values with soft edges, which are no label ids; values above {half} (half of the \
             highest) became label 1, the others no label",
            ids.len()
        ));
        return Ok(masks);
    }
    let known = |id| listed.tree.as_ref().or(Some(tree)).is_some_and(|tree| tree.get(id).is_some());
    match meaning_of_white(ids, known) {
        White::Id => {}
        White::SpreadId => warnings.push(format!(
            "the values of the masks divide the range up to {0} evenly, so {0} was read as a label and not as void",
            highest.0
        )),
        White::Trimap => {
            let what = "its masks have the values 0, one in the middle, and white, as trimaps and soft masks do; save \
                        label ids, or import a folder of masks for each label with --format binary (white is what is \
                        above half)";
            return Err(invalid(dir, what));
        }
        White::Void(void) => {
            let areas = masks.iter().filter_map(|mask| Some(mask.extents().get(&void)?.area));
            let (pixels, images) = areas.fold((0, 0), |(pixels, images), area| (pixels + area, images + 1));
            masks = masks.iter().map(|mask| mask.map_ids(|id| if id == void { LabelId::NONE } else { id })).collect();
            warnings.push(format!(
                "{pixels} pixels of {images} masks have the value {}, which means void next to smaller ids; they got no \
                 label (list a label with this id in labels.json to keep it)",
                void.0
            ));
        }
    }
    Ok(masks)
}

/// Masks as read, with the project's ids in place of the files' own.
fn with_labels(
    masks: &[RunMask],
    listed: Option<&LabelTree>,
    tree: &LabelTree,
) -> Result<(Vec<RunMask>, Adoption), MaskError> {
    let mut found = ids_in(masks);
    let masks: Vec<RunMask> = match is_black_and_white(&found, listed) {
        true => masks.iter().map(white_as_one).collect(),
        false => masks.to_vec(),
    };
    found = ids_in(&masks);
    let mut adoption = Adoption::new(tree, found.last().copied().unwrap_or_default());
    let mut new_ids = listed.map_or_else(|| Ok(BTreeMap::new()), |listed| adoption.tree_of(listed))?;
    for id in found {
        if let Entry::Vacant(vacant) = new_ids.entry(id) {
            vacant.insert(adoption.number(id)?);
        }
    }
    let masks = masks.iter().map(|mask| mask.map_ids(|id| new_ids.get(&id).copied().unwrap_or(id))).collect();
    Ok((masks, adoption))
}

/// The error for a folder without PNG files; images of other kinds in it are named.
fn no_png(dir: &Path) -> MaskError {
    let others = list_files(dir, &["jpg", "jpeg", "tif", "tiff", "bmp", "webp", "gif"]).unwrap_or_default();
    match others.first() {
        Some(first) => invalid(
            dir,
            format!(
                "holds no PNG but {} other images (first: {}); JPEG changes the values of pixels and the others are not \
                 read, so save the masks as PNG",
                others.len(),
                first.path.file_name().unwrap_or_default().to_string_lossy()
            ),
        ),
        None => invalid(dir, "holds no PNG; give the folder of the masks"),
    }
}

pub(super) fn export(dir: &Path, export: &Export<'_>, progress: &Progress) -> Result<(), MaskError> {
    write_labels_json(dir, export.tree)?;
    in_parallel(&export.masks, progress, |&(frame, mask)| {
        write_whole(&dir.join(format!("{}.png", export.stems[frame])), &encode_palette_png(mask, export.tree)?)
    })?;
    Ok(())
}

fn palette(tree: &LabelTree, highest_in_mask: u8) -> Vec<u8> {
    let in_tree = tree.iter().filter_map(|label| u8::try_from(label.id.0).ok()).max().unwrap_or(0);
    let color = |id: u8| match (id, tree.get(LabelId(u16::from(id)))) {
        (0, _) => [0; 3],
        (_, Some(label)) => label.color,
        (_, None) => LabelTree::color_for(LabelId(u16::from(id))),
    };
    (0..=highest_in_mask.max(in_tree)).flat_map(color).collect()
}

fn fill<const N: usize>(mask: &RunMask, value: impl Fn(LabelId) -> [u8; N]) -> Vec<u8> {
    let mut pixels: Vec<[u8; N]> = Vec::with_capacity(mask.width as usize * mask.height as usize);
    for &(id, length) in &mask.runs {
        pixels.resize(pixels.len() + length as usize, value(id));
    }
    pixels.into_flattened()
}
