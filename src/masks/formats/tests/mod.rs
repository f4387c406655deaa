//! Tests of the mask formats: round trips, handwritten files and damaged files.

mod handwritten;
mod images;
mod round_trip;

use std::path::Path;

use super::{Imported, MaskFormat, MaskFrame};
use crate::{Label, LabelId, LabelMask, LabelTree, MaskError, RunMask};
use ostra_core::job::Progress;

const WIDTH: u32 = 13;
const HEIGHT: u32 = 9;

/// Returns the tree rice › (stem 1, panicle › grain), and pot with a gap in the ids.
fn tree() -> LabelTree {
    [
        (1, "rice", None),
        (2, "stem 1", Some(1)),
        (3, "panicle: 'A/B', #1", Some(1)),
        (4, "grain", Some(3)),
        (9, "pot", None),
    ]
    .map(|(id, name, parent): (u16, &str, Option<u16>)| Label {
        id: LabelId(id),
        name: name.into(),
        color: LabelTree::color_for(LabelId(id)),
        parent: parent.map(LabelId),
    })
    .to_vec()
    .try_into()
    .unwrap()
}

fn frames<'a>(names: &[&'a str]) -> Vec<MaskFrame<'a>> {
    names
        .iter()
        .map(|name| MaskFrame {
            name,
            width: WIDTH,
            height: HEIGHT,
        })
        .collect()
}

fn mask(ids: impl IntoIterator<Item = u16>) -> RunMask {
    let mut ids: Vec<LabelId> = ids.into_iter().map(LabelId).collect();
    ids.resize((WIDTH * HEIGHT) as usize, LabelId::NONE);
    RunMask::encode(&LabelMask {
        width: WIDTH,
        height: HEIGHT,
        ids,
    })
}

fn import(
    dir: &Path,
    format: MaskFormat,
    names: &[&str],
    tree: &LabelTree,
) -> Result<Imported, MaskError> {
    format.import_masks(dir, &frames(names), tree, &Progress::default())
}

fn export(
    dir: &Path,
    format: MaskFormat,
    names: &[&str],
    masks: &[(usize, RunMask)],
) -> Result<(), MaskError> {
    let masks = masks.iter().map(|(frame, mask)| (*frame, mask));
    format.export_masks(dir, &frames(names), masks, &tree(), &Progress::default())
}
