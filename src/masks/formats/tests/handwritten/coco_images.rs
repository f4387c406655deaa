//! COCO files with categories or images that are listed twice.

use super::*;

#[test]
fn categories_of_one_name_are_separated_by_supercategory() {
    let images = r#"[{"id": 1, "file_name": "a.jpg", "width": 13, "height": 9}]"#;
    let annotation = |category: i64, at: u32| {
        let end = at + 2;
        format!(
            r#"{{"image_id": 1, "category_id": {category}, "segmentation": [[{at}, 0, {end}, 0, {end}, 2, {at}, 2]]}}"#
        )
    };
    let both = format!("[{}, {}]", annotation(1, 0), annotation(-2, 4));
    let twins = r##"[{"id": 1, "name": "leaf", "supercategory": "rice", "color": "#010203"}, {"id": -2, "name": "leaf", "supercategory": "weed"}]"##;
    let read = coco_file(images, twins, &both, &LabelTree::default()).unwrap();
    let tree = LabelTree::try_from(read.new_labels).unwrap();
    let mut paths: Vec<String> = read.masks[&0]
        .extents()
        .keys()
        .map(|&id| tree.name_path(id))
        .collect();
    paths.sort();
    assert_eq!(paths, ["rice › leaf", "weed › leaf (weed)"]);
    assert!(
        read.warnings[0].contains("2 categories are named 'leaf'"),
        "{:?}",
        read.warnings
    );
    let again = coco_file(images, twins, &both, &tree).unwrap();
    assert!(
        again.new_labels.is_empty() && again.masks == read.masks,
        "a second import finds the same labels"
    );

    let one = r#"[{"id": 1, "name": "leaf", "supercategory": "rice"}, {"id": -2, "name": "leaf", "supercategory": "rice"}]"#;
    let merged = coco_file(images, one, &both, &LabelTree::default()).unwrap();
    assert!(
        merged.warnings[0].contains("became one label"),
        "{:?}",
        merged.warnings
    );
    let weed = r#"[{"id": -2, "name": "leaf", "supercategory": "weed"}]"#;
    let other = coco_file(images, weed, &format!("[{}]", annotation(-2, 4)), &tree).unwrap();
    let path = other.masks[&0]
        .extents()
        .keys()
        .map(|&id| tree.name_path(id))
        .collect::<Vec<_>>();
    assert!(
        other.new_labels.is_empty() && path == ["weed › leaf (weed)"],
        "{path:?}"
    );
    let top = LabelTree::try_from(vec![Label {
        id: LabelId(5),
        name: "leaf".into(),
        color: [0; 3],
        parent: None,
    }]);
    let other = coco_file(
        images,
        weed,
        &format!("[{}]", annotation(-2, 4)),
        &top.unwrap(),
    )
    .unwrap();
    assert!(
        other.warnings[0].contains("under 'weed' was taken as the label 'leaf'"),
        "{:?}",
        other.warnings
    );
    let upper = r#"[{"id": 1, "name": "leaf"}, {"id": -2, "name": "Leaf"}]"#;
    assert_eq!(
        coco_file(images, upper, &both, &LabelTree::default())
            .unwrap()
            .new_labels
            .len(),
        2
    );
    let repeated = r#"[{"id": 1, "name": "leaf"}, {"id": 1, "name": "stem"}]"#;
    let error = coco_file(images, repeated, &both, &LabelTree::default())
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("category id 1 is listed for 'leaf' and for 'stem'"),
        "{error}"
    );
}

#[test]
fn images_listed_twice_are_merged_or_rejected() {
    let categories = r#"[{"id": 0, "name": "leaf"}]"#;
    let annotations = r#"[{"image_id": 1, "category_id": 0, "segmentation": [[0, 0, 2, 0, 2, 2, 0, 2]]},
                          {"image_id": 2, "category_id": 0, "segmentation": [[4, 0, 6, 0, 6, 2, 4, 2]]}]"#;
    for (first, second) in [
        ("a.jpg", "a.jpg"),
        ("x/a.jpg", ".\\\\x\\\\a.jpg"),
        ("a.jpg", "./a.jpg"),
    ] {
        let images = format!(
            r#"[{{"id": 1, "file_name": "{first}"}}, {{"id": 2, "file_name": "{second}", "width": null}}]"#
        );
        let read = coco_file(&images, categories, annotations, &LabelTree::default()).unwrap();
        assert_eq!(
            read.masks[&0]
                .extents()
                .values()
                .map(|extent| extent.area)
                .sum::<u64>(),
            8
        );
        assert!(
            read.warnings
                .iter()
                .any(|warning| warning.starts_with("1 images are listed more than once"))
        );
        assert!(
            read.warnings
                .iter()
                .any(|warning| warning.starts_with("2 images have no size"))
        );
    }
    let url = r#"[{"id": 1, "file_name": "https://host/x/a.jpg?token=1"}, {"id": 2, "file_name": "b.jpg"}]"#;
    assert_eq!(
        coco_file(url, categories, annotations, &LabelTree::default())
            .unwrap()
            .masks
            .len(),
        2
    );
    let two_sets = r#"[{"id": 1, "file_name": "x/a.jpg"}, {"id": 2, "file_name": "y/a.jpg"}]"#;
    let error = coco_file(two_sets, categories, annotations, &LabelTree::default())
        .unwrap_err()
        .to_string();
    assert!(error.contains("both fit the same frame"), "{error}");
    let one_id = r#"[{"id": 1, "file_name": "a.jpg"}, {"id": 1, "file_name": "b.jpg"}]"#;
    let error = coco_file(one_id, categories, annotations, &LabelTree::default())
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("image id 1 is listed for 'a.jpg' and for 'b.jpg'"),
        "{error}"
    );
}
