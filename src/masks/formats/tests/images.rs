mod palettes;

use png::{BitDepth, ColorType};

use super::*;
use crate::{encode_palette_png, read_palette_png, write_labels_json};

type BTreeMapOfNames = std::collections::BTreeMap<String, u16>;

/// Writes a PNG of two rows and five columns from the bytes of its rows.
fn write_png(path: &Path, color: ColorType, depth: BitDepth, bytes: &[u8]) {
    let file = std::fs::File::create(path).unwrap();
    let mut encoder = png::Encoder::new(file, 5, 2);
    encoder.set_color(color);
    encoder.set_depth(depth);
    if color == ColorType::Indexed {
        encoder.set_palette([9, 8, 7].repeat(1 << (depth as usize)));
    }
    encoder
        .write_header()
        .unwrap()
        .write_image_data(bytes)
        .unwrap();
}

#[test]
fn png_values_of_every_color_type_are_read_as_stored() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("m.png");
    let (zero_one, to_three, to_fifteen) = (
        [1, 0, 1, 1, 0, 0, 1, 0, 0, 1],
        [3, 0, 1, 2, 0, 0, 1, 0, 3, 2],
        [15, 0, 1, 9, 0, 0, 8, 0, 3, 2],
    );
    let to_byte = [255, 0, 1, 128, 7, 0, 254, 3, 3, 2];
    let high = [65535, 0, 256, 255, 7, 0, 32768, 3, 3, 2];
    let bytes = to_byte.map(|id: u16| id as u8);
    let interleaved = |channels: usize, others: u8| -> Vec<u8> {
        let pixel = |&id: &u8| {
            std::iter::repeat_n(id, channels.min(3))
                .chain([others])
                .take(channels)
                .collect::<Vec<_>>()
        };
        bytes.iter().flat_map(pixel).collect()
    };
    let grey_alpha: Vec<u8> = bytes.iter().flat_map(|&id| [id, 77]).collect();
    let high_bytes: Vec<u8> = high.iter().flat_map(|id: &u16| id.to_be_bytes()).collect();
    let cases: [(ColorType, BitDepth, Vec<u8>, [u16; 10]); 11] = [
        (
            ColorType::Grayscale,
            BitDepth::One,
            vec![0b1011_0000, 0b0100_1000],
            zero_one,
        ),
        (
            ColorType::Indexed,
            BitDepth::One,
            vec![0b1011_0000, 0b0100_1000],
            zero_one,
        ),
        (
            ColorType::Grayscale,
            BitDepth::Two,
            vec![0b1100_0110, 0, 0b0001_0011, 0b1000_0000],
            to_three,
        ),
        (
            ColorType::Indexed,
            BitDepth::Two,
            vec![0b1100_0110, 0, 0b0001_0011, 0b1000_0000],
            to_three,
        ),
        (
            ColorType::Indexed,
            BitDepth::Four,
            vec![0xf0, 0x19, 0, 0x08, 0x03, 0x20],
            to_fifteen,
        ),
        (
            ColorType::Grayscale,
            BitDepth::Eight,
            bytes.to_vec(),
            to_byte,
        ),
        (ColorType::Indexed, BitDepth::Eight, bytes.to_vec(), to_byte),
        (ColorType::Grayscale, BitDepth::Sixteen, high_bytes, high),
        (
            ColorType::GrayscaleAlpha,
            BitDepth::Eight,
            grey_alpha,
            to_byte,
        ),
        (ColorType::Rgb, BitDepth::Eight, interleaved(3, 0), to_byte),
        (
            ColorType::Rgba,
            BitDepth::Eight,
            interleaved(4, 13),
            to_byte,
        ),
    ];
    for (color, depth, bytes, expected) in cases {
        write_png(&path, color, depth, &bytes);
        let read = read_palette_png(&path).unwrap();
        assert_eq!(read.ids, expected.map(LabelId), "{color:?} {depth:?}");
    }
}

