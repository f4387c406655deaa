mod binary;
mod coco_images;

use super::*;

fn write(dir: &Path, name: &str, text: &str) {
    let path = dir.join(name);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, text).unwrap();
}

fn pixels(mask: &RunMask, id: u16) -> Vec<(u32, u32)> {
    let region = mask.region(LabelId(id));
    (0..HEIGHT)
        .flat_map(|y| (0..WIDTH).map(move |x| (x, y)))
        .filter(|&(x, y)| region.at(x, y))
        .collect()
}

const COCO: &str = r#"{
    "info": {"year": 2026},
    "images": [{"id": 7, "file_name": "images\\a.jpg", "width": 13, "height": 9},
               {"id": 8, "file_name": "b.jpg", "width": 13, "height": 9}],
    "categories": [{"id": 0, "name": "leaf", "supercategory": "plant"},
                   {"id": 5, "name": "grain", "supercategory": "leaf"},
                   {"id": 6, "name": "stone", "supercategory": "none"},
                   {"id": 90000, "name": "unused", "supercategory": "animal"}],
    "annotations": ANNOTATIONS
}"#;

fn coco(annotations: &str) -> Result<Imported, MaskError> {
    let dir = tempfile::tempdir().unwrap();
    write(
        dir.path(),
        "_annotations.coco.json",
        &COCO.replace("ANNOTATIONS", annotations),
    );
    import(
        dir.path(),
        MaskFormat::Coco,
        &["a.jpg", "b.jpg"],
        &LabelTree::default(),
    )
}

fn coco_file(
    images: &str,
    categories: &str,
    annotations: &str,
    tree: &LabelTree,
) -> Result<Imported, MaskError> {
    let dir = tempfile::tempdir().unwrap();
    let text = format!(
        r#"{{"images": {images}, "categories": {categories}, "annotations": {annotations}}}"#
    );
    write(dir.path(), "c.json", &format!("\u{feff}{text}"));
    import(dir.path(), MaskFormat::Coco, &["a.jpg", "b.jpg"], tree)
}

#[test]
fn coco_of_other_tools_is_read() {
    let read = coco(
        r#"[{"id": 1, "image_id": 7, "category_id": 0, "segmentation": [[1, 1, 4, 1, 4, 3, 1, 3], [8, 8, 9, 8, 9, 9, 8, 9]]},
            {"id": 2, "image_id": 7, "category_id": 5, "segmentation": {"size": [9, 13], "counts": [10, 1, 106]}},
            {"id": 3, "image_id": 7, "category_id": 6, "iscrowd": 1, "segmentation": {"size": [9, 13], "counts": "d31"}},
            {"id": 4, "image_id": 7, "category_id": 0, "bbox": [0, 0, 5, 5], "segmentation": []},
            {"id": 6, "image_id": 8, "category_id": 0, "bbox": [0, 0, 5, 5]},
            {"id": 5, "image_id": 99, "category_id": 0, "segmentation": []}]"#,
    );
    let read = read.unwrap();
    let tree = LabelTree::try_from(read.new_labels).unwrap();
    let id = |name: &str| tree.by_name(name).unwrap().id;
    assert_eq!(tree.name_path(id("grain")), "plant › leaf › grain");
    assert_eq!(tree.name_path(id("stone")), "stone");
    assert_eq!(
        tree.iter().count(),
        4,
        "categories without annotations stay out"
    );
    let mask = &read.masks[&0];
    assert_eq!(
        pixels(mask, id("grain").0),
        [(1, 1)],
        "the deeper label wins"
    );
    assert_eq!(
        pixels(mask, id("leaf").0),
        [(2, 1), (3, 1), (1, 2), (2, 2), (3, 2), (8, 8)]
    );
    assert_eq!(pixels(mask, id("stone").0), [(12, 8)]);
    assert_eq!(read.masks.len(), 1);
    assert!(
        read.warnings
            .iter()
            .any(|warning| warning.starts_with("1 images have no outlines"))
    );
    assert!(
        read.warnings
            .iter()
            .any(|warning| warning.starts_with("2 annotations have no outline"))
    );
}

