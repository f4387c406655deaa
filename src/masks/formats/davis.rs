use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use rayon::prelude::*;

use super::files::{
    FoundFile, Skipped, in_parallel, invalid, list_files, unless_stopped, write_whole,
};
use super::frame_matching::{
    Export, Imported, MaskFrame, NameIndex, nothing_fits, unmatched_warning,
};
use super::grey_kinds::{
    EdgeStatistics, White, covers_most, ids_in, is_black_and_white, may_be_soft, may_be_soft_edges,
    meaning_of_white, white_as_one,
};
use super::label_import::LabelImport;
use super::labels_json::{ListedLabels, ids_of_colors, listed_labels, write_labels_json};
use super::png_decode::Stored;
use super::png_values::{HowRead, PngValues, encode_png, reconcile_cut_outs};
use crate::{LabelId, LabelMask, LabelTree, MaskError, RunMask};
use ostra_core::job::Progress;

/// Number of labels named after their numbers above which a warning is added.
///
/// The values may not be ids.
const MAX_UNREPORTED: usize = 20;
/// Maximum number of ids listed in a message.
const MAX_NAMED_IDS: usize = 10;

/// Encodes a mask as a PNG whose pixel values are label ids.
///
/// The image has an 8-bit palette with the labels' colours (0 = black), or 16-bit grey when an id
/// exceeds 255. Compression is light and fast.
///
/// # Errors
/// [`MaskError::Request`] for a mask without pixels.
pub fn encode_palette_png(mask: &RunMask, tree: &LabelTree) -> Result<Vec<u8>, MaskError> {
    let highest = mask.runs.iter().map(|run| run.0).max().unwrap_or_default();
    let (stored, pixels) = match u8::try_from(highest.0) {
        Ok(highest) => (
            Stored::Palette(palette(tree, highest)),
            fill(mask, |id| [id.0 as u8]),
        ),
        Err(_) => (Stored::Grey16, fill(mask, |id| id.0.to_be_bytes())),
    };
    encode_png(mask.width, mask.height, stored, &pixels)
}

/// Reads a mask PNG of any kind whose pixels are ids.
///
/// Ids may be palette indices, grey values, or colours that are all grey. Values up to 65535 are
/// exact.
///
/// # Errors
/// [`MaskError::Io`] or [`MaskError::Invalid`].
pub fn read_palette_png(path: &Path) -> Result<LabelMask, MaskError> {
    Ok(PngValues::read(path, None)?.into_ids(path, None)?.mask)
}

/// Reads a frame's mask like [`read_palette_png`], and checks its size first.
///
/// # Errors
/// As [`read_palette_png`], and [`MaskError::Invalid`] when the header gives another size.
pub fn read_palette_png_of(path: &Path, frame: &MaskFrame<'_>) -> Result<LabelMask, MaskError> {
    Ok(PngValues::read(path, Some(frame))?
        .into_ids(path, None)?
        .mask)
}

/// Masks as read, before their values are interpreted.
struct DavisFiles {
    /// Masks by frame, without files that cannot be used.
    masks: Vec<(usize, RunMask)>,
    /// All values that occur in the masks.
    ids: BTreeSet<LabelId>,
    /// Skipped files and decisions.
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
    let (matched_frames, masks): (Vec<usize>, Vec<RunMask>) = read.masks.into_iter().unzip();
    let known = KnownLabels {
        listed: &listed,
        tree,
    };
    let masks = understood(dir, masks, &read.ids, &known, &mut warnings)?;
    let Labelled {
        masks,
        label_import,
    } = with_labels(&masks, listed.tree.as_ref(), tree, &mut warnings)?;
    let unmatched: Vec<&str> = matched
        .unmatched
        .iter()
        .map(|file| file.stem.as_str())
        .collect();
    warnings.extend(
        unmatched_warning(&unmatched)
            .into_iter()
            .chain(read.skipped.warnings()),
    );
    Ok(Imported {
        masks: matched_frames.into_iter().zip(masks).collect(),
        new_labels: label_import.into_added(),
        warnings,
    })
}

