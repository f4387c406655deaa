//! PNG masks with palettes, transparency, and greys.

use super::*;

/// Writes a PNG of two rows and five columns with a palette and its transparency.
fn write_places(path: &Path, palette: &[[u8; 3]], alpha: Option<&[u8]>, places: [u8; 10]) {
    let mut encoder = png::Encoder::new(std::fs::File::create(path).unwrap(), 5, 2);
    encoder.set_color(ColorType::Indexed);
    encoder.set_palette(palette.concat());
    if let Some(alpha) = alpha {
        encoder.set_trns(alpha.to_vec());
    }
    encoder
        .write_header()
        .unwrap()
        .write_image_data(&places)
        .unwrap();
}

fn read_small(dir: &Path, names: &[&str]) -> Imported {
    let frames: Vec<MaskFrame<'_>> = names
        .iter()
        .map(|name| MaskFrame {
            name,
            width: 5,
            height: 2,
        })
        .collect();
    MaskFormat::Davis
        .import_masks(dir, &frames, &LabelTree::default(), &Progress::default())
        .unwrap()
}

fn ids_of(read: &Imported, frame: usize) -> Vec<u16> {
    read.masks[&frame]
        .decode()
        .ids
        .iter()
        .map(|id| id.0)
        .collect()
}

#[test]
fn transparent_palette_entries_and_colors_are_applied() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.png");
    let places = [0, 1, 2, 3, 4, 5, 0, 5, 5, 0];
    let (soft, half) = ([0, 50, 100, 150, 200, 255], [0, 0, 0, 1, 1, 1, 0, 1, 1, 0]);
    for color in [255, 0] {
        write_places(&path, &[[color; 3]; 6], Some(&soft), places);
        let read = read_small(dir.path(), &["a.jpg"]);
        assert_eq!(ids_of(&read, 0), half, "soft cut-out in colour {color}");
        assert!(read.warnings[0].contains("cut-outs"), "{:?}", read.warnings);
    }
    let colors = [
        [0; 3],
        [200, 0, 0],
        [0, 200, 0],
        [0, 0, 200],
        [9, 9, 0],
        [7; 3],
    ];
    write_places(&path, &colors, Some(&[0]), places);
    let read = read_small(dir.path(), &["a.jpg"]);
    assert_eq!(
        (ids_of(&read, 0), read.warnings.len()),
        (places.map(u16::from).to_vec(), 0),
        "places are ids"
    );

    let mut encoder = png::Encoder::new(std::fs::File::create(&path).unwrap(), 5, 2);
    encoder.set_color(ColorType::Grayscale);
    encoder.set_trns(vec![0, 9]);
    encoder
        .write_header()
        .unwrap()
        .write_image_data(&[9, 9, 1, 2, 9, 0, 1, 2, 0, 9])
        .unwrap();
    let read = read_small(dir.path(), &["a.jpg"]);
    assert_eq!(ids_of(&read, 0), [0, 0, 1, 2, 0, 0, 1, 2, 0, 0]);
    assert!(
        read.warnings[0].contains("transparent pixels"),
        "{:?}",
        read.warnings
    );
}

#[test]
fn black_cut_outs_are_objects_unless_other_masks_have_labels() {
    let dir = tempfile::tempdir().unwrap();
    let alpha = [0, 0, 255, 255, 100, 0, 0, 255, 255, 0];
    let black: Vec<u8> = alpha.iter().flat_map(|&alpha| [0, 0, 0, alpha]).collect();
    write_png(
        &dir.path().join("a.png"),
        ColorType::Rgba,
        BitDepth::Eight,
        &black,
    );
    write_png(
        &dir.path().join("b.png"),
        ColorType::Rgba,
        BitDepth::Eight,
        &[0; 40],
    );
    let read = read_small(dir.path(), &["a.jpg", "b.jpg"]);
    assert_eq!(ids_of(&read, 0), [0, 0, 1, 1, 0, 0, 0, 1, 1, 0]);
    assert_eq!(ids_of(&read, 1), [0; 10], "the object is not in this frame");
    assert!(
        read.warnings[0].contains("1 masks are cut-outs"),
        "{:?}",
        read.warnings
    );
    write_png(
        &dir.path().join("b.png"),
        ColorType::Grayscale,
        BitDepth::Eight,
        &[3; 10],
    );
    let read = read_small(dir.path(), &["a.jpg", "b.jpg"]);
    assert_eq!(
        (ids_of(&read, 0), ids_of(&read, 1)),
        (vec![0; 10], vec![3; 10]),
        "black is the background here"
    );
}

