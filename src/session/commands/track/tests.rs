use std::collections::BTreeMap;

use proptest::prelude::*;

use super::*;
use ostra_core::job::JobId;
use ostra_masks::LabelId;
use ostra_project::testing::{keyframe, project, record, tracked};
use ostra_project::{MaskOrigin, OpenProject, Project};

/// Returns a session with a run whose frames the test provides.
fn running(folder: &tempfile::TempDir, project: Project) -> Session {
    let mut session = Session::new();
    session.open = Some(OpenProject::create(&folder.path().join("p"), project).unwrap());
    begin(&mut session, 1, &TrackSettings::default());
    session
}

fn begin(session: &mut Session, job: u64, settings: &TrackSettings) {
    session.track = Some(TrackRun {
        job: JobId(job),
        engine: "flow",
        title: "Track with flow".into(),
        settings: String::new(),
        choice: LabelChoice::new(&settings.labels, settings.replace),
        begun: Instant::now(),
        made_from: session.snapshot().unwrap(),
        done: BTreeSet::new(),
        waiting: Vec::new(),
        saved: Instant::now(),
        pause_below: settings.pause_below,
        pause: None,
    });
}

fn only(labels: &[u16], replace: bool) -> TrackSettings {
    let labels = labels.iter().copied().map(LabelId).collect();
    TrackSettings {
        labels,
        replace,
        ..TrackSettings::default()
    }
}

fn stale(session: &Session, frame: usize) -> bool {
    session.project().unwrap().masks[&frame].stale
}

#[test]
fn masks_tracked_from_keyframes_that_changed_meanwhile_are_stale() {
    let folder = tempfile::tempdir().unwrap();
    let mut start = project();
    start
        .apply(Edit::SetMask {
            frame: 0,
            mask: Some(keyframe([1, 0, 0])),
        })
        .unwrap();
    start
        .apply(Edit::SetResult {
            kind: ResultKind::Cloud,
            record: Some(record("fuse")),
        })
        .unwrap();
    let mut session = running(&folder, start.clone());
    session.gather(1, tracked([1, 0, 0]), false).unwrap();
    session.save_tracked(true).unwrap();
    assert!(!stale(&session, 1));
    session
        .commit(
            "Paint",
            vec![Edit::SetMask {
                frame: 3,
                mask: Some(keyframe([2, 2, 2])),
            }],
        )
        .unwrap();
    assert!(stale(&session, 1));
    for frame in [2, 3, 4] {
        session.gather(frame, tracked([1, 1, 0]), false).unwrap();
    }
    session.end_track(JobId(1)).unwrap();
    assert!(stale(&session, 2) && stale(&session, 4));
    assert_eq!(
        session.project().unwrap().masks[&3],
        keyframe([2, 2, 2]),
        "the new keyframe stands"
    );
    assert!(session.project().unwrap().results[&ResultKind::Tracking].stale);
    for title in ["Track with flow", "Paint", "Track with flow"] {
        assert_eq!(session.undo_title(), Some(title));
        session.undo().unwrap();
    }
    assert_eq!(**session.project().unwrap(), start);
}

#[test]
fn retracking_a_label_leaves_frames_outside_its_range_stale() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = running(&folder, project());
    session
        .commit(
            "Prompt",
            vec![Edit::SetMask {
                frame: 0,
                mask: Some(keyframe([1, 2, 0])),
            }],
        )
        .unwrap();
    for frame in 1..5 {
        session.gather(frame, tracked([1, 2, 0]), false).unwrap();
    }
    session.end_track(JobId(1)).unwrap();
    session
        .commit(
            "Correct",
            vec![Edit::SetMask {
                frame: 2,
                mask: Some(keyframe([0, 2, 1])),
            }],
        )
        .unwrap();
    assert_eq!([1, 3, 4].map(|frame| stale(&session, frame)), [true; 3]);
    begin(&mut session, 2, &only(&[1], false));
    for frame in [1, 3] {
        session.gather(frame, tracked([2, 0, 1]), false).unwrap();
    }
    session.end_track(JobId(2)).unwrap();
    let project = session.project().unwrap();
    assert_eq!(
        [1, 3, 4].map(|frame| stale(&session, frame)),
        [false, false, true]
    );
    assert!(
        project.results[&ResultKind::Tracking].stale,
        "as long as one frame is"
    );
    assert_eq!(project.masks[&3].runs, tracked([0, 2, 1]).runs);
    assert_eq!(
        (&project.masks[&0], &project.masks[&2]),
        (&keyframe([1, 2, 0]), &keyframe([0, 2, 1]))
    );
    session.undo().unwrap();
    assert_eq!([1, 3, 4].map(|frame| stale(&session, frame)), [true; 3]);
}