/// Reads the files that can be read.
///
/// # Errors
/// The first file's error when no file can be used.
fn read_files(
    pairs: &[(usize, &FoundFile)],
    frames: &[MaskFrame<'_>],
    listed: &ListedLabels,
    progress: &Progress,
) -> Result<DavisFiles, MaskError> {
    let colors = listed.tree.as_ref().map(ids_of_colors);
    let read_file = |&(frame, file): &(usize, &FoundFile)| {
        let values = PngValues::read(&file.path, Some(&frames[frame]))?;
        let read = values.into_ids(&file.path, colors.as_ref())?;
        Ok((RunMask::encode(&read.mask), read.how))
    };
    let results = in_parallel(pairs, progress, |pair| unless_stopped(read_file(pair)))?;
    let mut skipped = Skipped::default();
    let mut first_error = None;
    let mut read: Vec<(usize, &FoundFile, RunMask, HowRead)> = Vec::with_capacity(pairs.len());
    for (&(frame, file), result) in pairs.iter().zip(results) {
        match result {
            Ok((mask, how)) => read.push((frame, file, mask, how)),
            Err(error) => {
                skipped.add_unreadable(&error);
                first_error.get_or_insert(error);
            }
        }
    }
    if let Some(error) = first_error.filter(|_| read.is_empty()) {
        return Err(error);
    }
    reconcile_cut_outs(read.iter_mut().map(|(_, _, mask, how)| (mask, how)));
    for (_, file, _, how) in &read {
        for what in how.warnings() {
            skipped.add(what, format!("'{}'", file.stem));
        }
    }
    let masks: Vec<(usize, RunMask)> = read
        .into_iter()
        .map(|(frame, _, mask, _)| (frame, mask))
        .collect();
    let ids = ids_in(masks.iter().map(|(_, mask)| mask));
    Ok(DavisFiles {
        masks,
        ids,
        skipped,
    })
}

/// Labels that ids may refer to.
struct KnownLabels<'a> {
    /// Labels of the folder.
    listed: &'a ListedLabels,
    /// Labels of the project.
    tree: &'a LabelTree,
}