#[test]
fn cut_outs_may_be_fully_opaque_or_fully_transparent() {
    let dir = tempfile::tempdir().unwrap();
    let white = |alpha: &dyn Fn(usize) -> u8| -> Vec<u8> {
        (0..10).flat_map(|at| [255, alpha(at)]).collect()
    };
    for (name, bytes) in [
        ("a", white(&|at| at as u8 / 5 * 255)),
        ("b", white(&|_| 0)),
        ("c", white(&|_| 255)),
    ] {
        let path = dir.path().join(format!("{name}.png"));
        write_png(&path, ColorType::GrayscaleAlpha, BitDepth::Eight, &bytes);
    }
    let read = read_small(dir.path(), &["a.jpg", "b.jpg", "c.jpg"]);
    assert_eq!(ids_of(&read, 0), [0, 0, 0, 0, 0, 1, 1, 1, 1, 1]);
    assert_eq!(
        (ids_of(&read, 1), ids_of(&read, 2)),
        (vec![0; 10], vec![1; 10])
    );
}

#[test]
fn whole_palette_decides_how_greys_are_read() {
    let dir = tempfile::tempdir().unwrap();
    let [black, white] = [[0; 3], [255; 3]];
    write_places(
        &dir.path().join("a.png"),
        &[white, black],
        None,
        [1, 1, 0, 0, 1, 1, 1, 0, 0, 1],
    );
    write_places(&dir.path().join("b.png"), &[white, black], None, [1; 10]);
    write_places(
        &dir.path().join("c.png"),
        &[black, white],
        None,
        [0, 0, 1, 1, 0, 0, 0, 1, 1, 0],
    );
    let read = read_small(dir.path(), &["a.jpg", "b.jpg", "c.jpg"]);
    assert_eq!(
        (ids_of(&read, 0), ids_of(&read, 1)),
        (vec![0, 0, 1, 1, 0, 0, 0, 1, 1, 0], vec![0; 10])
    );
    assert_eq!(read.masks[&0], read.masks[&2]);
    assert!(read.warnings.is_empty(), "{:?}", read.warnings);
    write_places(
        &dir.path().join("a.png"),
        &[black, [90; 3], white],
        None,
        [1, 1, 0, 0, 1, 1, 1, 0, 0, 2],
    );
    let read = read_small(dir.path(), &["a.jpg"]);
    assert_eq!(ids_of(&read, 0), [1, 1, 0, 0, 1, 1, 1, 0, 0, 2]);
    assert!(
        read.warnings
            .iter()
            .any(|warning| warning.contains("palette of greys")),
        "{:?}",
        read.warnings
    );
}

#[test]
fn masks_with_black_and_white_labels_round_trip() {
    let label = |id: u16, color: u8| Label {
        id: LabelId(id),
        name: id.to_string(),
        color: [color; 3],
        parent: None,
    };
    let tree: LabelTree = vec![label(1, 255), label(2, 0)].try_into().unwrap();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.png");
    std::fs::write(&path, encode_palette_png(&mask([1, 2, 2]), &tree).unwrap()).unwrap();
    assert_eq!(
        RunMask::encode(&read_palette_png(&path).unwrap()),
        mask([1, 2, 2])
    );
}

#[test]
fn grey_colors_of_16_bits_are_ids() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.png");
    let write = |ids: [u16; 10]| {
        let bytes: Vec<u8> = ids
            .iter()
            .flat_map(|id| [id.to_be_bytes(); 3])
            .flatten()
            .collect();
        write_png(&path, ColorType::Rgb, BitDepth::Sixteen, &bytes);
    };
    let ids = [0, 0, 1, 2, 0, 0, 1, 2, 90, 90];
    write(ids);
    assert_eq!(ids_of(&read_small(dir.path(), &["a.jpg"]), 0), ids);
    write_labels_json(dir.path(), &tree()).unwrap();
    assert_eq!(read_palette_png(&path).unwrap().ids, ids.map(LabelId));
    let read = read_small(dir.path(), &["a.jpg"]);
    assert!(
        read.new_labels.iter().any(|label| label.name == "rice"),
        "ids, and not black: {read:?}"
    );
}

/// Reads a 5 × 2 PNG of these bytes as the mask of a frame.
fn read_one(color: ColorType, bytes: &[u8]) -> Result<Imported, MaskError> {
    let dir = tempfile::tempdir().unwrap();
    write_png(&dir.path().join("a.png"), color, BitDepth::Eight, bytes);
    let frames = [MaskFrame {
        name: "a.jpg",
        width: 5,
        height: 2,
    }];
    MaskFormat::Davis.import_masks(
        dir.path(),
        &frames,
        &LabelTree::default(),
        &Progress::default(),
    )
}