#[test]
fn unusable_coco_files_are_errors() {
    for (annotations, part) in [
        (
            r#"[{"id": 3, "image_id": 7, "category_id": 1, "segmentation": [[1,1,2,2,3,3]]}]"#,
            "annotation 3",
        ),
        (
            r#"[{"id": 3, "image_id": 7, "category_id": 0, "segmentation": [[1,1,2,2,3]]}]"#,
            "x but no y",
        ),
        (
            r#"[{"id": 3, "image_id": 7, "category_id": 0, "segmentation": {"size":[9,13],"counts":[1,2]}}]"#,
            "damaged or do not fit",
        ),
        (
            r#"[{"id": 3, "image_id": 7, "category_id": 0, "segmentation": {"size":[9,12],"counts":[108]}}]"#,
            "damaged or do not fit",
        ),
        (
            r#"[{"id": 3, "image_id": 7, "category_id": 0, "segmentation": {"size":[9,13],"counts":"!"}}]"#,
            "damaged or do not fit",
        ),
        (
            r#"[{"id": 3, "image_id": 7, "category_id": 0, "segmentation": 5}]"#,
            "neither polygons",
        ),
        ("[", "not a COCO JSON file"),
    ] {
        let error = coco(annotations).unwrap_err().to_string();
        assert!(
            error.contains(part) && error.contains("_annotations.coco.json"),
            "{error}"
        );
    }
}

#[test]
fn cyclic_supercategories_are_read() {
    let dir = tempfile::tempdir().unwrap();
    let text = r#"{"images":[{"id":1,"file_name":"a.jpg","width":13,"height":9}],
        "categories":[{"id":1,"name":"x","supercategory":"y"},{"id":2,"name":"y","supercategory":"x"}],
        "annotations":[{"image_id":1,"category_id":1,"segmentation":[[0,0,2,0,2,2]]}]}"#;
    write(dir.path(), "c.json", text);
    let read = import(
        &dir.path().join("c.json"),
        MaskFormat::Coco,
        &["a.jpg"],
        &LabelTree::default(),
    )
    .unwrap();
    assert_eq!(read.new_labels.len(), 2);
}

fn yolo(text: &str, names: Option<&str>, tree: &LabelTree) -> Result<Imported, MaskError> {
    let dir = tempfile::tempdir().unwrap();
    write(dir.path(), "labels/train/a.txt", text);
    if let Some(names) = names {
        write(dir.path(), "data.yaml", names);
    }
    import(dir.path(), MaskFormat::Yolo, &["a.jpg"], tree)
}

#[test]
fn yolo_of_other_tools_is_read() {
    let text =
        "1 0 0 0.5 0 0.5 1 0 1\n0 0.9 0.9 0.2 0.2\n\n2 0.23 0.33 0.31 0.33 0.31 0.45 0.23 0.45\n";
    let read = yolo(text, Some("names: [pot, rice, 'stem 1']"), &tree()).unwrap();
    assert!(read.new_labels.is_empty());
    assert_eq!(
        pixels(&read.masks[&0], 2),
        [(3, 3)],
        "a part lies above its whole"
    );
    assert_eq!(
        pixels(&read.masks[&0], 1).len(),
        6 * 9 - 1,
        "the side through the centres of column 6 ends before it"
    );
    assert_eq!(
        read.warnings,
        ["1 lines hold boxes, no outlines, and were left out"]
    );
    let unnamed = yolo(text, None, &tree()).unwrap();
    assert_eq!(
        pixels(&unnamed.masks[&0], 3),
        [(3, 3)],
        "class 2 without names is label 3"
    );
    assert_eq!(yolo("", None, &tree()).unwrap().masks[&0], mask([]));
}

#[test]
fn invalid_yolo_lines_are_skipped_with_a_warning() {
    for text in [
        "x 0 0 0.5 0 0.5 1",
        "-1 0 0 0.5 0 0.5 1",
        "1 0 0 500 0 0.5 1",
        "1 0 0 a 0 0.5 1",
        "18446744073709551615 0 0 0.5 0 0.5 1",
    ] {
        let read = yolo(&format!("0 0 0 1 0 1 1\n{text}"), None, &tree()).unwrap();
        assert!(!pixels(&read.masks[&0], 1).is_empty());
        assert!(
            read.warnings
                .iter()
                .any(|warning| warning.contains("'train/a', line 2")),
            "{:?}",
            read.warnings
        );
        let error = yolo(text, None, &tree()).unwrap_err().to_string();
        assert!(
            error.contains("no outline can be used") && error.contains("line 1"),
            "{text}: {error}"
        );
    }
    assert!(
        yolo("70000 0 0 1 0 1 1", None, &tree())
            .unwrap_err()
            .to_string()
            .contains("70000")
    );
}

