use std::collections::BTreeMap;

use proptest::prelude::*;

use super::*;
use crate::{encode_palette_png, read_palette_png};

const NAMES: [&str; 4] = [
    "cam 0/0001.jpg",
    "cam 0/0002.jpg",
    "film.mp4/000001",
    "x.y.png",
];

fn masks() -> impl Strategy<Value = Vec<(usize, RunMask)>> {
    let runs = prop::collection::vec(
        (
            prop::sample::select(vec![0u16, 0, 1, 2, 3, 4, 9]),
            1usize..30,
        ),
        60,
    );
    let pixels = (WIDTH * HEIGHT) as usize;
    let one = runs.prop_map(move |runs| {
        mask(
            runs.into_iter()
                .flat_map(|(id, count)| std::iter::repeat_n(id, count))
                .take(pixels),
        )
    });
    let labelled = |mask: &RunMask| mask.decode().ids.iter().any(|&id| id != LabelId::NONE);
    let one = one.prop_filter(
        "not all formats can say that a frame has no labels",
        labelled,
    );
    prop::collection::vec(one, NAMES.len())
        .prop_map(|masks| masks.into_iter().enumerate().collect())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn exported_masks_are_imported_unchanged(masks in masks(), skipped in 0usize..4) {
        let masks: Vec<(usize, RunMask)> = masks.into_iter().filter(|(frame, _)| *frame != skipped).collect();
        for format in MaskFormat::ALL {
            let dir = tempfile::tempdir().unwrap();
            export(dir.path(), format, &NAMES, &masks).unwrap();
            let known = import(dir.path(), format, &NAMES, &tree()).unwrap();
            prop_assert_eq!(&known.masks, &masks.iter().cloned().collect::<BTreeMap<_, _>>(), "{:?}", format);
            prop_assert!(known.new_labels.is_empty() && known.warnings.is_empty(), "{:?}", known.warnings);

            let fresh = import(dir.path(), format, &NAMES, &LabelTree::default()).unwrap();
            let now = LabelTree::try_from(fresh.new_labels).unwrap();
            for (frame, mask) in &masks {
                let by_name = mask.map_ids(|id| tree().get(id).map_or(id, |label| now.by_name(&label.name).unwrap().id));
                prop_assert_eq!(&fresh.masks[frame], &by_name, "{:?}", format);
            }
            for label in now.iter() {
                let before = tree().by_name(&label.name).unwrap().id;
                prop_assert_eq!(now.name_path(label.id), tree().name_path(before));
                prop_assert_eq!(label.color, tree().get(before).unwrap().color);
            }
        }
    }

    #[test]
    fn palette_pngs_round_trip(ids in prop::collection::vec(any::<u16>(), 117), narrow in any::<bool>()) {
        let ids = ids.into_iter().map(|id| if narrow { id % 256 } else { id });
        let mask = mask(ids);
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("m.png");
        std::fs::write(&path, encode_palette_png(&mask, &tree()).unwrap()).unwrap();
        prop_assert_eq!(RunMask::encode(&read_palette_png(&path).unwrap()), mask);
    }
}

#[test]
fn unlabelled_frames_survive_in_every_format_but_coco() {
    let masks = [(0, mask([])), (1, mask([1, 1, 2]))];
    for (format, frames) in [
        (MaskFormat::Davis, 2),
        (MaskFormat::Binary, 2),
        (MaskFormat::Yolo, 2),
        (MaskFormat::Coco, 1),
    ] {
        let dir = tempfile::tempdir().unwrap();
        export(dir.path(), format, &["a.png", "b.png"], &masks).unwrap();
        let read = import(dir.path(), format, &["a.png", "b.png"], &tree()).unwrap();
        assert_eq!(read.masks.len(), frames, "{format:?}");
        assert_eq!(
            read.warnings.len(),
            2 - frames,
            "COCO says that an image has no outlines: {:?}",
            read.warnings
        );
    }
}

#[test]
fn ids_without_label_are_named_after_their_numbers() {
    let masks = [(0, mask([7, 7, 300, 1]))];
    for format in MaskFormat::ALL {
        let dir = tempfile::tempdir().unwrap();
        export(dir.path(), format, &["a.png"], &masks).unwrap();
        let read = import(dir.path(), format, &["a.png"], &tree()).unwrap();
        let mut new: Vec<(u16, &str)> = read
            .new_labels
            .iter()
            .map(|label| (label.id.0, label.name.as_str()))
            .collect();
        new.sort_unstable();
        assert_eq!(new, [(7, "7"), (300, "300")], "{format:?}");
        assert_eq!(read.masks[&0], masks[0].1, "{format:?}");
    }
}

