use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use super::adopt::Adoption;
use super::exchange::{Export, Imported, MaskFrame, nothing_fits, unmatched_warning};
use super::files::{in_parallel, invalid, list_files, write_whole};
use super::frame_names::NameIndex;
use super::labels_json::{ids_of_colors, read_labels_json, write_labels_json};
use super::png_values::{PngValues, Stored, encode_png};
use crate::engine::job::Progress;
use crate::masks::{LabelId, LabelMask, LabelTree, MaskError, RunMask};

/// A value that stands for "the one object" in pictures of black and white.
const WHITE: LabelId = LabelId(255);

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
    PngValues::read(path, None)?.into_ids(path, None)
}

/// Whether pictures are black and white masks of one object, label 1: their only value besides 0 is 255, and no label
/// is known to have that id.
pub(in crate::masks) fn is_black_and_white(ids: &BTreeSet<LabelId>, listed: Option<&LabelTree>) -> bool {
    let mut values = ids.iter().filter(|&&id| id != LabelId::NONE);
    values.next() == Some(&WHITE) && values.next().is_none() && listed.is_none_or(|tree| tree.get(WHITE).is_none())
}

/// All ids in masks, 0 among them.
pub(in crate::masks) fn ids_in<'m>(masks: impl IntoIterator<Item = &'m RunMask>) -> BTreeSet<LabelId> {
    masks.into_iter().flat_map(|mask| mask.runs.iter().map(|run| run.0)).collect()
}

/// 255 as label 1, all else as it is.
pub(in crate::masks) fn white_as_one(mask: &RunMask) -> RunMask {
    mask.map_ids(|id| if id == WHITE { LabelId(1) } else { id })
}

pub(super) fn import(
    dir: &Path,
    frames: &[MaskFrame<'_>],
    tree: &LabelTree,
    progress: &Progress,
) -> Result<Imported, MaskError> {
    let files = list_files(dir, &["png"])?;
    let first = files.first().ok_or_else(|| invalid(dir, "holds no PNG; give the folder of the masks"))?;
    let matched = NameIndex::new(frames.iter().map(|frame| frame.name)).match_files(dir, &files)?;
    if matched.pairs.is_empty() {
        return Err(nothing_fits(dir, &first.stem, frames));
    }
    let listed = read_labels_json(dir)?;
    let colors = listed.as_ref().map(ids_of_colors);
    let masks = in_parallel(&matched.pairs, progress, |&(frame, file)| {
        let frame = &frames[frame];
        let values = PngValues::read(&file.path, Some((frame.name, frame.width, frame.height)))?;
        Ok(RunMask::encode(&values.into_ids(&file.path, colors.as_ref())?))
    })?;
    let (masks, adoption) = with_labels(&masks, listed.as_ref(), tree)?;
    let unmatched: Vec<&str> = matched.unmatched.iter().map(|file| file.stem.as_str()).collect();
    Ok(Imported {
        masks: matched.pairs.iter().map(|pair| pair.0).zip(masks).collect(),
        new_labels: adoption.into_added(),
        warnings: unmatched_warning(&unmatched).into_iter().collect(),
    })
}

/// Masks as read, with the project's ids in place of the files' own.
fn with_labels(
    masks: &[RunMask],
    listed: Option<&LabelTree>,
    tree: &LabelTree,
) -> Result<(Vec<RunMask>, Adoption), MaskError> {
    let found = ids_in(masks);
    let black_and_white = is_black_and_white(&found, listed);
    let mut adoption = Adoption::new(tree, found.last().copied().unwrap_or_default());
    let mut new_ids = listed.map_or_else(|| Ok(BTreeMap::new()), |listed| adoption.tree_of(listed))?;
    for id in found {
        let number = if black_and_white && id == WHITE { LabelId(1) } else { id };
        if let Some(&known) = new_ids.get(&number) {
            new_ids.insert(id, known);
        } else {
            new_ids.insert(id, adoption.number(number)?);
        }
    }
    let masks = masks.iter().map(|mask| mask.map_ids(|id| new_ids.get(&id).copied().unwrap_or(id))).collect();
    Ok((masks, adoption))
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
