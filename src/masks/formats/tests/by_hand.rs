use super::*;

fn write(dir: &Path, name: &str, text: &str) {
    let path = dir.join(name);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, text).unwrap();
}

fn pixels(mask: &RunMask, id: u16) -> Vec<(u32, u32)> {
    let region = mask.region(LabelId(id));
    (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y))).filter(|&(x, y)| region.at(x, y)).collect()
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
    write(dir.path(), "_annotations.coco.json", &COCO.replace("ANNOTATIONS", annotations));
    import(dir.path(), MaskFormat::Coco, &["a.jpg", "b.jpg"], &LabelTree::default())
}

#[test]
fn coco_as_other_tools_write_it() {
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
    assert_eq!(tree.iter().count(), 4, "categories without annotations stay out");
    let mask = &read.masks[&0];
    assert_eq!(pixels(mask, id("grain").0), [(1, 1)], "the deeper label wins");
    assert_eq!(pixels(mask, id("leaf").0), [(2, 1), (3, 1), (1, 2), (2, 2), (3, 2), (8, 8)]);
    assert_eq!(pixels(mask, id("stone").0), [(12, 8)]);
    assert_eq!(read.masks.len(), 1);
    assert!(read.warnings.iter().any(|warning| warning.starts_with("1 pictures have no outlines")));
    assert!(read.warnings.iter().any(|warning| warning.starts_with("2 annotations have no outline")));
}