#[test]
fn invalid_yolo_outline_does_not_affect_others() {
    let good = "0 0 0 1 0 1 1";
    for (line, what) in [
        ("1 0 0 0.5 0", "boxes"),
        ("1 0.5 0.5 0.1 0.1 0.9", "boxes"),
        ("1 0 0", "fewer than three corners"),
        ("1 0 0 nan 0 0.5 1", "not a number"),
        ("1 0 0 0.5 0 inf 1", "not a number"),
        ("1.0\t0 0 5e-1 0 0.5 1 0.93 ", "confidence"),
    ] {
        let read = yolo(
            &format!("{good}\r\n{line}\r\n"),
            Some("names: [rice, pot]"),
            &tree(),
        )
        .unwrap();
        assert!(!pixels(&read.masks[&0], 1).is_empty());
        assert!(
            read.warnings.iter().any(|warning| warning.contains(what)),
            "{line}: {:?}",
            read.warnings
        );
        assert_eq!(
            pixels(&read.masks[&0], 9).is_empty(),
            what != "confidence",
            "{line}"
        );
    }
    let error = yolo("1 0.5 0.5 0.1 0.1", Some("names: [rice, pot]"), &tree())
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("no outline can be used") && error.contains("boxes"),
        "{error}"
    );
    assert!(
        yolo("0 0 0 1 0 1 1", None, &tree()).unwrap().warnings[0]
            .contains("no class names were found")
    );
    let above = yolo("7 0 0 1 0 1 1", Some("names: [rice, pot]"), &tree()).unwrap();
    assert!(
        above.warnings[0].contains("1 classes have no name"),
        "{:?}",
        above.warnings
    );
}

#[test]
fn unreadable_yolo_file_does_not_affect_others() {
    let dir = tempfile::tempdir().unwrap();
    write(dir.path(), "a.txt", "0 0 0 1 0 1 1");
    std::fs::write(dir.path().join("b.txt"), b"0 \xff").unwrap();
    let read = |names: &[&str]| import(dir.path(), MaskFormat::Yolo, names, &LabelTree::default());
    let both = read(&["a.jpg", "b.jpg"]).unwrap();
    assert_eq!(both.masks.len(), 1);
    assert!(
        both.warnings
            .iter()
            .any(|warning| warning.contains("b.txt")),
        "{:?}",
        both.warnings
    );
    assert!(read(&["b.jpg"]).unwrap_err().to_string().contains("b.txt"));
}

#[test]
fn coco_image_of_another_size_does_not_affect_others() {
    let categories = r#"[{"id": 0, "name": "leaf"}]"#;
    let annotations = r#"[{"image_id": 1, "category_id": 0, "segmentation": [[0, 0, 2, 0, 2, 2, 0, 2]]},
                          {"image_id": 2, "category_id": 0, "segmentation": [[4, 0, 6, 0, 6, 2, 4, 2]]}]"#;
    let images = |other: &str| {
        format!(
            r#"[{{"id": 1, "file_name": "a.jpg", "width": 9, "height": 13}}, {{"id": 2, "file_name": "b.jpg"{other}}}]"#
        )
    };
    let read = coco_file(&images(""), categories, annotations, &LabelTree::default()).unwrap();
    assert_eq!(read.masks.keys().copied().collect::<Vec<_>>(), [1]);
    let what = "1 images have another size than their frame and were left out (the image 'a.jpg' is 9×13 pixels";
    assert!(
        read.warnings
            .iter()
            .any(|warning| warning.starts_with(what)),
        "{:?}",
        read.warnings
    );
    let none = coco_file(
        &images(r#", "width": 1, "height": 1"#),
        categories,
        annotations,
        &LabelTree::default(),
    );
    let error = none.unwrap_err().to_string();
    assert!(error.contains("'a.jpg' is 9×13 pixels"), "{error}");
}

