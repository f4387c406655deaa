use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use super::coco_categories::{CategoryLabels, import_categories};
use super::coco_draw::{OutlinedAnnotation, frame_mask, outline_of};
use super::coco_json::{
    Annotation, Category, Dataset, Id, ImageEntry, ListEntry, RleCounts, Segmentation,
};
use super::files::{
    FoundFile, Skipped, in_parallel, invalid, io_error, list_files, read_text, write_whole,
};
use super::frame_matching::{
    Export, Imported, MaskFrame, NameIndex, nothing_fits, unmatched_warning,
};
use super::label_import::LabelImport;
use super::layers::contested_warning;
use super::png_decode::size_fault;
use super::{coco_json, rle};
use crate::{Extent, Label, LabelId, LabelTree, MaskError, RunMask};
use ostra_core::job::Progress;

/// Name of the file that an export writes.
const FILE: &str = "annotations.json";

/// Reads a COCO JSON file.
///
/// `path` is the file itself, or a folder with `annotations.json` or a single JSON file. All
/// annotations of a category on an image form one label's pixels. An image without outlines gets no
/// mask, because such files list every image, including unlabelled ones. Unusable entries are
/// skipped and counted in the warnings.
pub(super) fn import(
    path: &Path,
    frames: &[MaskFrame<'_>],
    tree: &LabelTree,
    progress: &Progress,
) -> Result<Imported, MaskError> {
    let path = dataset_file(path)?;
    let dataset = coco_json::parse(&read_text(&path)?).map_err(|error| {
        invalid(
            &path,
            format!("is not a COCO JSON file ({error}); export it again"),
        )
    })?;
    let mut skipped = Skipped::default();
    let images = images_by_frame(&path, &dataset.images, frames, &mut skipped)?;
    let DrawnByFrame {
        frames: annotations,
        without_outline,
    } = drawn_by_frame(&dataset, &images, &mut skipped);
    let mut label_import = LabelImport::new(tree, LabelId::NONE);
    let used = annotations
        .values()
        .flatten()
        .map(|drawn| &drawn.annotation.category_id)
        .collect();
    let categories: Vec<&Category> = readable(
        &dataset.categories,
        "categories without id or name were left out",
        &mut skipped,
    );
    let CategoryLabels { labels, warnings } =
        import_categories(&categories, &used, &mut label_import)
            .map_err(|error| invalid(&path, error.to_string()))?;
    let jobs: Vec<(usize, Vec<OutlinedAnnotation<'_>>)> = annotations.into_iter().collect();
    let read = in_parallel(&jobs, progress, |(frame, drawn)| {
        frame_mask(
            &frames[*frame],
            drawn,
            &labels,
            label_import.tree(),
            progress,
        )
    })?;
    let mut masks = BTreeMap::new();
    let mut contested = 0;
    for ((frame, _), read) in jobs.iter().zip(read) {
        skipped.join(read.skipped);
        contested += read.contested;
        // A mask without labels would replace an existing mask of the frame.
        if read.mask.runs.iter().any(|run| run.0 != LabelId::NONE) {
            masks.insert(*frame, read.mask);
        }
    }
    if masks.is_empty() && !skipped.is_empty() {
        let faults: Vec<String> = skipped.warnings().collect();
        return Err(invalid(
            &path,
            format!("no annotation can be used: {}", faults.join("; ")),
        ));
    }
    let without_mask = images.frames().len() - masks.len();
    let counted = [
        (without_mask, "images have no outlines and got no mask"),
        (
            without_outline,
            "annotations have no outline (boxes only) and were left out",
        ),
    ];
    let counted = counted
        .into_iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, what)| format!("{count} {what}"));
    let decided = unmatched_warning(&images.unmatched)
        .into_iter()
        .chain(contested_warning(contested));
    let warnings = decided
        .chain(counted)
        .chain(warnings)
        .chain(skipped.warnings())
        .collect();
    Ok(Imported {
        masks,
        new_labels: label_import.into_added(),
        warnings,
    })
}

/// Annotations of a file.
struct DrawnByFrame<'d> {
    /// Annotations with an outline, by frame.
    frames: BTreeMap<usize, Vec<OutlinedAnnotation<'d>>>,
    /// Number of annotations without an outline.
    without_outline: usize,
}

/// Groups the annotations by frame.
fn drawn_by_frame<'d>(
    dataset: &'d Dataset,
    images: &CocoImages<'_>,
    skipped: &mut Skipped,
) -> DrawnByFrame<'d> {
    let mut drawn: BTreeMap<usize, Vec<OutlinedAnnotation<'_>>> = BTreeMap::new();
    let mut without_outline = 0;
    let what = "annotations without image or category were left out";
    for annotation in readable(&dataset.annotations, what, skipped) {
        let place = || format!("annotation {}", annotation.id);
        match (
            images.frame_of_id.get(&annotation.image_id),
            outline_of(annotation),
        ) {
            (None, _) => skipped.add(
                "annotations of an image that is not listed were left out",
                place(),
            ),
            (Some(None), _) => {}
            (Some(Some(_)), None) => without_outline += 1,
            (Some(&Some(frame)), Some(outline)) => {
                drawn.entry(frame).or_default().push(OutlinedAnnotation {
                    annotation,
                    outline,
                });
            }
        }
    }
    DrawnByFrame {
        frames: drawn,
        without_outline,
    }
}