#[test]
fn run_with_low_confidence_pauses() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = running(&folder, project());
    begin(
        &mut session,
        2,
        &TrackSettings {
            pause_below: Some(0.6),
            ..TrackSettings::default()
        },
    );
    let unsure = FrameMask {
        confidence: BTreeMap::from([(LabelId(1), 0.9), (LabelId(2), 0.5)]),
        ..tracked([1, 2, 0])
    };
    session.gather(0, unsure.clone(), true).unwrap();
    session.gather(1, tracked([1, 0, 0]), false).unwrap();
    assert!(
        session.paused(JobId(2)).is_none(),
        "a better answer is to come"
    );
    session.gather(2, unsure, false).unwrap();
    session.gather(3, tracked([1, 0, 0]), false).unwrap();
    let Some(Event::Paused {
        frame: 2,
        label: LabelId(2),
        text,
        ..
    }) = session.paused(JobId(2))
    else {
        panic!()
    };
    assert!(text.contains("'stem' has 50 % confidence"), "{text}");
    session.end_track(JobId(2)).unwrap();
    assert_eq!(
        session
            .project()
            .unwrap()
            .masks
            .keys()
            .copied()
            .collect::<Vec<_>>(),
        [0, 1, 2]
    );
}

/// A random action on the project.
#[derive(Debug, Clone)]
enum Act {
    Track {
        labels: Vec<u16>,
        replace: bool,
        brought: Vec<(usize, u16)>,
    },
    Keyframe {
        frame: usize,
        id: u16,
    },
    Undo,
    Redo,
}

fn act() -> impl Strategy<Value = Act> {
    let brought = proptest::collection::vec((0usize..7, 0u16..4), 0..8);
    prop_oneof![
        3 => (proptest::collection::vec(0u16..4, 0..3), any::<bool>(), brought)
            .prop_map(|(labels, replace, brought)| Act::Track { labels, replace, brought }),
        1 => (0usize..5, 0u16..3).prop_map(|(frame, id)| Act::Keyframe { frame, id }),
        1 => Just(Act::Undo),
        1 => Just(Act::Redo),
    ]
}

fn keyframes(session: &Session) -> BTreeMap<usize, FrameMask> {
    let masks = session.project().unwrap().masks.clone();
    masks
        .into_iter()
        .filter(|(_, mask)| mask.origin == MaskOrigin::Keyframe)
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// A run never changes a keyframe, nor a pixel of other labels unless it may replace them.
    #[test]
    fn tracking_preserves_keyframes_and_other_labels(acts in proptest::collection::vec(act(), 1..12)) {
        let folder = tempfile::tempdir().unwrap();
        let mut session = running(&folder, project());
        for (act, job) in acts.into_iter().zip(1..) {
            match act {
                Act::Undo => drop(session.undo()),
                Act::Redo => drop(session.redo()),
                Act::Keyframe { frame, id } => {
                    let mask = Some(keyframe([id, 2, 0]));
                    session.commit("Prompt", vec![Edit::SetMask { frame, mask }]).unwrap();
                }
                Act::Track { labels, replace, brought } => {
                    let (before, held) = (session.snapshot().unwrap(), keyframes(&session));
                    begin(&mut session, job, &only(&labels, replace));
                    for (frame, id) in brought {
                        session.gather(frame, tracked([id, 0, 1]), false).unwrap();
                    }
                    session.end_track(JobId(job)).unwrap();
                    prop_assert_eq!(keyframes(&session), held);
                    let after = session.project().unwrap();
                    for (frame, mask) in before.masks.iter().filter(|_| !labels.is_empty() && !replace) {
                        for (was, is, _) in mask.runs.joint_runs(&after.masks[frame].runs) {
                            let other = was != LabelId::NONE && !labels.contains(&was.0);
                            prop_assert!(was == is || !other, "frame {frame}: {was:?} became {is:?}");
                        }
                    }
                }
            }
        }
    }
}

#[test]
fn range_of_keyframes_only_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut start = project();
    for frame in [0, 1] {
        let mask = Some(keyframe([1, 0, 0]));
        start.apply(Edit::SetMask { frame, mask }).unwrap();
    }
    let mut session = Session::new();
    session.open = Some(OpenProject::create(&folder.path().join("p"), start).unwrap());
    let settings = TrackSettings {
        to: Some(1),
        ..TrackSettings::default()
    };
    let error = session.track(&settings).unwrap_err().to_string();
    assert!(
        error.contains("every frame from 0 to 1 is a keyframe"),
        "{error}"
    );
}
