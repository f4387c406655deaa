use super::*;
use ostra_masks::{Label, LabelTree, MaskFormat, MaskFrame};

fn mask(ids: [u16; 12]) -> RunMask {
    RunMask::new(4, 3, ids.map(|id| (LabelId(id), 1)).to_vec()).unwrap()
}

fn write(dir: &Path, masks: &[(&str, [u16; 12])], tree: &LabelTree) {
    let frames: Vec<MaskFrame<'_>> = masks
        .iter()
        .map(|&(name, _)| MaskFrame {
            name,
            width: 4,
            height: 3,
        })
        .collect();
    let masks = masks.iter().map(|&(_, ids)| mask(ids)).enumerate();
    MaskFormat::Davis
        .export_masks(dir, &frames, masks, tree, &Progress::default())
        .unwrap();
    if tree.iter().next().is_none() {
        std::fs::remove_file(dir.join("labels.json")).unwrap();
    }
}

fn score(
    truth: &[(&str, [u16; 12])],
    result: &[(&str, [u16; 12])],
    tree: &LabelTree,
    options: ScoreOptions,
) -> Result<MaskScore, MaskError> {
    let dir = tempfile::tempdir().unwrap();
    let (truth_dir, result_dir) = (dir.path().join("truth"), dir.path().join("result"));
    write(&truth_dir, truth, tree);
    write(&result_dir, result, &LabelTree::default());
    score_masks(&truth_dir, &result_dir, &options, &Progress::default())
}

const HALF: [u16; 12] = [1, 1, 0, 0, 1, 1, 0, 0, 0, 0, 0, 0];
const FULL: [u16; 12] = [1, 1, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0];

#[test]
fn names_match_without_extension_and_missing_results_are_empty() {
    let none = LabelTree::default();
    let truth = [("2.jpg", FULL), ("10.jpg", FULL), ("11.jpg", FULL)];
    let result = [("x/2.png", HALF), ("10.png", FULL), ("99.png", FULL)];
    let found = score(&truth, &result, &none, ScoreOptions::default()).unwrap();
    assert!((found.j - (0.5 + 1.0 + 0.0) / 3.0).abs() < 1e-12);
    assert_eq!(
        found.labels[0]
            .frames
            .iter()
            .map(|frame| frame.frame.as_str())
            .collect::<Vec<_>>(),
        ["2", "10", "11"]
    );
    assert_eq!(found.warnings.len(), 2, "{:?}", found.warnings);
    let later = score(
        &truth,
        &result,
        &none,
        ScoreOptions {
            skip_first: true,
            level: None,
        },
    )
    .unwrap();
    assert!(
        (later.j - 0.5).abs() < 1e-12,
        "the first in natural order is left out"
    );
    assert_eq!(later.frames, 2);
}

#[test]
fn white_is_label_one_in_either_folder() {
    let none = LabelTree::default();
    let white = HALF.map(|id| id * 255);
    let j = |truth, result| {
        let found = score(
            &[("a", truth)],
            &[("a", result)],
            &none,
            ScoreOptions::default(),
        )
        .unwrap();
        (found.j, found.labels[0].id.0, found.warnings.len())
    };
    assert_eq!(j(white, white), (1.0, 1, 0));
    assert_eq!(j(white, HALF), (1.0, 1, 0));
    assert_eq!(j(HALF, white), (1.0, 1, 0));
    let mut with_void = HALF;
    with_void[11] = 255;
    assert_eq!(
        j(with_void, HALF),
        (1.0, 1, 1),
        "next to label 1 the 255 of the truth is void, which is reported"
    );
    assert_eq!(
        j(with_void, with_void),
        (1.0, 1, 1),
        "so it is in the result"
    );
    assert_eq!(
        j(with_void, white),
        (1.0, 1, 1),
        "in a black and white result it is the object"
    );
}

#[test]
fn transparent_pixels_are_reported() {
    let dir = tempfile::tempdir().unwrap();
    let (truth, result) = (dir.path().join("truth"), dir.path().join("result"));
    write(&truth, &[("a", HALF)], &LabelTree::default());
    std::fs::create_dir(&result).unwrap();
    let image = image::GrayAlphaImage::from_fn(4, 3, |x, y| {
        image::LumaA([
            HALF[(y * 4 + x) as usize] as u8,
            if x == 0 { 0 } else { 255 },
        ])
    });
    image.save(result.join("a.png")).unwrap();
    let found = score_masks(
        &truth,
        &result,
        &ScoreOptions::default(),
        &Progress::default(),
    )
    .unwrap();
    assert!(
        (found.j - 0.5).abs() < 1e-12 && found.warnings[0].contains("transparent pixels"),
        "{found:?}"
    );
}