/// Returns the entries that could be read and counts the others.
fn readable<'e, T>(
    entries: &'e [ListEntry<T>],
    what: &'static str,
    skipped: &mut Skipped,
) -> Vec<&'e T> {
    let mut found = Vec::with_capacity(entries.len());
    for (at, entry) in (1..).zip(entries) {
        match entry.read() {
            Some(entry) => found.push(entry),
            None => skipped.add(what, format!("entry {at}")),
        }
    }
    found
}

/// Writes `annotations.json` with one annotation per frame and label.
///
/// Regions are packed run lengths, and the category id is the label id.
pub(super) fn export(
    dir: &Path,
    export: &Export<'_>,
    progress: &Progress,
) -> Result<(), MaskError> {
    let image = |&(frame, mask): &(usize, &RunMask)| {
        ListEntry::Read(ImageEntry {
            id: image_id(frame),
            file_name: export.frames[frame].name.to_owned(),
            width: Some(mask.width),
            height: Some(mask.height),
        })
    };
    let per_frame = in_parallel(&export.masks, progress, |&(frame, mask)| {
        Ok(annotations(frame, mask))
    })?;
    let mut annotations: Vec<Annotation> = per_frame.into_iter().flatten().collect();
    for (id, annotation) in (1i64..).zip(&mut annotations) {
        annotation.id = id.into();
    }
    let images = export.masks.iter().map(image).collect();
    let annotations = annotations.into_iter().map(ListEntry::Read).collect();
    let categories = categories(export)?
        .into_iter()
        .map(ListEntry::Read)
        .collect();
    let dataset = Dataset {
        images,
        annotations,
        categories,
    };
    let path = dir.join(FILE);
    let text = serde_json::to_vec(&dataset).map_err(|error| io_error(&path)(error.into()))?;
    write_whole(&path, &text)
}

fn dataset_file(path: &Path) -> Result<PathBuf, MaskError> {
    if !path.is_dir() {
        return Ok(path.to_path_buf());
    }
    if path.join(FILE).is_file() {
        return Ok(path.join(FILE));
    }
    let mut found = list_files(path, &["json"])?;
    match (found.pop(), found.is_empty()) {
        (Some(only), true) => Ok(only.path),
        (Some(_), false) => Err(invalid(
            path,
            "holds several JSON files; give the COCO file itself",
        )),
        (None, _) => Err(invalid(
            path,
            "holds no JSON; give the COCO file or its folder",
        )),
    }
}

/// Images of a file.
struct CocoImages<'i> {
    /// Frame of each image by image id; `None` for an image without a usable frame.
    frame_of_id: BTreeMap<&'i Id, Option<usize>>,
    /// Names of images that match no frame.
    unmatched: Vec<&'i str>,
}

impl CocoImages<'_> {
    fn frames(&self) -> BTreeSet<usize> {
        self.frame_of_id.values().copied().flatten().collect()
    }
}

fn images_by_frame<'i>(
    path: &Path,
    images: &'i [ListEntry<ImageEntry>],
    frames: &[MaskFrame<'_>],
    skipped: &mut Skipped,
) -> Result<CocoImages<'i>, MaskError> {
    let index = NameIndex::new(frames.iter().map(|frame| frame.name));
    let images = readable(
        images,
        "images without id or file name were left out",
        skipped,
    );
    let names: Vec<String> = images
        .iter()
        .map(|image| plain_path(&image.file_name))
        .collect();
    // Merged data sets list an image once per set, although it is one file.
    let different: BTreeSet<&str> = names.iter().map(String::as_str).collect();
    let entry = |name: &str| FoundFile {
        path: name.into(),
        stem: index.stem_of(name).to_owned(),
    };
    let entries: Vec<FoundFile> = different.into_iter().map(entry).collect();
    let matched = index.match_files(path, &entries)?.pairs;
    let frame_of_name: BTreeMap<&Path, usize> = matched
        .into_iter()
        .map(|(frame, file)| (file.path.as_path(), frame))
        .collect();
    let mut found = CocoImages {
        frame_of_id: BTreeMap::new(),
        unmatched: Vec::new(),
    };
    let mut listed: BTreeMap<&Id, &str> = BTreeMap::new();
    let mut entry_of_name: BTreeSet<&str> = BTreeSet::new();
    let mut first_fault = None;
    for (image, name) in images.into_iter().zip(&names) {
        if let Some(other) = listed.insert(&image.id, name).filter(|other| other != name) {
            let what = format!(
                "the image id {} is listed for '{other}' and for '{name}'; give each its own",
                image.id
            );
            return Err(invalid(path, what));
        }
        let place = || format!("'{}'", image.file_name);
        if !entry_of_name.insert(name) {
            skipped.add(
                "images are listed more than once; the annotations of all entries were taken",
                place(),
            );
        }
        let Some(&frame) = frame_of_name.get(Path::new(name)) else {
            found.frame_of_id.insert(&image.id, None);
            found.unmatched.push(&image.file_name);
            continue;
        };
        let fault = size_fault_of(image, &frames[frame], skipped);
        let usable = fault.is_none().then_some(frame);
        found.frame_of_id.insert(&image.id, usable);
        first_fault = first_fault.or(fault);
    }
    if let Some(fault) = first_fault.filter(|_| found.frames().is_empty()) {
        return Err(invalid(path, fault));
    }
    if found.frames().is_empty() {
        return Err(nothing_fits(
            path,
            found.unmatched.first().copied().unwrap_or_default(),
            frames,
        ));
    }
    Ok(found)
}

