use proptest::prelude::*;

use super::edits::any_edit;
use super::making::{camera, keyframe, label, project, record, tracked};
use ostra_core::job::JobId;
use ostra_project::OpenProject;
use ostra_project::{Edit, MaskOrigin, Project, ResultKind};

fn opened(folder: &tempfile::TempDir, project: Project) -> OpenProject {
    OpenProject::create(&folder.path().join("p"), project).unwrap()
}

/// Returns a project with keyframes on frames 0 and 3, tracked masks on 1, 2 and 4, and records.
///
/// The records are of tracking, cloud and cameras.
fn tracked_project(engine: &str) -> Project {
    let mut project = project();
    let masks = [
        keyframe([1, 0, 0]),
        tracked([1, 1, 0]),
        tracked([0, 1, 0]),
        keyframe([0, 1, 0]),
        tracked([0, 0, 1]),
    ];
    for (frame, mask) in masks.into_iter().enumerate() {
        project
            .apply(Edit::SetMask {
                frame,
                mask: Some(mask),
            })
            .unwrap();
    }
    for (kind, engine) in [
        (ResultKind::Tracking, engine),
        (ResultKind::Cloud, "fuse"),
        (ResultKind::Cameras, "given"),
    ] {
        project
            .apply(Edit::SetResult {
                kind,
                record: Some(record(engine)),
            })
            .unwrap();
    }
    project
}

fn stale(project: &Project) -> Vec<usize> {
    project
        .masks
        .iter()
        .filter(|(_, mask)| mask.stale)
        .map(|(&frame, _)| frame)
        .collect()
}

fn stale_results(project: &Project) -> Vec<ResultKind> {
    project
        .results
        .iter()
        .filter(|(_, record)| record.stale)
        .map(|(&kind, _)| kind)
        .collect()
}

#[test]
fn changed_keyframe_makes_the_frames_it_reaches_stale() {
    let folder = tempfile::tempdir().unwrap();
    let start = tracked_project("flow");
    let mut open = opened(&folder, start.clone());
    open.commit(
        "Paint",
        vec![Edit::SetMask {
            frame: 0,
            mask: Some(keyframe([1, 1, 1])),
        }],
    )
    .unwrap();
    assert_eq!(stale(open.project()), [1, 2], "up to the next keyframe");
    assert_eq!(
        stale_results(open.project()),
        [ResultKind::Tracking, ResultKind::Cloud]
    );
    open.undo().unwrap();
    assert_eq!(**open.project(), start);
    open.redo().unwrap();
    assert_eq!(stale(open.project()), [1, 2]);
}

#[test]
fn keyframe_reaches_all_frames_through_geometry() {
    let folder = tempfile::tempdir().unwrap();
    let mut open = opened(&folder, tracked_project("geometry"));
    open.commit(
        "Clear",
        vec![Edit::SetMask {
            frame: 0,
            mask: None,
        }],
    )
    .unwrap();
    assert_eq!(stale(open.project()), [1, 2, 4]);
}

#[test]
fn accepted_mask_makes_nothing_stale() {
    let folder = tempfile::tempdir().unwrap();
    let start = tracked_project("geometry");
    let same = ostra_project::FrameMask {
        runs: start.masks[&1].runs.clone(),
        ..keyframe([0; 3])
    };
    let mut open = opened(&folder, start);
    open.commit(
        "Accept",
        vec![Edit::SetMask {
            frame: 1,
            mask: Some(same),
        }],
    )
    .unwrap();
    assert_eq!(
        (stale(open.project()), stale_results(open.project())),
        (vec![], vec![])
    );
}

#[test]
fn tracked_mask_makes_only_the_cloud_stale() {
    let folder = tempfile::tempdir().unwrap();
    let mut open = opened(&folder, tracked_project("geometry"));
    open.commit(
        "Track",
        vec![Edit::SetMask {
            frame: 1,
            mask: Some(tracked([2, 2, 2])),
        }],
    )
    .unwrap();
    assert_eq!(
        (stale(open.project()), stale_results(open.project())),
        (vec![], vec![ResultKind::Cloud])
    );
}