#[test]
fn invalid_coco_annotation_does_not_affect_others() {
    let good =
        r#"{"id": 1, "image_id": 7, "category_id": 0, "segmentation": [[1, 1, 4, 1, 4, 3, 1, 3]]}"#;
    for (segmentation, what) in [
        (
            "[[1, 1]]",
            "1 polygons of fewer than three corners were left out (annotation 2)",
        ),
        (
            "[[5, 5, 9, 5, 9, 8], [1, 1, 2, 2]]",
            "fewer than three corners",
        ),
        ("[[]]", "fewer than three corners"),
        ("[[5, 5, 9, 5, 9]]", "x but no y"),
        ("[[5, 5, NaN, 5, 9, 8]]", "not a number"),
        ("[[5, 5, 1e300, 5, 9, 8]]", "not a number or far outside"),
        ("[[50, 50, 90, 50, 90, 80]]", "cover no pixel"),
        (
            r#"{"size": [9, 13], "counts": [1, 2]}"#,
            "damaged or do not fit",
        ),
        (
            r#"{"size": [13, 9], "counts": [117]}"#,
            "damaged or do not fit",
        ),
        (
            r#"{"size": [9, 13], "counts": "!"}"#,
            "damaged or do not fit",
        ),
        (r#"{}"#, "neither polygons nor run lengths"),
        (r#""""#, "neither polygons nor run lengths"),
        ("null", "no outline"),
    ] {
        let bad = format!(
            r#"{{"id": 2, "image_id": 7, "category_id": 6, "segmentation": {segmentation}}}"#
        );
        let read = coco(&format!("[{bad}, {good}]")).unwrap();
        assert_eq!(read.masks.len(), 1);
        assert!(
            read.warnings.iter().any(|warning| warning.contains(what)),
            "{segmentation}: {:?}",
            read.warnings
        );
    }
    for (bad, what) in [
        (
            r#"{"id": 2, "image_id": 7, "category_id": 44, "segmentation": [[1, 1, 2, 2, 3, 3]]}"#,
            "category 44",
        ),
        (
            r#"{"id": 2, "image_id": 12, "category_id": 0, "segmentation": [[1, 1, 2, 2, 3, 3]]}"#,
            "image that is not listed",
        ),
        (
            r#"{"id": 2, "category_id": 0, "segmentation": [[1, 1, 2, 2, 3, 3]]}"#,
            "without image or category",
        ),
        (r#"5"#, "without image or category"),
    ] {
        let read = coco(&format!("[{good}, {bad}]")).unwrap();
        assert!(
            read.warnings.iter().any(|warning| warning.contains(what)),
            "{bad}: {:?}",
            read.warnings
        );
    }
}

#[test]
fn coco_values_of_other_types_are_accepted() {
    let good = r#""image_id": "7", "category_id": "6", "segmentation": [[1, 1, 4, 1, 4, 3, 1, 3]]"#;
    for more in [
        r#""id": "3fa85f64-5717", "iscrowd": false"#,
        r#""id": null, "iscrowd": null, "area": null, "bbox": null"#,
        r##""id": 1.0, "iscrowd": true, "area": "12", "bbox": [], "score": NaN, "color": "#a60f2f""##,
        r#""area": Infinity, "bbox": [NaN, -Infinity, 1, 2]"#,
    ] {
        let read = coco(&format!("[{{{more}, {good}}}]")).unwrap();
        assert_eq!(
            read.masks[&0]
                .extents()
                .values()
                .map(|extent| extent.area)
                .sum::<u64>(),
            6,
            "{more}"
        );
        assert_eq!(
            read.warnings,
            ["1 images have no outlines and got no mask"],
            "{more}"
        );
    }
    let flat = r#"[{"image_id": 7, "category_id": 6, "segmentation": [1, 1, 4, 1, 4, 3, 1, 3]}]"#;
    assert_eq!(coco(flat).unwrap().masks.len(), 1);
}

#[test]
fn yolo_export_writes_region_with_holes_as_one_line() {
    let dir = tempfile::tempdir().unwrap();
    let ring =
        mask((0..5).flat_map(|y| (0..WIDTH).map(move |x| u16::from(x < 5 && !(x == 2 && y == 2)))));
    export(dir.path(), MaskFormat::Yolo, &["a.jpg"], &[(0, ring)]).unwrap();
    let text = std::fs::read_to_string(dir.path().join("labels/a.txt")).unwrap();
    assert_eq!(text.lines().count(), 1);
    let yaml = std::fs::read_to_string(dir.path().join("data.yaml")).unwrap();
    assert!(
        yaml.contains("  0: 'rice'\n  1: 'stem 1'\n  2: 'panicle: ''A/B'', #1'\n"),
        "{yaml}"
    );
}