/// Describes how the size of an image differs from its frame; `None` when both agree.
fn size_fault_of(
    image: &ImageEntry,
    frame: &MaskFrame<'_>,
    skipped: &mut Skipped,
) -> Option<String> {
    let place = format!("'{}'", image.file_name);
    match image.width.zip(image.height) {
        None => {
            skipped.add(
                "images have no size; their outlines are taken to be in the frame's pixels",
                place,
            );
            None
        }
        Some((width, height)) if (width, height) != (frame.width, frame.height) => {
            let fault = format!("the image {place} {}", size_fault(width, height, frame));
            skipped.add(
                "images have another size than their frame and were left out",
                fault.clone(),
            );
            Some(fault)
        }
        Some(_) => None,
    }
}

/// Converts a file name of a COCO file to a path with `/`.
///
/// Windows writes `\`, and some tools write URLs or a leading `./`.
fn plain_path(name: &str) -> String {
    let name = match name.split_once("://") {
        Some((_, rest)) => rest.split(['?', '#']).next().unwrap_or(rest),
        None => name,
    };
    let name = name.replace('\\', "/");
    name.trim_start_matches("./").to_owned()
}

fn annotations(frame: usize, mask: &RunMask) -> Vec<Annotation> {
    let extents = mask.extents();
    let ids: Vec<LabelId> = extents.keys().copied().collect();
    let counts = rle::column_counts(&mask.decode(), &ids);
    let annotation = |((id, extent), counts): ((&LabelId, &Extent), Vec<u32>)| {
        let [left, top] = extent.min.map(f64::from);
        let [right, bottom] = extent.max.map(f64::from);
        Annotation {
            id: Id::from(0i64),
            image_id: image_id(frame),
            category_id: i64::from(id.0).into(),
            segmentation: Some(Segmentation::Runs {
                size: [mask.height, mask.width],
                counts: RleCounts::Packed(rle::packed(&counts)),
            }),
            area: extent.area as f64,
            bbox: vec![left, top, right - left + 1.0, bottom - top + 1.0],
            iscrowd: 0,
        }
    };
    extents.iter().zip(counts).map(annotation).collect()
}

/// Returns the labels of the tree, plus labels of masks that are missing there.
fn categories(export: &Export<'_>) -> Result<Vec<Category>, MaskError> {
    let category = |label: &Label| Category {
        id: i64::from(label.id.0).into(),
        name: label.name.clone(),
        supercategory: Some(
            label
                .parent
                .and_then(|parent| export.tree.get(parent))
                .unwrap_or(label)
                .name
                .clone(),
        ),
        color: Some(label.color),
    };
    let mut label_import = LabelImport::new(export.tree, LabelId::NONE);
    for id in super::grey_kinds::ids_in(export.masks.iter().map(|(_, mask)| *mask)) {
        label_import.number(id)?;
    }
    Ok(label_import.tree().iter().map(category).collect())
}

fn image_id(frame: usize) -> Id {
    (frame as i64 + 1).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn import_stops_between_annotations() {
        let text = r#"{"images": [], "annotations":
            [{"id": 1, "image_id": 1, "category_id": 1, "segmentation": [[0, 0, 2, 0, 2, 2]]}]}"#;
        let dataset = coco_json::parse(text).unwrap();
        let annotation = dataset.annotations[0].read().unwrap();
        let drawn = [OutlinedAnnotation {
            annotation,
            outline: outline_of(annotation).unwrap(),
        }];
        let labels = BTreeMap::from([(&annotation.category_id, LabelId(1))]);
        let frame = MaskFrame {
            name: "a.jpg",
            width: 4,
            height: 3,
        };
        let progress = Progress::default();
        let read = |progress| frame_mask(&frame, &drawn, &labels, &LabelTree::default(), progress);
        assert!(read(&progress).is_ok());
        progress.stop();
        assert!(matches!(read(&progress), Err(MaskError::Stopped(_))));
    }
}