#[test]
fn changed_cameras_and_names_make_dependent_results_stale() {
    let folder = tempfile::tempdir().unwrap();
    let mut open = opened(&folder, tracked_project("geometry"));
    let recolored = ostra_masks::Label {
        color: [1, 2, 3],
        ..label(1, "leaf")
    };
    open.commit(
        "Colour",
        vec![Edit::SetLabel {
            id: recolored.id,
            label: Some(recolored),
        }],
    )
    .unwrap();
    assert_eq!(stale_results(open.project()), []);
    open.commit(
        "Name",
        vec![Edit::SetLabel {
            id: label(1, "").id,
            label: Some(label(1, "blade")),
        }],
    )
    .unwrap();
    assert_eq!(stale_results(open.project()), [ResultKind::Cloud]);
    open.commit(
        "Camera",
        vec![Edit::SetCamera {
            frame: 2,
            camera: Some(camera(0.5)),
        }],
    )
    .unwrap();
    assert_eq!(
        stale_results(open.project()),
        [ResultKind::Tracking, ResultKind::Cloud]
    );
    assert_eq!(stale(open.project()), [1, 2, 4]);
}

#[test]
fn edit_without_effect_is_not_a_step() {
    let folder = tempfile::tempdir().unwrap();
    let mut open = opened(&folder, tracked_project("flow"));
    let same = open.project().masks[&0].clone();
    assert!(
        !open
            .commit(
                "Nothing",
                vec![Edit::SetMask {
                    frame: 0,
                    mask: Some(same)
                }]
            )
            .unwrap()
    );
    assert!(open.undo().is_err());
}

#[test]
fn run_is_one_step_unless_interrupted_by_another() {
    let folder = tempfile::tempdir().unwrap();
    let mut open = opened(&folder, tracked_project("flow"));
    let start = open.project().as_ref().clone();
    let part = |ids| {
        vec![Edit::SetMask {
            frame: 1,
            mask: Some(tracked(ids)),
        }]
    };
    open.commit_part("Track", part([1, 0, 1]), JobId(1))
        .unwrap();
    open.commit_part("Track", part([1, 0, 2]), JobId(1))
        .unwrap();
    open.undo().unwrap();
    assert_eq!(**open.project(), start, "both parts are one step");
    open.commit_part("Track", part([1, 0, 1]), JobId(2))
        .unwrap();
    open.commit(
        "Paint",
        vec![Edit::SetMask {
            frame: 3,
            mask: Some(keyframe([2, 2, 2])),
        }],
    )
    .unwrap();
    open.commit_part("Track", part([2, 0, 1]), JobId(2))
        .unwrap();
    assert_eq!(open.undo().unwrap(), "Track");
    assert_eq!(open.undo().unwrap(), "Paint");
    assert_eq!(open.undo().unwrap(), "Track");
    assert_eq!(**open.project(), start);
}

#[test]
fn step_rejected_halfway_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let start = tracked_project("flow");
    let mut open = opened(&folder, start.clone());
    let edits = vec![
        Edit::SetMask {
            frame: 0,
            mask: None,
        },
        Edit::SetMask {
            frame: 99,
            mask: None,
        },
    ];
    assert!(open.commit("Half", edits).is_err());
    assert_eq!(**open.project(), start);
    assert!(open.undo().is_err());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Steps, undos, redos, checkpoints and openings in any order preserve the project.
    ///
    /// The folder always opens to the last state with its history, and undoing everything leads to
    /// the start.
    #[test]
    fn project_reopens_in_the_state_it_was_closed(
        acts in proptest::collection::vec((0u8..8, proptest::collection::vec(any_edit(), 1..4)), 1..30),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("p");
        let mut open = OpenProject::create(&root, project()).unwrap();
        for (act, edits) in acts {
            match act {
                0 => drop(open.undo()),
                1 => drop(open.redo()),
                2 => open.save_now().unwrap(),
                3 => {
                    let (before, history) = (open.project().clone(), open.history().clone());
                    drop(open);
                    let loaded = ostra_project::store::Folder::open(&root, &Default::default()).unwrap();
                    prop_assert_eq!(&loaded.warnings, &Vec::<String>::new());
                    open = OpenProject::loaded(loaded);
                    prop_assert_eq!(open.project(), &before);
                    prop_assert_eq!(open.history(), &history);
                }
                _ => drop(open.commit("Step", edits)),
            }
            let stale_keyframe = |mask: &ostra_project::FrameMask| mask.stale && mask.origin == MaskOrigin::Keyframe;
            prop_assert!(!open.project().masks.values().any(stale_keyframe));
        }
        let end = open.project().clone();
        let mut undone = 0;
        while open.undo().is_ok() {
            undone += 1;
        }
        prop_assert_eq!(&**open.project(), &project());
        for _ in 0..undone {
            open.redo().unwrap();
        }
        prop_assert_eq!(open.project(), &end);
    }
}