#[test]
fn color_masks_require_listed_labels() {
    let dir = tempfile::tempdir().unwrap();
    let frames = [MaskFrame {
        name: "a.jpg",
        width: 5,
        height: 2,
    }];
    let read = |dir: &Path| {
        MaskFormat::Davis.import_masks(dir, &frames, &LabelTree::default(), &Progress::default())
    };
    let [stem, rice] = [LabelId(2), LabelId(1)].map(LabelTree::color_for);
    let colors: Vec<u8> = [stem, [0; 3], rice, rice, stem].repeat(2).into_flattened();
    write_png(
        &dir.path().join("a.png"),
        ColorType::Rgb,
        BitDepth::Eight,
        &colors,
    );
    let error = read(dir.path()).unwrap_err().to_string();
    assert!(
        error.contains("a.png") && error.contains("labels.json"),
        "{error}"
    );
    write_labels_json(dir.path(), &tree()).unwrap();
    assert_eq!(
        read(dir.path()).unwrap().masks[&0].decode().ids,
        [2, 0, 1, 1, 2].map(LabelId).repeat(2)
    );
    write_png(
        &dir.path().join("a.png"),
        ColorType::Rgb,
        BitDepth::Eight,
        &[200, 1, 2].repeat(10),
    );
    let error = read(dir.path()).unwrap_err().to_string();
    assert!(error.contains("#c80102"), "{error}");
}

#[test]
fn white_is_label_one_unless_255_is_an_id() {
    let one = |ids: &[u16; 2]| {
        let dir = tempfile::tempdir().unwrap();
        let names = ["a.png", "b.png"];
        let blank = LabelTree::default();
        let masks = [mask([ids[0], ids[1]]), mask([ids[1]])]
            .into_iter()
            .enumerate();
        MaskFormat::Davis
            .export_masks(
                dir.path(),
                &frames(&names),
                masks,
                &blank,
                &Progress::default(),
            )
            .unwrap();
        std::fs::remove_file(dir.path().join("labels.json")).unwrap();
        (
            import(dir.path(), MaskFormat::Davis, &names, &blank).unwrap(),
            dir,
        )
    };
    let labels = |imported: &Imported| {
        imported
            .new_labels
            .iter()
            .map(|label| label.id.0)
            .collect::<Vec<_>>()
    };
    let (white, dir) = one(&[255, 0]);
    assert_eq!(white.masks[&0], mask([1]));
    assert_eq!(labels(&white), [1]);
    let (mixed, _dir) = one(&[255, 3]);
    assert_eq!(mixed.masks[&0], mask([0, 3]), "void next to smaller ids");
    assert_eq!(labels(&mixed), [3]);
    assert!(
        mixed.warnings[0].starts_with("1 pixels of 1 masks have the value 255"),
        "{:?}",
        mixed.warnings
    );
    std::fs::write(
        dir.path().join("labels.json"),
        r#"[{"id":255,"name":"last"}]"#,
    )
    .unwrap();
    let listed = import(
        dir.path(),
        MaskFormat::Davis,
        &["a.png"],
        &LabelTree::default(),
    )
    .unwrap();
    assert_eq!(labels(&listed), [255]);
}

#[test]
fn listed_names_match_the_projects_labels() {
    let dir = tempfile::tempdir().unwrap();
    export(
        dir.path(),
        MaskFormat::Davis,
        &["a.png"],
        &[(0, mask([1, 2, 4, 50]))],
    )
    .unwrap();
    let label = |id: u16, name: &str| Label {
        id: LabelId(id),
        name: name.into(),
        color: [0; 3],
        parent: None,
    };
    let project = vec![label(2, "rice"), label(1, "stone")]
        .try_into()
        .unwrap();
    let read = import(dir.path(), MaskFormat::Davis, &["a.png"], &project).unwrap();
    let new: BTreeMapOfNames = read
        .new_labels
        .iter()
        .map(|label| (label.name.clone(), label.id.0))
        .collect();
    assert_eq!(read.masks[&0], mask([2, new["stem 1"], 4, 50]));
    assert!(
        new["stem 1"] > 50,
        "a fresh id is none of the file's: {new:?}"
    );
    assert_eq!(new["50"], 50);
}

/// Writes grey masks and imports them.
fn read_greys(
    files: &[&dyn Fn(u32, u32) -> u8],
    labels_json: Option<&str>,
) -> Result<Imported, MaskError> {
    let dir = tempfile::tempdir().unwrap();
    let names: Vec<String> = (0..files.len()).map(|at| format!("{at}.png")).collect();
    for (name, value) in names.iter().zip(files) {
        let image = image::GrayImage::from_fn(40, 36, |x, y| image::Luma([value(x, y)]));
        image.save(dir.path().join(name)).unwrap();
    }
    if let Some(text) = labels_json {
        std::fs::write(dir.path().join("labels.json"), text).unwrap();
    }
    let frames: Vec<MaskFrame<'_>> = names
        .iter()
        .map(|name| MaskFrame {
            name,
            width: 40,
            height: 36,
        })
        .collect();
    MaskFormat::Davis.import_masks(
        dir.path(),
        &frames,
        &LabelTree::default(),
        &Progress::default(),
    )
}

