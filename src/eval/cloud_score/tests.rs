use glam::{DQuat, DVec3, Vec3};

use super::*;
use ostra_cloud::LabelledCloud;
use ostra_core::job::Progress;
use ostra_frames::FrameCamera;
use ostra_geometry::{Camera, Pose, Similarity};
use ostra_masks::{Label, LabelId, LabelTree};

/// Creates a cloud of labelled points along x, with the given label names.
fn cloud(points: &[(f32, u16)], names: &[(u16, &str, u16)]) -> LabelledCloud {
    let mut cloud =
        LabelledCloud::from_positions(points.iter().map(|&(x, _)| Vec3::X * x).collect());
    cloud.labels = points.iter().map(|&(_, id)| LabelId(id)).collect();
    cloud.tree = tree(names);
    cloud
}

fn tree(names: &[(u16, &str, u16)]) -> LabelTree {
    let mut tree = LabelTree::default();
    for &(id, name, parent) in names {
        let parent = (parent != 0).then_some(LabelId(parent));
        tree.set(Label {
            id: LabelId(id),
            name: name.into(),
            color: [0; 3],
            parent,
        })
        .unwrap();
    }
    tree
}

fn score(truth: &LabelledCloud, result: &LabelledCloud, options: &CloudScoreOptions) -> CloudScore {
    score_cloud(truth, result, options, &Progress::default()).unwrap()
}

fn within(distances: &[f64]) -> CloudScoreOptions {
    CloudScoreOptions {
        within: distances.to_vec(),
        ..CloudScoreOptions::default()
    }
}

const NAMES: &[(u16, &str, u16)] = &[(1, "stem", 0), (2, "leaf", 0)];

#[test]
fn scores_match_a_manual_count() {
    let truth = cloud(
        &[(0.0, 1), (1.0, 1), (2.0, 2), (3.0, 2), (4.0, 0), (9.0, 2)],
        NAMES,
    );
    // In the result, the leaf has id 8 and the stem id 2.
    let result = cloud(
        &[(0.1, 2), (1.1, 8), (2.0, 8), (3.2, 8), (4.0, 8)],
        &[(8, "leaf", 0), (2, "stem", 0)],
    );
    let score = score(&truth, &result, &within(&[0.5, 0.15]));
    let labels = &score.labels;
    let iou: Vec<_> = labels
        .iou
        .iter()
        .map(|l| (l.id.0, l.name.as_str(), l.iou, l.points))
        .collect();
    // Stem: 1 right, 1 labelled as leaf. Leaf: 2 right, 1 not matched, 2 false positives.
    assert_eq!(iou, [(1, "stem", 0.5, 2), (2, "leaf", 0.4, 3)]);
    assert!((labels.mean_iou - 0.45).abs() < 1e-12);
    assert_eq!(labels.accuracy, 3.0 / 5.0);
    assert_eq!(labels.matched, 5.0 / 6.0);
    assert_eq!(labels.confusion.truth, ["-", "stem", "leaf"]);
    assert_eq!(labels.confusion.result, ["-", "stem", "leaf"]);
    assert_eq!(labels.confusion.counts, [[0, 0, 1], [0, 1, 1], [1, 0, 2]]);
    let surface: Vec<_> = score
        .surface
        .iter()
        .map(|s| (s.within, s.completeness, s.accuracy))
        .collect();
    assert_eq!(surface, [(0.5, 5.0 / 6.0, 1.0), (0.15, 4.0 / 6.0, 0.8)]);
    assert!((score.median_distance - 0.1).abs() < 1e-6);
}

#[test]
fn without_a_distance_every_point_is_matched() {
    let truth = cloud(&[(0.0, 1), (900.0, 2)], NAMES);
    let score = score(
        &truth,
        &cloud(&[(0.0, 1)], NAMES),
        &CloudScoreOptions::default(),
    );
    assert_eq!((score.labels.matched, score.labels.accuracy), (1.0, 0.5));
    assert!(score.surface.is_empty());
}

#[test]
fn labels_are_paired_by_name_then_by_id() {
    let pairs = pair_labels(
        &tree(&[(1, "stem", 0), (2, "leaf", 0), (3, "pot", 0)]),
        &tree(&[
            (1, "leaf", 0),
            (2, "blade", 0),
            (3, "vase", 0),
            (9, "wall", 0),
        ]),
    );
    let pairs: Vec<_> = pairs.iter().map(|(from, to)| (from.0, to.0)).collect();
    // 'leaf' maps to 2, so 'blade' has no partner and gets an unused id; 'vase' is mapped by its
    // id.
    assert_eq!(pairs, [(1, 2), (2, 65535), (3, 3), (9, 9)]);
}

