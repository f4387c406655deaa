use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::path::{Path, PathBuf};

use glam::DVec2;

use super::adopt::{Adoption, Newcomer};
use super::coco_json::{Annotation, Category, Counts, Dataset, ImageEntry, Segmentation};
use super::exchange::{Export, Imported, MaskFrame, nothing_fits, unmatched_warning};
use super::files::{FoundFile, in_parallel, invalid, io_error, list_files, write_whole};
use super::frame_names::NameIndex;
use super::layers::{contested_warning, stacked};
use super::png_values::size_fault;
use super::rle;
use crate::engine::job::Progress;
use crate::masks::edit::polygon_spans;
use crate::masks::{Extent, Label, LabelId, LabelTree, MaskError, RunMask};

/// The file that an export writes.
const FILE: &str = "annotations.json";

/// Reads a COCO JSON: `path` itself, or in a folder `annotations.json` or the only JSON that is there. All annotations
/// of a category on a picture are one label's pixels. A picture without outlines gets no mask: such files list every
/// picture, the unlabelled too.
pub(super) fn import(
    path: &Path,
    frames: &[MaskFrame<'_>],
    tree: &LabelTree,
    progress: &Progress,
) -> Result<Imported, MaskError> {
    let path = dataset_file(path)?;
    let text = std::fs::read(&path).map_err(io_error(&path))?;
    let dataset: Dataset = serde_json::from_slice(&text)
        .map_err(|error| invalid(&path, format!("is no COCO JSON ({error}); export it anew")))?;
    let (frame_of_image, unmatched) = images_by_frame(&path, &dataset.images, frames)?;
    let mut drawn: BTreeMap<usize, Vec<Drawn<'_>>> = BTreeMap::new();
    let mut outlineless = 0;
    for annotation in &dataset.annotations {
        match (frame_of_image.get(&annotation.image_id), outline_of(annotation)) {
            (None, _) => {}
            (Some(_), None) => outlineless += 1,
            (Some(&frame), Some(outline)) => drawn.entry(frame).or_default().push(Drawn { annotation, outline }),
        }
    }
    let used = drawn.values().flatten().map(|drawn| drawn.annotation.category_id).collect();
    let mut adoption = Adoption::new(tree, LabelId::NONE);
    let labels =
        adopted(&dataset.categories, &used, &mut adoption).map_err(|error| invalid(&path, error.to_string()))?;
    let without_mask = frame_of_image.len() - drawn.len();
    let jobs: Vec<(usize, Vec<Drawn<'_>>)> = drawn.into_iter().collect();
    let read = in_parallel(&jobs, progress, |(frame, drawn)| {
        frame_mask(&path, &frames[*frame], drawn, &labels, adoption.tree())
    })?;
    let contested = read.iter().map(|(_, contested)| contested).sum();
    let masks = jobs.iter().map(|job| job.0).zip(read.into_iter().map(|(mask, _)| mask)).collect();
    let counted = [
        (without_mask, "pictures have no outlines and got no mask"),
        (outlineless, "annotations have no outline (boxes only) and were left out"),
    ];
    let counted = counted.into_iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}"));
    let warnings =
        unmatched_warning(&unmatched).into_iter().chain(contested_warning(contested)).chain(counted).collect();
    Ok(Imported { masks, new_labels: adoption.into_added(), warnings })
}

/// Writes `annotations.json`: one annotation per frame and label, regions as packed run lengths, category id = label id.
pub(super) fn export(dir: &Path, export: &Export<'_>, progress: &Progress) -> Result<(), MaskError> {
    let image = |&(frame, mask): &(usize, &RunMask)| ImageEntry {
        id: image_id(frame),
        file_name: export.frames[frame].name.to_owned(),
        width: mask.width,
        height: mask.height,
    };
    let per_frame = in_parallel(&export.masks, progress, |&(frame, mask)| Ok(annotations(frame, mask)))?;
    let mut annotations: Vec<Annotation> = per_frame.into_iter().flatten().collect();
    for (id, annotation) in (1..).zip(&mut annotations) {
        annotation.id = id;
    }
    let images = export.masks.iter().map(image).collect();
    let dataset = Dataset { images, annotations, categories: categories(export)? };
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
        (Some(_), false) => Err(invalid(path, "holds several JSON files; give the COCO file itself")),
        (None, _) => Err(invalid(path, "holds no JSON; give the COCO file or its folder")),
    }
}

