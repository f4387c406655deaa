use png::{BitDepth, ColorType};

use super::*;
use crate::masks::{encode_palette_png, read_palette_png, write_labels_json};

/// A PNG of two rows and five columns from its rows' bytes.
fn write_png(path: &Path, color: ColorType, depth: BitDepth, bytes: &[u8]) {
    let file = std::fs::File::create(path).unwrap();
    let mut encoder = png::Encoder::new(file, 5, 2);
    encoder.set_color(color);
    encoder.set_depth(depth);
    if color == ColorType::Indexed {
        encoder.set_palette([9, 8, 7].repeat(1 << (depth as usize)));
    }
    encoder.write_header().unwrap().write_image_data(bytes).unwrap();
}

#[test]
fn pngs_of_every_kind_are_read_as_stored() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("m.png");
    let (zero_one, to_three, to_fifteen) =
        ([1, 0, 1, 1, 0, 0, 1, 0, 0, 1], [3, 0, 1, 2, 0, 0, 1, 0, 3, 2], [15, 0, 1, 9, 0, 0, 8, 0, 3, 2]);
    let to_byte = [255, 0, 1, 128, 7, 0, 254, 3, 3, 2];
    let high = [65535, 0, 256, 255, 7, 0, 32768, 3, 3, 2];
    let bytes = to_byte.map(|id: u16| id as u8);
    let interleaved = |channels: usize, others: u8| -> Vec<u8> {
        let pixel =
            |&id: &u8| std::iter::repeat_n(id, channels.min(3)).chain([others]).take(channels).collect::<Vec<_>>();
        bytes.iter().flat_map(pixel).collect()
    };
    let grey_alpha: Vec<u8> = bytes.iter().flat_map(|&id| [id, 77]).collect();
    let high_bytes: Vec<u8> = high.iter().flat_map(|id: &u16| id.to_be_bytes()).collect();
    let cases: [(ColorType, BitDepth, Vec<u8>, [u16; 10]); 11] = [
        (ColorType::Grayscale, BitDepth::One, vec![0b1011_0000, 0b0100_1000], zero_one),
        (ColorType::Indexed, BitDepth::One, vec![0b1011_0000, 0b0100_1000], zero_one),
        (ColorType::Grayscale, BitDepth::Two, vec![0b1100_0110, 0, 0b0001_0011, 0b1000_0000], to_three),
        (ColorType::Indexed, BitDepth::Two, vec![0b1100_0110, 0, 0b0001_0011, 0b1000_0000], to_three),
        (ColorType::Indexed, BitDepth::Four, vec![0xf0, 0x19, 0, 0x08, 0x03, 0x20], to_fifteen),
        (ColorType::Grayscale, BitDepth::Eight, bytes.to_vec(), to_byte),
        (ColorType::Indexed, BitDepth::Eight, bytes.to_vec(), to_byte),
        (ColorType::Grayscale, BitDepth::Sixteen, high_bytes, high),
        (ColorType::GrayscaleAlpha, BitDepth::Eight, grey_alpha, to_byte),
        (ColorType::Rgb, BitDepth::Eight, interleaved(3, 0), to_byte),
        (ColorType::Rgba, BitDepth::Eight, interleaved(4, 13), to_byte),
    ];
    for (color, depth, bytes, expected) in cases {
        write_png(&path, color, depth, &bytes);
        let read = read_palette_png(&path).unwrap();
        assert_eq!(read.ids, expected.map(LabelId), "{color:?} {depth:?}");
    }
}