#[test]
fn frames_that_differ_only_in_extension_keep_their_masks() {
    let names = ["a.jpg", "a.png"];
    let masks = [(0, mask([1])), (1, mask([0, 2]))];
    for format in MaskFormat::ALL {
        let dir = tempfile::tempdir().unwrap();
        export(dir.path(), format, &names, &masks).unwrap();
        let read = import(dir.path(), format, &names, &tree()).unwrap();
        assert_eq!(read.masks, masks.iter().cloned().collect(), "{format:?}");
    }
}

#[test]
fn mask_of_another_size_is_skipped_and_both_sizes_are_named() {
    let masks = [(0, mask([1])), (1, mask([2]))];
    for format in MaskFormat::ALL
        .into_iter()
        .filter(|format| *format != MaskFormat::Yolo)
    {
        let dir = tempfile::tempdir().unwrap();
        export(dir.path(), format, &["a.png", "b.png"], &masks).unwrap();
        let mut frames = frames(&["a.png", "b.png"]);
        frames[1].width = 14;
        let import = |frames: &[MaskFrame<'_>]| {
            format.import_masks(dir.path(), frames, &tree(), &Progress::default())
        };
        let read = import(&frames).unwrap();
        assert_eq!(
            read.masks.keys().copied().collect::<Vec<_>>(),
            [0],
            "{format:?}"
        );
        let error = import(&frames[1..]).unwrap_err().to_string();
        for part in ["13×9", "14×9", "'b.png'"] {
            assert!(error.contains(part), "{format:?}: {error}");
            assert!(
                read.warnings.iter().any(|warning| warning.contains(part)),
                "{format:?}: {:?}",
                read.warnings
            );
        }
        let error = format.export_masks(
            dir.path(),
            &frames,
            masks.clone(),
            &tree(),
            &Progress::default(),
        );
        assert!(error.is_err(), "{format:?}");
    }
}

#[test]
fn masks_without_matching_frame_are_reported() {
    for format in MaskFormat::ALL {
        let dir = tempfile::tempdir().unwrap();
        assert!(
            import(dir.path(), format, &["a.png"], &tree()).is_err(),
            "an empty folder"
        );
        export(
            dir.path(),
            format,
            &["a.png", "b.png"],
            &[(0, mask([1])), (1, mask([1]))],
        )
        .unwrap();
        let some = import(dir.path(), format, &["z/b.jpg", "c.jpg"], &tree()).unwrap();
        assert_eq!(
            some.masks.keys().copied().collect::<Vec<_>>(),
            [0],
            "{format:?}"
        );
        assert!(
            some.warnings.len() == 1 && some.warnings[0].contains('a'),
            "{format:?}: {:?}",
            some.warnings
        );
        let error = import(dir.path(), format, &["c.jpg"], &tree())
            .unwrap_err()
            .to_string();
        assert!(error.contains("'c.jpg'"), "{format:?}: {error}");
    }
}

#[test]
fn unwritable_folder_is_named_in_the_error() {
    let dir = tempfile::tempdir().unwrap();
    let taken = dir.path().join("taken");
    std::fs::write(&taken, "a file").unwrap();
    for format in MaskFormat::ALL {
        let error = export(&taken, format, &["a.png"], &[(0, mask([1]))])
            .unwrap_err()
            .to_string();
        assert!(error.contains("taken"), "{format:?}: {error}");
        assert_eq!(
            std::fs::read_dir(dir.path()).unwrap().count(),
            1,
            "nothing is left behind"
        );
    }
}

#[test]
fn import_and_export_can_be_stopped() {
    let dir = tempfile::tempdir().unwrap();
    let stopped = Progress::default();
    stopped.stop();
    let masks = [(0, mask([1]))];
    for format in MaskFormat::ALL {
        let frames = frames(&["a.png"]);
        let error = format
            .export_masks(dir.path(), &frames, masks.clone(), &tree(), &stopped)
            .unwrap_err();
        assert!(matches!(error, MaskError::Stopped(_)));
        assert!(matches!(
            format.import_masks(dir.path(), &frames, &tree(), &stopped),
            Err(MaskError::Stopped(_))
        ));
    }
}