/// The frame of each picture that has one, by the picture's id, and the names of the others.
fn images_by_frame<'i>(
    path: &Path,
    images: &'i [ImageEntry],
    frames: &[MaskFrame<'_>],
) -> Result<(BTreeMap<i64, usize>, Vec<&'i str>), MaskError> {
    let index = NameIndex::new(frames.iter().map(|frame| frame.name));
    let entry = |image: &ImageEntry| FoundFile {
        path: PathBuf::from(&image.file_name),
        stem: index.stem_of(&image.file_name.replace('\\', "/")).to_owned(),
    };
    let entries: Vec<FoundFile> = images.iter().map(entry).collect();
    let frame_of_stem: BTreeMap<&str, usize> =
        index.match_files(path, &entries)?.pairs.into_iter().map(|(frame, file)| (file.stem.as_str(), frame)).collect();
    let mut by_id = BTreeMap::new();
    let mut unmatched = Vec::new();
    for (image, entry) in images.iter().zip(&entries) {
        let Some(&frame) = frame_of_stem.get(entry.stem.as_str()) else {
            unmatched.push(image.file_name.as_str());
            continue;
        };
        let size = (frames[frame].width, frames[frame].height);
        if (image.width, image.height) != size {
            let fault = size_fault((image.width, image.height), frames[frame].name, size);
            return Err(invalid(path, format!("the picture '{}' {fault}", image.file_name)));
        }
        by_id.insert(image.id, frame);
    }
    if by_id.is_empty() {
        return Err(nothing_fits(path, unmatched.first().copied().unwrap_or_default(), frames));
    }
    Ok((by_id, unmatched))
}

/// The label of every used category.
fn adopted(
    categories: &[Category],
    used: &BTreeSet<i64>,
    adoption: &mut Adoption,
) -> Result<BTreeMap<i64, LabelId>, MaskError> {
    let mut labels = BTreeMap::new();
    for category in categories.iter().filter(|category| used.contains(&category.id)) {
        labels.insert(category.id, adopted_with_parents(&category.name, categories, adoption)?);
    }
    Ok(labels)
}

/// The label of a category, after those above it.
fn adopted_with_parents(name: &str, categories: &[Category], adoption: &mut Adoption) -> Result<LabelId, MaskError> {
    let mut chain = vec![name];
    while let Some(above) = supercategory(chain[chain.len() - 1], categories).filter(|above| !chain.contains(above)) {
        chain.push(above);
    }
    let mut parent = None;
    for name in chain.into_iter().rev() {
        let category = categories.iter().find(|category| category.name == name);
        let id = category.and_then(|category| u16::try_from(category.id).ok()).map(LabelId);
        let color = category.and_then(|category| category.color);
        parent = Some(adoption.named(&Newcomer { name, id, parent, color })?);
    }
    Ok(parent.unwrap_or_default())
}

fn supercategory<'c>(name: &str, categories: &'c [Category]) -> Option<&'c str> {
    let above = categories.iter().find(|category| category.name == name)?.supercategory.as_deref()?;
    (above != name && !above.is_empty() && above != "none").then_some(above)
}

/// An annotation that has an outline.
struct Drawn<'a> {
    annotation: &'a Annotation,
    outline: &'a Segmentation,
}