#[test]
fn broken_coco_is_told() {
    for (annotations, part) in [
        (r#"[{"id": 3, "image_id": 7, "category_id": 1, "segmentation": [[1,1,2,2,3,3]]}]"#, "annotation 3"),
        (r#"[{"id": 3, "image_id": 7, "category_id": 0, "segmentation": [[1,1,2,2,3]]}]"#, "5 numbers"),
        (r#"[{"id": 3, "image_id": 7, "category_id": 0, "segmentation": {"size":[9,13],"counts":[1,2]}}]"#, "add up"),
        (r#"[{"id": 3, "image_id": 7, "category_id": 0, "segmentation": {"size":[9,12],"counts":[108]}}]"#, "12×9"),
        (r#"[{"id": 3, "image_id": 7, "category_id": 0, "segmentation": {"size":[9,13],"counts":"!"}}]"#, "damaged"),
        (r#"[{"id": 3, "image_id": 7, "category_id": 0, "segmentation": 5}]"#, "no COCO JSON"),
        ("[", "no COCO JSON"),
    ] {
        let error = coco(annotations).unwrap_err().to_string();
        assert!(error.contains(part) && error.contains("_annotations.coco.json"), "{error}");
    }
}

#[test]
fn a_circle_of_supercategories_ends() {
    let dir = tempfile::tempdir().unwrap();
    let text = r#"{"images":[{"id":1,"file_name":"a.jpg","width":13,"height":9}],
        "categories":[{"id":1,"name":"x","supercategory":"y"},{"id":2,"name":"y","supercategory":"x"}],
        "annotations":[{"image_id":1,"category_id":1,"segmentation":[[0,0,2,0,2,2]]}]}"#;
    write(dir.path(), "c.json", text);
    let read = import(&dir.path().join("c.json"), MaskFormat::Coco, &["a.jpg"], &LabelTree::default()).unwrap();
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
fn yolo_as_other_tools_write_it() {
    let text = "1 0 0 0.5 0 0.5 1 0 1\n0 0.9 0.9 0.2 0.2\n\n2 0.23 0.33 0.31 0.33 0.31 0.45 0.23 0.45\n";
    let read = yolo(text, Some("names: [pot, rice, 'stem 1']"), &tree()).unwrap();
    assert!(read.new_labels.is_empty());
    assert_eq!(pixels(&read.masks[&0], 2), [(3, 3)], "a part lies above its whole");
    assert_eq!(pixels(&read.masks[&0], 1).len(), 6 * 9 - 1, "the side through the centres of column 6 ends before it");
    assert_eq!(read.warnings, ["1 lines hold boxes, no outlines, and were left out"]);
    let unnamed = yolo(text, None, &tree()).unwrap();
    assert_eq!(pixels(&unnamed.masks[&0], 3), [(3, 3)], "class 2 without names is label 3");
    assert_eq!(yolo("", None, &tree()).unwrap().masks[&0], mask([]));
}

#[test]
fn broken_yolo_is_told_by_its_line() {
    for text in [
        "1 0 0 0.5 0 0.5",
        "1 0 0 0.5 0 0.5 1 0",
        "x 0 0 0.5 0 0.5 1",
        "-1 0 0 0.5 0 0.5 1",
        "1 0 0 500 0 0.5 1",
        "1 0 0 nan 0 0.5 1",
        "1 0 0 a 0 0.5 1",
        "18446744073709551615 0 0 0.5 0 0.5 1",
    ] {
        let error = yolo(&format!("0 0 0 1 0 1 1\n{text}"), None, &tree()).unwrap_err().to_string();
        assert!(error.contains("a.txt") && error.contains("line 2"), "{text}: {error}");
    }
    assert!(yolo("70000 0 0 1 0 1 1", None, &tree()).unwrap_err().to_string().contains("70000"));
}

#[test]
fn holes_are_kept_in_one_line() {
    let dir = tempfile::tempdir().unwrap();
    let ring = mask((0..5).flat_map(|y| (0..WIDTH).map(move |x| u16::from(x < 5 && !(x == 2 && y == 2)))));
    export(dir.path(), MaskFormat::Yolo, &["a.jpg"], &[(0, ring)]).unwrap();
    let text = std::fs::read_to_string(dir.path().join("labels/a.txt")).unwrap();
    assert_eq!(text.lines().count(), 1);
    let yaml = std::fs::read_to_string(dir.path().join("data.yaml")).unwrap();
    assert!(yaml.contains("  0: 'rice'\n  1: 'stem 1'\n  2: 'panicle: ''A/B'', #1'\n"), "{yaml}");
}

#[test]
fn binary_folders_by_name_then_by_number() {
    let dir = tempfile::tempdir().unwrap();
    let white = |folder: &str, at: usize, value: u8| {
        let path = dir.path().join(folder).join("a.png");
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        let mut encoder = png::Encoder::new(std::fs::File::create(path).unwrap(), WIDTH, HEIGHT);
        encoder.set_color(png::ColorType::Grayscale);
        let mut bytes = vec![0; (WIDTH * HEIGHT) as usize];
        (bytes[at], bytes[100]) = (value, value);
        encoder.write_header().unwrap().write_image_data(&bytes).unwrap();
    };
    white("rice", 0, 255);
    white("002", 1, 1);
    white("weed", 2, 200);
    let read = import(dir.path(), MaskFormat::Binary, &["a.jpg"], &tree()).unwrap();
    assert_eq!(read.new_labels.len(), 1);
    assert_eq!((read.new_labels[0].id, read.new_labels[0].name.as_str()), (LabelId(10), "weed"));
    let mask = &read.masks[&0];
    assert_eq!([0, 1, 2].map(|at| mask.decode().ids[at].0), [1, 2, 10]);
    assert_eq!(pixels(mask, 2).len(), 2, "the part keeps the pixel that its whole and the weed claim");
    assert_eq!(read.warnings.len(), 1, "{:?}", read.warnings);
    white(".", 0, 255);
    let error = import(dir.path(), MaskFormat::Binary, &["a.jpg"], &tree()).unwrap_err().to_string();
    assert!(error.contains("LABEL/FRAME.png"), "{error}");
}

#[test]
fn binary_folders_have_names_that_every_system_takes() {
    let dir = tempfile::tempdir().unwrap();
    export(dir.path(), MaskFormat::Binary, &["cam/a.jpg"], &[(0, mask([1, 3]))]).unwrap();
    assert!(dir.path().join("panicle_ 'A_B', #1/cam/a.png").is_file());
    assert!(dir.path().join("rice/cam/a.png").is_file());
    assert!(!dir.path().join("pot").exists(), "a label that is nowhere has no folder");
}

#[test]
fn formats_are_known_by_name() {
    for format in MaskFormat::ALL {
        assert_eq!(format.name().parse::<MaskFormat>().unwrap(), format);
        assert_eq!(serde_json::to_string(&format).unwrap(), format!("\"{}\"", format.name()));
    }
    assert!("tiff".parse::<MaskFormat>().unwrap_err().to_string().contains("davis, binary, coco or yolo"));
}
