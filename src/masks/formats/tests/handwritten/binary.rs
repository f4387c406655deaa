//! Import and export of folders with one black and white image per label and frame.

use super::*;

#[test]
fn binary_folders_match_labels_by_name_then_number() {
    let dir = tempfile::tempdir().unwrap();
    let white = |folder: &str, at: usize, value: u8| {
        let path = dir.path().join(folder).join("a.png");
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        let mut encoder = png::Encoder::new(std::fs::File::create(path).unwrap(), WIDTH, HEIGHT);
        encoder.set_color(png::ColorType::Grayscale);
        let mut bytes = vec![0; (WIDTH * HEIGHT) as usize];
        (bytes[at], bytes[100]) = (value, value);
        encoder
            .write_header()
            .unwrap()
            .write_image_data(&bytes)
            .unwrap();
    };
    white("rice", 0, 255);
    white("002", 1, 1);
    white("weed", 2, 200);
    let read = import(dir.path(), MaskFormat::Binary, &["a.jpg"], &tree()).unwrap();
    assert_eq!(read.new_labels.len(), 1);
    assert_eq!(
        (read.new_labels[0].id, read.new_labels[0].name.as_str()),
        (LabelId(10), "weed")
    );
    let mask = &read.masks[&0];
    assert_eq!([0, 1, 2].map(|at| mask.decode().ids[at].0), [1, 2, 10]);
    assert_eq!(
        pixels(mask, 2).len(),
        2,
        "the part keeps the pixel that its whole and the weed claim"
    );
    assert_eq!(read.warnings.len(), 1, "{:?}", read.warnings);
    white(".", 0, 255);
    let error = import(dir.path(), MaskFormat::Binary, &["a.jpg"], &tree())
        .unwrap_err()
        .to_string();
    assert!(error.contains("LABEL/FRAME.png"), "{error}");
}

/// Writes a grey image that starts with the given values.
fn write_grey(path: &Path, values: &[u8]) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    let mut encoder = png::Encoder::new(std::fs::File::create(path).unwrap(), WIDTH, HEIGHT);
    encoder.set_color(png::ColorType::Grayscale);
    let mut bytes = values.to_vec();
    bytes.resize((WIDTH * HEIGHT) as usize, 0);
    encoder
        .write_header()
        .unwrap()
        .write_image_data(&bytes)
        .unwrap();
}

#[test]
fn binary_threshold_is_half_of_the_labels_highest_value() {
    let dir = tempfile::tempdir().unwrap();
    write_grey(&dir.path().join("rice/a.png"), &[0, 127, 128, 129, 255]);
    write_grey(&dir.path().join("rice/b.png"), &[1, 0, 1, 1]);
    write_grey(&dir.path().join("pot/a.png"), &[1]);
    let read = import(dir.path(), MaskFormat::Binary, &["a.jpg", "b.jpg"], &tree()).unwrap();
    assert_eq!(
        read.masks[&0],
        mask([9, 0, 0, 1, 1]),
        "the grey of a trimap is outside, a highest value of 1 inside"
    );
    assert_eq!(read.masks[&1], mask([]), "noise is no object");
    assert!(
        read.warnings[0].contains("became empty ('rice/b')"),
        "{:?}",
        read.warnings
    );
}

#[test]
fn unreadable_binary_file_does_not_affect_others() {
    let dir = tempfile::tempdir().unwrap();
    write_grey(&dir.path().join("rice/a.png"), &[255]);
    write_grey(&dir.path().join("rice/b.png"), &[255]);
    std::fs::write(
        dir.path().join("rice/b.png"),
        &std::fs::read(dir.path().join("rice/b.png")).unwrap()[..40],
    )
    .unwrap();
    let read = import(dir.path(), MaskFormat::Binary, &["a.jpg", "b.jpg"], &tree()).unwrap();
    assert_eq!(read.masks.keys().copied().collect::<Vec<_>>(), [0]);
    assert!(
        read.warnings[0].starts_with("1 files cannot be used and were left out"),
        "{:?}",
        read.warnings
    );
    assert!(read.warnings[0].contains("b.png"), "{:?}", read.warnings);
    assert!(import(dir.path(), MaskFormat::Binary, &["b.jpg"], &tree()).is_err());
}

#[test]
fn system_folders_are_not_labels() {
    let dir = tempfile::tempdir().unwrap();
    for folder in ["rice", "@eaDir", "#recycle", "lost+found", "rice/@eaDir"] {
        write_grey(&dir.path().join(folder).join("a.png"), &[255]);
    }
    let read = import(dir.path(), MaskFormat::Binary, &["a.jpg"], &tree()).unwrap();
    assert!(
        read.new_labels.is_empty() && read.warnings.is_empty(),
        "{read:?}"
    );

    let label = Label {
        id: LabelId(1),
        name: "Recycler".into(),
        color: [1; 3],
        parent: None,
    };
    let recycler: LabelTree = vec![label].try_into().unwrap();
    let dir = tempfile::tempdir().unwrap();
    let (format, frames, one) = (MaskFormat::Binary, frames(&["a.jpg"]), mask([1]));
    format
        .export_masks(
            dir.path(),
            &frames,
            [(0, &one)],
            &recycler,
            &Progress::default(),
        )
        .unwrap();
    assert_eq!(
        import(dir.path(), format, &["a.jpg"], &recycler)
            .unwrap()
            .masks[&0],
        one,
        "a label may have such a name"
    );
}

#[test]
fn binary_folder_names_are_valid_on_every_system() {
    let dir = tempfile::tempdir().unwrap();
    export(
        dir.path(),
        MaskFormat::Binary,
        &["cam/a.jpg"],
        &[(0, mask([1, 3]))],
    )
    .unwrap();
    assert!(dir.path().join("panicle_ 'A_B', #1/cam/a.png").is_file());
    assert!(dir.path().join("rice/cam/a.png").is_file());
    assert!(
        !dir.path().join("pot").exists(),
        "a label that is nowhere has no folder"
    );
}

#[test]
fn format_names_round_trip() {
    for format in MaskFormat::ALL {
        assert_eq!(format.name().parse::<MaskFormat>().unwrap(), format);
        assert_eq!(
            serde_json::to_string(&format).unwrap(),
            format!("\"{}\"", format.name())
        );
    }
    assert!(
        "tiff"
            .parse::<MaskFormat>()
            .unwrap_err()
            .to_string()
            .contains("davis, binary, coco or yolo")
    );
}