#[test]
fn colours_need_a_list_of_labels() {
    let dir = tempfile::tempdir().unwrap();
    let frames = [MaskFrame { name: "a.jpg", width: 5, height: 2 }];
    let read = |dir: &Path| import_masks(dir, MaskFormat::Davis, &frames, &LabelTree::default(), &Progress::default());
    let [stem, rice] = [LabelId(2), LabelId(1)].map(LabelTree::color_for);
    let colors: Vec<u8> = [stem, [0; 3], rice, rice, stem].repeat(2).into_flattened();
    write_png(&dir.path().join("a.png"), ColorType::Rgb, BitDepth::Eight, &colors);
    let error = read(dir.path()).unwrap_err().to_string();
    assert!(error.contains("a.png") && error.contains("labels.json"), "{error}");
    write_labels_json(dir.path(), &tree()).unwrap();
    assert_eq!(read(dir.path()).unwrap().masks[&0].decode().ids, [2, 0, 1, 1, 2].map(LabelId).repeat(2));
    write_png(&dir.path().join("a.png"), ColorType::Rgb, BitDepth::Eight, &[200, 1, 2].repeat(10));
    let error = read(dir.path()).unwrap_err().to_string();
    assert!(error.contains("#c80102"), "{error}");
}

#[test]
fn white_means_label_one_unless_it_is_known_as_255() {
    let one = |ids: &[u16]| {
        let dir = tempfile::tempdir().unwrap();
        let names = ["a.png", "b.png"];
        let blank = LabelTree::default();
        let masks = ids.iter().map(|&id| mask([0, id])).enumerate();
        export_masks(dir.path(), MaskFormat::Davis, &frames(&names), masks, &blank, &Progress::default()).unwrap();
        std::fs::remove_file(dir.path().join("labels.json")).unwrap();
        (import(dir.path(), MaskFormat::Davis, &names, &blank).unwrap(), dir)
    };
    let labels = |imported: &Imported| imported.new_labels.iter().map(|label| label.id.0).collect::<Vec<_>>();
    let (white, dir) = one(&[255, 0]);
    assert_eq!(white.masks[&0], mask([0, 1]));
    assert_eq!(labels(&white), [1]);
    let (mixed, _dir) = one(&[255, 3]);
    assert_eq!(mixed.masks[&0], mask([]), "void next to smaller ids");
    assert_eq!(labels(&mixed), [3]);
    assert!(mixed.warnings[0].starts_with("1 pixels of 1 masks have the value 255"), "{:?}", mixed.warnings);
    std::fs::write(dir.path().join("labels.json"), r#"[{"id":255,"name":"last"}]"#).unwrap();
    let listed = import(dir.path(), MaskFormat::Davis, &["a.png"], &LabelTree::default()).unwrap();
    assert_eq!(labels(&listed), [255]);
}

#[test]
fn listed_names_find_the_projects_labels() {
    let dir = tempfile::tempdir().unwrap();
    export(dir.path(), MaskFormat::Davis, &["a.png"], &[(0, mask([1, 2, 4, 50]))]).unwrap();
    let label = |id: u16, name: &str| Label { id: LabelId(id), name: name.into(), color: [0; 3], parent: None };
    let project = vec![label(2, "rice"), label(1, "stone")].try_into().unwrap();
    let read = import(dir.path(), MaskFormat::Davis, &["a.png"], &project).unwrap();
    let new: BTreeMapOfNames = read.new_labels.iter().map(|label| (label.name.clone(), label.id.0)).collect();
    assert_eq!(read.masks[&0], mask([2, new["stem 1"], 4, 50]));
    assert!(new["stem 1"] > 50, "a fresh id is none of the file's: {new:?}");
    assert_eq!(new["50"], 50);
}

/// Reads one 5 × 2 PNG of these bytes as the mask of a frame.
fn read_one(color: ColorType, bytes: &[u8]) -> Result<Imported, MaskError> {
    let dir = tempfile::tempdir().unwrap();
    write_png(&dir.path().join("a.png"), color, BitDepth::Eight, bytes);
    let frames = [MaskFrame { name: "a.jpg", width: 5, height: 2 }];
    import_masks(dir.path(), MaskFormat::Davis, &frames, &LabelTree::default(), &Progress::default())
}

#[test]
fn transparency_is_a_cut_out_or_clears_ids() {
    let alpha = [0, 0, 255, 255, 100, 0, 0, 255, 255, 0];
    let rgba = |color: &dyn Fn(usize) -> [u8; 3]| -> Vec<u8> {
        alpha.iter().enumerate().flat_map(|(at, &alpha)| color(at).into_iter().chain([alpha])).collect()
    };
    let ids = |read: &Imported| read.masks[&0].decode().ids.iter().map(|id| id.0).collect::<Vec<_>>();
    let read = read_one(ColorType::Rgba, &rgba(&|_| [255; 3])).unwrap();
    assert_eq!(ids(&read), [0, 0, 1, 1, 0, 0, 0, 1, 1, 0]);
    assert!(read.warnings[0].contains("cut-outs"), "{:?}", read.warnings);
    let grey: Vec<u8> = alpha.iter().flat_map(|&alpha| [255, alpha]).collect();
    assert_eq!(ids(&read_one(ColorType::GrayscaleAlpha, &grey).unwrap()), [0, 0, 1, 1, 0, 0, 0, 1, 1, 0]);
    let labelled = read_one(ColorType::Rgba, &rgba(&|at| [if at < 5 { 3 } else { 4 }; 3])).unwrap();
    assert_eq!(ids(&labelled), [0, 0, 3, 3, 0, 0, 0, 4, 4, 0]);
    assert!(labelled.warnings[0].contains("transparent pixels"), "{:?}", labelled.warnings);
    let colored = read_one(ColorType::Rgba, &rgba(&|at| [200, at as u8, 1]));
    assert!(colored.unwrap_err().to_string().contains("colour image"), "few colours are labels, not an image");
}

#[test]
fn palettes_of_greys_in_another_order_are_read_as_greys() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.png");
    let mut encoder = png::Encoder::new(std::fs::File::create(&path).unwrap(), 5, 2);
    encoder.set_color(ColorType::Indexed);
    encoder.set_palette(vec![255, 255, 255, 0, 0, 0]);
    encoder.write_header().unwrap().write_image_data(&[1, 1, 0, 0, 1, 1, 1, 0, 0, 1]).unwrap();
    let frames = [MaskFrame { name: "a.jpg", width: 5, height: 2 }];
    let read =
        import_masks(dir.path(), MaskFormat::Davis, &frames, &LabelTree::default(), &Progress::default()).unwrap();
    assert_eq!(read.masks[&0].decode().ids, [0, 0, 1, 1, 0, 0, 0, 1, 1, 0].map(LabelId));
}