/// Returns masks that contain only ids.
///
/// Values that mean "void" and soft edges are replaced or rejected.
fn understood(
    dir: &Path,
    mut masks: Vec<RunMask>,
    ids: &BTreeSet<LabelId>,
    labels: &KnownLabels<'_>,
    warnings: &mut Vec<String>,
) -> Result<Vec<RunMask>, MaskError> {
    let KnownLabels { listed, tree } = *labels;
    let highest = ids.last().copied().unwrap_or_default();
    match &listed.tree {
        Some(listed) => check_unlisted(dir, &masks, ids, listed)?,
        // Ids are checked first, because decoding takes time and masks with few or low values are
        // never soft.
        None if may_be_soft(ids) && counted(&masks, EdgeStatistics::of).are_soft() => {
            let half = highest.0 / 2;
            masks = masks
                .iter()
                .map(|mask| mask.map_ids(|id| LabelId(u16::from(id.0 > half))))
                .collect();
            warnings.push(format!(
                "the masks have {} grey values with soft edges, which are no label ids; values above {half} (half of the \
                 highest) became label 1, the others no label",
                ids.len()
            ));
            return Ok(masks);
        }
        None => {}
    }
    let known = |id| {
        listed
            .tree
            .as_ref()
            .or(Some(tree))
            .is_some_and(|tree| tree.get(id).is_some())
    };
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
        White::Void(void) if covers_most(void, &masks) => {
            let what = format!(
                "its masks have the value {0} on more pixels than all other values together, so it may be a label, void, or \
                 the inside of a soft mask; list a label with the id {0} in labels.json, set void pixels to 0, or import \
                 a folder of masks for each label with --format binary",
                void.0
            );
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

fn counted(
    masks: &[RunMask],
    count: impl Fn(&LabelMask) -> EdgeStatistics + Sync,
) -> EdgeStatistics {
    masks
        .par_iter()
        .map(|mask| count(&mask.decode()))
        .reduce(EdgeStatistics::default, EdgeStatistics::plus)
}

/// Rejects masks whose unlisted values are soft edges.
///
/// Such masks were smoothed or resized by an image editor.
fn check_unlisted(
    dir: &Path,
    masks: &[RunMask],
    ids: &BTreeSet<LabelId>,
    listed: &LabelTree,
) -> Result<(), MaskError> {
    let is_unlisted = |id: LabelId| id != LabelId::NONE && listed.get(id).is_none();
    let unlisted: Vec<LabelId> = ids.iter().copied().filter(|&id| is_unlisted(id)).collect();
    if !may_be_soft_edges(&unlisted) {
        return Ok(());
    }
    if !counted(masks, |mask| EdgeStatistics::of_values(mask, is_unlisted)).are_soft() {
        return Ok(());
    }
    let what = format!(
        "its masks have soft edges with {} values that labels.json does not list ({}), as smoothing or resizing makes \
         them; save the masks without antialiasing and resize them to the nearest pixel, or list these ids",
        unlisted.len(),
        named(&unlisted)
    );
    Err(invalid(dir, what))
}

/// Lists the first of some ids.
fn named(ids: &[LabelId]) -> String {
    let more = if ids.len() > MAX_NAMED_IDS {
        ", …"
    } else {
        ""
    };
    let first: Vec<String> = ids
        .iter()
        .take(MAX_NAMED_IDS)
        .map(|id| id.0.to_string())
        .collect();
    format!("{}{more}", first.join(", "))
}

/// Masks with label ids of the project, and the labels added for them.
struct Labelled {
    masks: Vec<RunMask>,
    label_import: LabelImport,
}

/// Replaces the ids of the files by those of the project.
fn with_labels(
    masks: &[RunMask],
    listed: Option<&LabelTree>,
    tree: &LabelTree,
    warnings: &mut Vec<String>,
) -> Result<Labelled, MaskError> {
    let mut found = ids_in(masks);
    let masks: Vec<RunMask> = match is_black_and_white(&found, listed) {
        true => masks.iter().map(white_as_one).collect(),
        false => masks.to_vec(),
    };
    found = ids_in(&masks);
    let mut label_import = LabelImport::new(tree, found.last().copied().unwrap_or_default());
    let mut new_ids = listed.map_or_else(
        || Ok(BTreeMap::new()),
        |listed| label_import.tree_of(listed),
    )?;
    let mut numbered = Vec::new();
    for id in found {
        if let Entry::Vacant(vacant) = new_ids.entry(id) {
            if id != LabelId::NONE && (listed.is_some() || label_import.tree().get(id).is_none()) {
                numbered.push(id);
            }
            vacant.insert(label_import.number(id)?);
        }
    }
    let (count, ids) = (numbered.len(), named(&numbered));
    if listed.is_some() && count > 0 {
        warnings.push(format!(
            "{count} ids of the masks are not in labels.json ({ids}); they became labels by their numbers"
        ));
    } else if count > MAX_UNREPORTED {
        warnings.push(format!(
            "{count} labels were named after numbers ({ids}), since there is no labels.json; if the values of the masks are \
             not label ids, undo the import"
        ));
    }
    let masks = masks
        .iter()
        .map(|mask| mask.map_ids(|id| new_ids.get(&id).copied().unwrap_or(id)))
        .collect();
    Ok(Labelled {
        masks,
        label_import,
    })
}

/// Returns the error for a folder without PNG files, which mentions images of other types.
fn no_png(dir: &Path) -> MaskError {
    let others =
        list_files(dir, &["jpg", "jpeg", "tif", "tiff", "bmp", "webp", "gif"]).unwrap_or_default();
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

pub(super) fn export(
    dir: &Path,
    export: &Export<'_>,
    progress: &Progress,
) -> Result<(), MaskError> {
    write_labels_json(dir, export.tree)?;
    in_parallel(&export.masks, progress, |&(frame, mask)| {
        write_whole(
            &dir.join(format!("{}.png", export.stems[frame])),
            &encode_palette_png(mask, export.tree)?,
        )
    })?;
    Ok(())
}

fn palette(tree: &LabelTree, highest_in_mask: u8) -> Vec<u8> {
    let in_tree = tree
        .iter()
        .filter_map(|label| u8::try_from(label.id.0).ok())
        .max()
        .unwrap_or(0);
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