#[test]
fn level_is_applied_to_both_label_trees() {
    let truth = cloud(
        &[(0.0, 2), (1.0, 3)],
        &[(1, "plant", 0), (2, "stem", 1), (3, "leaf", 1)],
    );
    let result = cloud(&[(0.0, 7), (1.0, 7)], &[(5, "plant", 0), (7, "stem", 5)]);
    assert_eq!(score(&truth, &result, &within(&[0.1])).labels.accuracy, 0.5);
    let top = score(
        &truth,
        &result,
        &CloudScoreOptions {
            level: Some(1),
            ..within(&[0.1])
        },
    );
    assert_eq!(
        (
            top.labels.accuracy,
            top.labels.iou.len(),
            top.labels.iou[0].name.as_str()
        ),
        (1.0, 1, "plant")
    );
}

#[test]
fn only_points_inside_enough_frustums_count() {
    let truth = cloud(&[(0.0, 1), (0.5, 1), (5.0, 2)], NAMES);
    let pose = |x: f64| Pose {
        rotation: DQuat::IDENTITY,
        translation: DVec3::new(-x, 0.0, 2.0),
    };
    let intrinsics = Camera::pinhole(100, 100, [100.0, 100.0], [50.0, 50.0]);
    let camera = |x| FrameCamera::given(intrinsics, Some(pose(x)));
    let options = CloudScoreOptions {
        cameras: vec![camera(0.0), camera(0.4)],
        min_views: 2,
        ..within(&[0.1])
    };
    assert_eq!(inside_frusta(&truth.positions, &options.cameras), [2, 2, 0]);
    let two = score(&truth, &cloud(&[(0.0, 1), (5.0, 2)], NAMES), &options);
    assert_eq!(
        (
            two.truth_points,
            two.surface[0].completeness,
            two.surface[0].accuracy
        ),
        (2, 0.5, 1.0)
    );
    let three = CloudScoreOptions {
        min_views: 3,
        ..options
    };
    let refused = score_cloud(&truth, &truth, &three, &Progress::default()).unwrap_err();
    assert!(
        refused.to_string().contains("inside 3 of the 2 frusta"),
        "{refused}"
    );
}

#[test]
fn result_is_aligned_before_scoring() {
    let truth = cloud(&[(0.0, 1), (1.0, 2)], NAMES);
    let result = cloud(&[(10.0, 1), (12.0, 2)], NAMES);
    let transform = Similarity {
        scale: 0.5,
        rotation: DQuat::IDENTITY,
        translation: DVec3::new(-5.0, 0.0, 0.0),
    };
    let options = CloudScoreOptions {
        truth_from_result: Some(transform),
        ..within(&[0.01])
    };
    assert_eq!(score(&truth, &result, &options).labels.accuracy, 1.0);
}

#[test]
fn empty_clouds_and_invalid_distances_are_rejected() {
    let some = cloud(&[(0.0, 1)], NAMES);
    let refusal = |truth: &LabelledCloud, result: &LabelledCloud, options: &CloudScoreOptions| {
        score_cloud(truth, result, options, &Progress::default())
            .unwrap_err()
            .to_string()
    };
    assert!(refusal(&some, &cloud(&[], NAMES), &within(&[1.0])).contains("without points"));
    assert!(refusal(&cloud(&[], NAMES), &some, &within(&[1.0])).contains("without points"));
    assert!(refusal(&some, &some, &within(&[0.0])).contains("above 0"));
}

#[test]
fn table_matches_the_expected_text() {
    let truth = cloud(&[(0.0, 1), (1.0, 2)], NAMES);
    let text = cloud_table(&score(&truth, &cloud(&[(0.0, 1)], NAMES), &within(&[0.5])));
    let expected = "label     IoU  points\nstem   1.0000       1\nleaf   0.0000       1\nmean   0.5000       2\n\n\
                    accuracy           0.5000\nmatched            0.5000\nmedian distance  1.000000\n\n\
                    within  completeness  accuracy       F  in depth\n0.5           0.5000    1.0000  0.6667         –\n\n\
                    truth \\ result  -  stem\nstem            0     1\nleaf            1     0\n";
    assert_eq!(text, expected);
}

#[test]
fn table_contains_the_number_of_depth_comparisons() {
    let points = cloud(&[(0.0, 1)], NAMES);
    let camera = FrameCamera::given(
        Camera::pinhole(64, 48, [50.0, 50.0], [32.0, 24.0]),
        Some(Pose::default()),
    );
    let options = CloudScoreOptions {
        cameras: vec![camera],
        ..within(&[0.5])
    };
    let text = cloud_table(&score(&points, &points, &options));
    let row = text
        .lines()
        .find(|line| line.starts_with("compared in depth"))
        .expect("a row of its own");
    assert!(row.ends_with(" 0"), "no camera sees the point: {row}");
}