#[test]
fn trimaps_are_refused_and_other_kinds_of_images_named() {
    let error = read_one(ColorType::Grayscale, &[0, 0, 128, 255, 255, 0, 0, 128, 255, 255]).unwrap_err().to_string();
    assert!(error.contains("--format binary"), "{error}");
    let spread = read_one(ColorType::Grayscale, &[0, 0, 85, 170, 255, 0, 0, 85, 170, 255]).unwrap();
    assert_eq!(spread.new_labels.len(), 3);
    assert!(spread.warnings[0].contains("evenly"), "{:?}", spread.warnings);
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("a.jpg"), "x").unwrap();
    let error = import(dir.path(), MaskFormat::Davis, &["a.jpg"], &tree()).unwrap_err().to_string();
    assert!(error.contains("1 other images (first: a.jpg)"), "{error}");
}

type BTreeMapOfNames = std::collections::BTreeMap<String, u16>;

#[test]
fn a_damaged_picture_is_told_and_never_a_panic() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.png");
    let whole = encode_palette_png(&mask([1, 2, 3, 3]), &tree()).unwrap();
    for length in 0..whole.len() - 12 {
        std::fs::write(&path, &whole[..length]).unwrap();
        let error = import(dir.path(), MaskFormat::Davis, &["a.png"], &tree()).unwrap_err().to_string();
        assert!(error.contains("a.png"), "{length}: {error}");
    }
    for at in 0..whole.len() {
        let mut broken = whole.clone();
        broken[at] ^= 0x55;
        std::fs::write(&path, &broken).unwrap();
        // Either an error or, where the byte does not matter, a mask; what counts is to come back from it.
        let _ = import(dir.path(), MaskFormat::Davis, &["a.png"], &tree());
        let _ = read_palette_png(&path);
    }
    assert!(encode_palette_png(&RunMask::empty(0, 5), &tree()).is_err());
}
