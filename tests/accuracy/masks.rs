//! Tests of mask formats and scores on the DAVIS-2016 clips.

use std::path::Path;

use ostra_core::job::Progress;
use ostra_eval::mask_score::{ScoreOptions, score_masks};
use ostra_masks::{
    Label, LabelId, LabelMask, LabelTree, MaskFormat, MaskFrame, RunMask, deepest_point,
    read_palette_png,
};

use crate::data::data_dir;

const CLIP: &str = "davis2016/Annotations/scooter-black";
const SIZE: (u32, u32) = (854, 480);

fn frame_names() -> Vec<String> {
    (0..43).map(|frame| format!("{frame:05}.jpg")).collect()
}

fn imported(dir: &Path, format: MaskFormat, names: &[String]) -> Vec<(usize, RunMask)> {
    let frames: Vec<MaskFrame<'_>> = frames(names);
    let read = format
        .import_masks(dir, &frames, &LabelTree::default(), &Progress::default())
        .unwrap();
    assert!(read.warnings.is_empty(), "{:?}", read.warnings);
    read.masks.into_iter().collect()
}

fn frames(names: &[String]) -> Vec<MaskFrame<'_>> {
    names
        .iter()
        .map(|name| MaskFrame {
            name,
            width: SIZE.0,
            height: SIZE.1,
        })
        .collect()
}

fn shifted(mask: &LabelMask, by: usize) -> LabelMask {
    let mut moved = LabelMask::empty(mask.width, mask.height);
    let width = mask.width as usize;
    for (to, from) in moved.ids.chunks_mut(width).zip(mask.ids.chunks(width)) {
        to[by..].copy_from_slice(&from[..width - by]);
    }
    moved
}

fn scores_of_shifted_masks_equal_an_independent_computation() {
    let data = data_dir();
    let names = frame_names();
    let masks = imported(&data.join(CLIP), MaskFormat::Davis, &names);
    let options = ScoreOptions {
        skip_first: true,
        level: None,
    };
    // J and F of the same shifts, computed in NumPy from the definition.
    for (by, j, f) in [
        (0, 1.0, 1.0),
        (3, 0.921_356_250_413, 1.0),
        (9, 0.802_277_111_171, 0.827_122_924_454),
        (20, 0.646_413_440_698, 0.463_587_172_318),
    ] {
        let dir = tempfile::tempdir().unwrap();
        let moved = masks
            .iter()
            .map(|(frame, mask)| (*frame, RunMask::encode(&shifted(&mask.decode(), by))));
        let tree = LabelTree::default();
        MaskFormat::Davis
            .export_masks(
                dir.path(),
                &frames(&names),
                moved,
                &tree,
                &Progress::default(),
            )
            .unwrap();
        let score =
            score_masks(&data.join(CLIP), dir.path(), &options, &Progress::default()).unwrap();
        assert_eq!((score.frames, score.labels.len()), (42, 1));
        assert!(
            (score.j - j).abs() < 1e-9 && (score.f - f).abs() < 1e-9,
            "{by}: {} {}",
            score.j,
            score.f
        );
    }
}

fn real_masks_survive_every_format() {
    let data = data_dir();
    let names = frame_names();
    let masks = imported(&data.join(CLIP), MaskFormat::Davis, &names);
    let mut tree = LabelTree::default();
    let id = LabelId(1);
    tree.set(Label {
        id,
        name: "scooter".to_owned(),
        color: LabelTree::color_for(id),
        parent: None,
    })
    .unwrap();
    for format in MaskFormat::ALL {
        let dir = tempfile::tempdir().unwrap();
        let held = masks.iter().map(|(frame, mask)| (*frame, mask));
        format
            .export_masks(
                dir.path(),
                &frames(&names),
                held,
                &tree,
                &Progress::default(),
            )
            .unwrap();
        assert_eq!(imported(dir.path(), format, &names), masks, "{format:?}");
    }
}

fn deepest_point_of_a_real_object_lies_on_it() {
    let data = data_dir();
    let mask = read_palette_png(&data.join(CLIP).join("00000.png")).unwrap();
    let object = mask.region(LabelId(255));
    let (x, y) = deepest_point(&object).unwrap();
    assert!(object.at(x, y) && object.eroded(15.0).at(x, y));
}

crate::registry::tests! {
    Data(&["davis2016"]) =>
        scores_of_shifted_masks_equal_an_independent_computation,
        real_masks_survive_every_format,
        deepest_point_of_a_real_object_lies_on_it;
}
