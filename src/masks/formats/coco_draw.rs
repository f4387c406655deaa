//! Conversion of COCO annotations to the mask of a frame.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::ops::Range;

use glam::DVec2;

use super::coco_json::{Annotation, Id, RleCounts, Segmentation};
use super::files::Skipped;
use super::frame_matching::MaskFrame;
use super::layers::stacked;
use super::rle;
use crate::edit::polygon_spans;
use crate::{LabelId, LabelTree, MaskError, RunMask};
use ostra_core::job::Progress;

/// Maximum plausible coordinate in pixels.
///
/// Larger ones are damaged, because no image has this size.
pub(super) const MAX_COORDINATE: f64 = 1e6;

/// An annotation with an outline.
pub(super) struct OutlinedAnnotation<'a> {
    pub annotation: &'a Annotation,
    pub(super) outline: &'a Segmentation,
}

/// Result of drawing a frame's annotations.
pub(super) struct AnnotationMask {
    pub mask: RunMask,
    /// Number of pixels that two labels claimed.
    pub contested: usize,
    pub skipped: Skipped,
}

pub(super) fn frame_mask(
    frame: &MaskFrame<'_>,
    drawn: &[OutlinedAnnotation<'_>],
    labels: &BTreeMap<&Id, LabelId>,
    tree: &LabelTree,
    progress: &Progress,
) -> Result<AnnotationMask, MaskError> {
    let mut skipped = Skipped::default();
    let mut layers = Vec::new();
    for OutlinedAnnotation {
        annotation,
        outline,
    } in drawn
    {
        match labels.get(&annotation.category_id) {
            Some(&label) => layers.push((label, (&annotation.id, *outline))),
            None => {
                let place = format!(
                    "annotation {}: category {}",
                    annotation.id, annotation.category_id
                );
                skipped.add(
                    "annotations of a category that is not listed were left out",
                    place,
                );
            }
        }
    }
    let skipped = RefCell::new(skipped);
    let stacked = stacked(frame, layers, tree, |(id, outline), emit| {
        progress.check()?;
        draw(outline, frame, emit, &mut |what, detail| {
            skipped
                .borrow_mut()
                .add(what, format!("annotation {id}{detail}"));
        });
        Ok(())
    })?;
    Ok(AnnotationMask {
        mask: stacked.mask,
        contested: stacked.contested,
        skipped: skipped.into_inner(),
    })
}

/// Returns the outline of an annotation; `None` when it only has a box.
pub(super) fn outline_of(annotation: &Annotation) -> Option<&Segmentation> {
    let empty = |outline: &&Segmentation| match outline {
        Segmentation::Polygons(polygons) => polygons.is_empty(),
        Segmentation::Polygon(corners) => corners.is_empty(),
        _ => false,
    };
    annotation
        .segmentation
        .as_ref()
        .filter(|outline| !empty(outline))
}

/// Emits the pixel ranges of an object.
///
/// `skip` is called for each unusable part, with the kind of fault and its details.
pub(super) fn draw(
    outline: &Segmentation,
    frame: &MaskFrame<'_>,
    emit: &mut dyn FnMut(Range<usize>),
    skip: &mut dyn FnMut(&'static str, String),
) {
    let mut emitted = false;
    let mut emit = |pixels: Range<usize>| {
        emitted |= !pixels.is_empty();
        emit(pixels);
    };
    let usable = match outline {
        Segmentation::Polygons(polygons) => {
            polygons
                .iter()
                .filter(|polygon| draw_polygon(polygon, frame, &mut emit, skip))
                .count()
                > 0
        }
        Segmentation::Polygon(polygon) => draw_polygon(polygon, frame, &mut emit, skip),
        Segmentation::Runs { size: its, counts } => {
            let (width, height) = (frame.width, frame.height);
            let spans = match counts {
                _ if *its != [height, width] => Err(format!(
                    "its region is {}×{} pixels, the image is {width}×{height}",
                    its[1], its[0]
                )),
                RleCounts::Plain(counts) => rle::spans(counts, width, height, &mut emit),
                RleCounts::Packed(text) => rle::unpacked(text)
                    .and_then(|counts| rle::spans(&counts, width, height, &mut emit)),
            };
            match spans {
                Ok(()) => true,
                Err(what) => {
                    skip(
                        "regions that are damaged or do not fit their image were left out",
                        format!(": {what}"),
                    );
                    false
                }
            }
        }
        Segmentation::Unreadable(_) => {
            skip(
                "annotations whose segmentation is neither polygons nor run lengths were left out",
                String::new(),
            );
            false
        }
    };
    if usable && !emitted {
        skip("annotations cover no pixel of their image", String::new());
    }
}

/// Emits the pixel ranges of a polygon and returns whether the polygon is usable.
pub(super) fn draw_polygon(
    polygon: &[Option<f64>],
    frame: &MaskFrame<'_>,
    emit: &mut dyn FnMut(Range<usize>),
    skip: &mut dyn FnMut(&'static str, String),
) -> bool {
    if polygon.len() % 2 == 1 {
        skip(
            "polygons with an x but no y were left out",
            format!(": {} numbers", polygon.len()),
        );
        return false;
    }
    if polygon.len() < 6 {
        skip(
            "polygons of fewer than three corners were left out",
            String::new(),
        );
        return false;
    }
    let usable = |number: &f64| number.abs() <= MAX_COORDINATE;
    let ring: Option<Vec<DVec2>> = polygon
        .chunks_exact(2)
        .map(|corner| {
            Some(DVec2::new(
                corner[0].filter(usable)?,
                corner[1].filter(usable)?,
            ))
        })
        .collect();
    let drawn =
        ring.is_some_and(|ring| polygon_spans(frame.width, frame.height, &[ring], emit).is_ok());
    if !drawn {
        skip(
            "polygons with a coordinate that is not a number or far outside were left out",
            String::new(),
        );
    }
    drawn
}