/// A frame's mask, and how many pixels two labels claimed.
fn frame_mask(
    path: &Path,
    frame: &MaskFrame<'_>,
    drawn: &[Drawn<'_>],
    labels: &BTreeMap<i64, LabelId>,
    tree: &LabelTree,
) -> Result<(RunMask, usize), MaskError> {
    let fault = |id: i64, what: String| invalid(path, format!("annotation {id}: {what}; export it anew"));
    let mut layers = Vec::new();
    for Drawn { annotation, outline } in drawn {
        let unknown = || fault(annotation.id, format!("category {} is not listed", annotation.category_id));
        let label = *labels.get(&annotation.category_id).ok_or_else(unknown)?;
        layers.push((label, (annotation.id, *outline)));
    }
    let (mask, contested) = stacked((frame.width, frame.height), layers, tree, |(id, outline), emit| {
        draw(outline, (frame.width, frame.height), emit).map_err(|what| fault(*id, what))
    })?;
    Ok((RunMask::encode(&mask), contested))
}

/// What an annotation says about its pixels; `None` when it holds only a box.
fn outline_of(annotation: &Annotation) -> Option<&Segmentation> {
    let empty = |outline: &&Segmentation| matches!(outline, Segmentation::Polygons(polygons) if polygons.is_empty());
    annotation.segmentation.as_ref().filter(|outline| !empty(outline))
}

/// Hands out an object's pixels.
fn draw(outline: &Segmentation, (width, height): (u32, u32), emit: &mut dyn FnMut(Range<usize>)) -> Result<(), String> {
    match outline {
        Segmentation::Polygons(polygons) => {
            polygons.iter().try_for_each(|polygon| draw_polygon(polygon, (width, height), emit))
        }
        Segmentation::Runs { size, .. } if *size != [height, width] => {
            Err(format!("its region is {}×{} pixels, the picture is {width}×{height}", size[1], size[0]))
        }
        Segmentation::Runs { counts: Counts::Plain(counts), .. } => rle::spans(counts, width, height, emit),
        Segmentation::Runs { counts: Counts::Packed(text), .. } => {
            rle::spans(&rle::unpacked(text)?, width, height, emit)
        }
    }
}

fn draw_polygon(
    polygon: &[f64],
    (width, height): (u32, u32),
    emit: &mut dyn FnMut(Range<usize>),
) -> Result<(), String> {
    if polygon.len() < 6 || polygon.len() % 2 == 1 {
        return Err(format!("a polygon has {} numbers; it needs x and y of three corners or more", polygon.len()));
    }
    let ring = polygon.chunks_exact(2).map(|corner| DVec2::new(corner[0], corner[1])).collect();
    polygon_spans(width, height, &[ring], emit).map_err(|error| error.to_string())
}

fn annotations(frame: usize, mask: &RunMask) -> Vec<Annotation> {
    let extents = mask.extents();
    let ids: Vec<LabelId> = extents.keys().copied().collect();
    let counts = rle::column_counts(&mask.decode(), &ids);
    let annotation = |((id, extent), counts): ((&LabelId, &Extent), Vec<u32>)| {
        let [left, top] = extent.min.map(f64::from);
        let [right, bottom] = extent.max.map(f64::from);
        Annotation {
            id: 0,
            image_id: image_id(frame),
            category_id: i64::from(id.0),
            segmentation: Some(Segmentation::Runs {
                size: [mask.height, mask.width],
                counts: Counts::Packed(rle::packed(&counts)),
            }),
            area: extent.area as f64,
            bbox: vec![left, top, right - left + 1.0, bottom - top + 1.0],
            iscrowd: 0,
        }
    };
    extents.iter().zip(counts).map(annotation).collect()
}

/// The labels of the tree, and those in masks that it lacks.
fn categories(export: &Export<'_>) -> Result<Vec<Category>, MaskError> {
    let category = |label: &Label| Category {
        id: i64::from(label.id.0),
        name: label.name.clone(),
        supercategory: Some(label.parent.and_then(|parent| export.tree.get(parent)).unwrap_or(label).name.clone()),
        color: Some(label.color),
    };
    let mut adoption = Adoption::new(export.tree, LabelId::NONE);
    for id in super::davis::ids_in(export.masks.iter().map(|(_, mask)| *mask)) {
        adoption.number(id)?;
    }
    Ok(adoption.tree().iter().map(category).collect())
}

fn image_id(frame: usize) -> i64 {
    frame as i64 + 1
}