/// Returns the value of a pixel of a disc with soft edges.
fn soft_disc(x: u32, y: u32, highest: f64) -> u8 {
    let r = (f64::from(x) - 20.3).hypot(f64::from(y) - 17.6);
    (((10.0 - r) / 3.0 + 0.5).clamp(0.0, 1.0) * highest) as u8
}

#[test]
fn soft_masks_with_different_peaks_are_thresholded() {
    let read = read_greys(
        &[&|x, y| soft_disc(x, y, 255.0), &|x, y| {
            soft_disc(x, y, 240.0)
        }],
        None,
    )
    .unwrap();
    assert!(
        read.warnings[0].contains("soft edges"),
        "{:?}",
        read.warnings
    );
    assert_eq!(read.new_labels.len(), 1);
    let areas = [0, 1].map(|frame| read.masks[&frame].extents()[&LabelId(1)].area);
    assert!(areas[0].abs_diff(areas[1]) < 30, "{areas:?}");
}

#[test]
fn white_on_most_pixels_is_an_error() {
    let disc = |x: u32, y: u32| (f64::from(x) - 20.3).hypot(f64::from(y) - 17.6);
    let read = |rim: f64, inside: u8, outside: u8| {
        read_greys(
            &[&|x, y| {
                if disc(x, y) < rim {
                    inside
                } else if disc(x, y) < 11.0 {
                    outside
                } else {
                    0
                }
            }],
            None,
        )
    };
    let error = read(10.0, 255, 254).unwrap_err().to_string();
    assert!(
        error.contains("255 on more pixels") && error.contains("--format binary"),
        "{error}"
    );
    assert!(read(10.0, 254, 255).unwrap().warnings[0].contains("means void"));
}

#[test]
fn many_labels_named_after_numbers_are_reported() {
    let read = |columns: u32| read_greys(&[&|x, _| (x / (40 / columns)) as u8], None).unwrap();
    assert!(read(20).warnings.is_empty());
    let many = read(40);
    assert_eq!(many.new_labels.len(), 39);
    assert!(
        many.warnings[0].starts_with("39 labels were named after numbers (1, 2"),
        "{:?}",
        many.warnings
    );
}

#[test]
fn unlisted_values_are_rejected_as_soft_edges_or_reported() {
    let list = Some(r#"[{"id":200,"name":"leaf"}]"#);
    let error = read_greys(&[&|x, y| soft_disc(x, y, 200.0)], list)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("soft edges") && error.contains("labels.json does not list"),
        "{error}"
    );
    let read = read_greys(&[&|x, _| [0, 200, 7, 9, 11][x as usize / 8]], list).unwrap();
    assert!(
        read.warnings[0].starts_with("3 ids of the masks are not in labels.json (7, 9, 11)"),
        "{:?}",
        read.warnings
    );
    assert!(
        read_greys(&[&|x, _| [0, 200][x as usize / 20]], list)
            .unwrap()
            .warnings
            .is_empty()
    );
}

#[test]
fn unreadable_mask_does_not_affect_others() {
    let dir = tempfile::tempdir().unwrap();
    let whole = encode_palette_png(&mask([1, 2, 3, 3]), &tree()).unwrap();
    std::fs::write(dir.path().join("a.png"), &whole).unwrap();
    std::fs::write(dir.path().join("b.png"), &whole[..whole.len() / 2]).unwrap();
    std::fs::write(
        dir.path().join("c.png"),
        encode_palette_png(&RunMask::empty(3, 3), &tree()).unwrap(),
    )
    .unwrap();
    let read = import(
        dir.path(),
        MaskFormat::Davis,
        &["a.jpg", "b.jpg", "c.jpg"],
        &tree(),
    )
    .unwrap();
    assert_eq!(read.masks.keys().copied().collect::<Vec<_>>(), [0]);
    let warning = &read.warnings[0];
    assert!(
        warning.starts_with("2 files cannot be used") && warning.contains("b.png"),
        "{warning}"
    );
    let error = import(dir.path(), MaskFormat::Davis, &["b.jpg", "c.jpg"], &tree())
        .unwrap_err()
        .to_string();
    assert!(error.contains("b.png"), "{error}");
}