#[test]
fn level_uses_the_label_list_of_either_folder() {
    let label = |id: u16, name: &str, parent: Option<u16>| Label {
        id: LabelId(id),
        name: name.into(),
        color: [0; 3],
        parent: parent.map(LabelId),
    };
    let tree: LabelTree = vec![label(1, "rice", None), label(2, "stem", Some(1))]
        .try_into()
        .unwrap();
    let (truth, result) = ([("a", FULL)], [("a", FULL.map(|id| id * 2))]);
    let level = |level| ScoreOptions {
        skip_first: false,
        level,
    };
    assert!(score(&truth, &result, &tree, level(None)).unwrap().j.abs() < 1e-12);
    let coarse = score(&truth, &result, &tree, level(Some(1))).unwrap();
    assert!((coarse.j - 1.0).abs() < 1e-12);
    assert_eq!(coarse.labels[0].name.as_deref(), Some("rice"));
    let error = score(&truth, &result, &LabelTree::default(), level(Some(1)))
        .unwrap_err()
        .to_string();
    assert!(error.contains("labels.json"), "{error}");
}

#[test]
fn unreadable_files_are_left_out_and_reported() {
    let dir = tempfile::tempdir().unwrap();
    let (truth, result) = (dir.path().join("truth"), dir.path().join("result"));
    let masks = [("a", FULL), ("b", FULL), ("c", FULL)];
    write(&truth, &masks, &LabelTree::default());
    write(&result, &masks, &LabelTree::default());
    let score = || {
        score_masks(
            &truth,
            &result,
            &ScoreOptions::default(),
            &Progress::default(),
        )
    };
    for path in [truth.join("a.png"), result.join("b.png")] {
        let whole = std::fs::read(&path).unwrap();
        std::fs::write(&path, &whole[..20]).unwrap();
    }
    let found = score().unwrap();
    assert!(
        found.frames == 2 && (found.j - 0.5).abs() < 1e-12,
        "a result that is damaged is empty: {found:?}"
    );
    let message = found.warnings.join("; ");
    assert!(
        message.contains("a.png")
            && message.contains("b.png")
            && message.contains("count as empty"),
        "{message}"
    );
    for name in ["a.png", "c.png"] {
        std::fs::write(result.join(name), "").unwrap();
    }
    assert!(
        score().unwrap_err().to_string().contains("a.png"),
        "the first of them, where none can be read"
    );
}

#[test]
fn results_of_another_size_count_as_empty() {
    let dir = tempfile::tempdir().unwrap();
    let (truth, result) = (dir.path().join("truth"), dir.path().join("result"));
    let masks = [("a", FULL), ("b", FULL)];
    write(&truth, &masks, &LabelTree::default());
    write(&result, &masks, &LabelTree::default());
    let shrink = |name: &str| {
        image::GrayImage::from_pixel(2, 2, image::Luma([1]))
            .save(result.join(name))
            .unwrap();
        score_masks(
            &truth,
            &result,
            &ScoreOptions::default(),
            &Progress::default(),
        )
    };
    let found = shrink("b.png").unwrap();
    assert!(
        found.frames == 2 && (found.j - 0.5).abs() < 1e-12,
        "{found:?}"
    );
    assert!(
        found.warnings.len() == 1 && found.warnings[0].contains("b: the result is 2×2"),
        "{found:?}"
    );
    let error = shrink("a.png").unwrap_err().to_string();
    assert!(
        error.contains("a: the result is 2×2") && error.contains("4×3"),
        "where none fits: {error}"
    );
}

#[test]
fn unscorable_folders_and_extra_labels_are_reported() {
    let none = LabelTree::default();
    let options = ScoreOptions::default();
    assert!(
        score(&[("a", FULL)], &[("b", FULL)], &none, options)
            .unwrap_err()
            .to_string()
            .contains("'b'")
    );
    assert!(
        score(&[("a", [0; 12])], &[("a", FULL)], &none, options).is_err(),
        "no label in the truth"
    );
    assert!(
        score(
            &[("a", FULL)],
            &[("a", FULL)],
            &none,
            ScoreOptions {
                skip_first: true,
                level: None
            }
        )
        .is_err()
    );
    assert!(score(&[], &[("a", FULL)], &none, options).is_err());
    let extra = score(
        &[("a", FULL)],
        &[("a", FULL.map(|id| if id == 0 { 4 } else { id }))],
        &none,
        options,
    )
    .unwrap();
    assert!(extra.warnings[0].ends_with(": 4"), "{:?}", extra.warnings);
}