#[test]
fn transparency_is_a_cut_out_or_clears_ids() {
    let alpha = [0, 0, 255, 255, 100, 0, 0, 255, 255, 0];
    let rgba = |color: &dyn Fn(usize) -> [u8; 3]| -> Vec<u8> {
        alpha
            .iter()
            .enumerate()
            .flat_map(|(at, &alpha)| color(at).into_iter().chain([alpha]))
            .collect()
    };
    let ids = |read: &Imported| {
        read.masks[&0]
            .decode()
            .ids
            .iter()
            .map(|id| id.0)
            .collect::<Vec<_>>()
    };
    let read = read_one(ColorType::Rgba, &rgba(&|_| [255; 3])).unwrap();
    assert_eq!(ids(&read), [0, 0, 1, 1, 0, 0, 0, 1, 1, 0]);
    assert!(read.warnings[0].contains("cut-outs"), "{:?}", read.warnings);
    let grey: Vec<u8> = alpha.iter().flat_map(|&alpha| [255, alpha]).collect();
    assert_eq!(
        ids(&read_one(ColorType::GrayscaleAlpha, &grey).unwrap()),
        [0, 0, 1, 1, 0, 0, 0, 1, 1, 0]
    );
    let labelled = read_one(
        ColorType::Rgba,
        &rgba(&|at| [if at < 5 { 3 } else { 4 }; 3]),
    )
    .unwrap();
    assert_eq!(ids(&labelled), [0, 0, 3, 3, 0, 0, 0, 4, 4, 0]);
    assert!(
        labelled.warnings[0].contains("transparent pixels"),
        "{:?}",
        labelled.warnings
    );
    let colored = read_one(ColorType::Rgba, &rgba(&|at| [200, at as u8, 1]));
    assert!(
        colored.unwrap_err().to_string().contains("colour image"),
        "few colours are labels, not an image"
    );
}

#[test]
fn reordered_grey_palettes_are_read_as_greys() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.png");
    let mut encoder = png::Encoder::new(std::fs::File::create(&path).unwrap(), 5, 2);
    encoder.set_color(ColorType::Indexed);
    encoder.set_palette(vec![255, 255, 255, 0, 0, 0]);
    encoder
        .write_header()
        .unwrap()
        .write_image_data(&[1, 1, 0, 0, 1, 1, 1, 0, 0, 1])
        .unwrap();
    let frames = [MaskFrame {
        name: "a.jpg",
        width: 5,
        height: 2,
    }];
    let read = MaskFormat::Davis
        .import_masks(
            dir.path(),
            &frames,
            &LabelTree::default(),
            &Progress::default(),
        )
        .unwrap();
    assert_eq!(
        read.masks[&0].decode().ids,
        [0, 0, 1, 1, 0, 0, 0, 1, 1, 0].map(LabelId)
    );
}

#[test]
fn trimaps_are_rejected_and_other_image_types_are_named() {
    let error = read_one(
        ColorType::Grayscale,
        &[0, 0, 128, 255, 255, 0, 0, 128, 255, 255],
    )
    .unwrap_err()
    .to_string();
    assert!(error.contains("--format binary"), "{error}");
    let spread = read_one(
        ColorType::Grayscale,
        &[0, 0, 85, 170, 255, 0, 0, 85, 170, 255],
    )
    .unwrap();
    assert_eq!(spread.new_labels.len(), 3);
    assert!(
        spread.warnings[0].contains("evenly"),
        "{:?}",
        spread.warnings
    );
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("a.jpg"), "x").unwrap();
    let error = import(dir.path(), MaskFormat::Davis, &["a.jpg"], &tree())
        .unwrap_err()
        .to_string();
    assert!(error.contains("1 other images (first: a.jpg)"), "{error}");
}

#[test]
fn truncated_png_is_an_error_and_corrupt_bytes_do_not_panic() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.png");
    let whole = encode_palette_png(&mask([1, 2, 3, 3]), &tree()).unwrap();
    for length in 0..whole.len() - 12 {
        std::fs::write(&path, &whole[..length]).unwrap();
        let error = import(dir.path(), MaskFormat::Davis, &["a.png"], &tree())
            .unwrap_err()
            .to_string();
        assert!(error.contains("a.png"), "{length}: {error}");
    }
    for at in 0..whole.len() {
        let mut broken = whole.clone();
        broken[at] ^= 0x55;
        std::fs::write(&path, &broken).unwrap();
        // The result is an error, or a mask when the byte does not matter. It must not panic.
        let _ = import(dir.path(), MaskFormat::Davis, &["a.png"], &tree());
        let _ = read_palette_png(&path);
    }
    assert!(encode_palette_png(&RunMask::empty(0, 5), &tree()).is_err());
}
