//! Fuzz targets for masks and label lists of every format.

use ostra_core::job::Progress;
use ostra_masks::{LabelTree, MaskFormat, MaskFrame, read_labels_json, read_palette_png};

use crate::harness::{Seed, fuzz};
use crate::seeds;

const FRAMES: [MaskFrame<'static>; 2] = [
    MaskFrame {
        name: "0.png",
        width: 16,
        height: 12,
    },
    MaskFrame {
        name: "1.png",
        width: 16,
        height: 12,
    },
];

fn fuzz_format(format: MaskFormat, iterations: usize, seeds: &[Seed]) {
    fuzz!(
        &format!("masks, {}", format.name()),
        iterations,
        seeds.to_vec(),
        |folder, _| {
            let imported =
                format.import_masks(folder, &FRAMES, &LabelTree::default(), &Progress::default());
            for (frame, mask) in imported.into_iter().flat_map(|imported| imported.masks) {
                assert!(frame < FRAMES.len());
                assert_eq!((mask.width, mask.height), (16, 12));
            }
        }
    );
}

#[test]
fn davis() {
    fuzz_format(MaskFormat::Davis, 10_000, &seeds::mask_pngs());
}

#[test]
fn binary() {
    fuzz_format(MaskFormat::Binary, 10_000, &seeds::binary_masks());
}

#[test]
fn coco() {
    fuzz_format(MaskFormat::Coco, 10_000, &seeds::coco());
}

#[test]
fn yolo() {
    fuzz_format(MaskFormat::Yolo, 10_000, &seeds::yolo());
}

#[test]
fn palette_png() {
    fuzz!("palette PNG", 10_000, seeds::mask_pngs(), |folder, seed| {
        let _ = read_palette_png(&folder.join(&seed.path));
    });
}

#[test]
fn labels_json() {
    fuzz!(
        "labels.json",
        10_000,
        [Seed::new("labels.json", seeds::LABELS_JSON)],
        |folder, _| {
            let _ = read_labels_json(folder);
        }
    );
}
