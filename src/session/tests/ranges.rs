mod marks;

use std::collections::BTreeMap;

use glam::DVec2;
use proptest::prelude::*;

use super::making::{keyframe, perform, project, tracked};
use crate::Event;
use crate::{Command, RangeChange, RangeRequest, Session, TrackSettings};
use ostra_masks::{Click, LabelId, Prompt};
use ostra_project::OpenProject;
use ostra_project::{Edit, FrameMask, MaskOrigin, Project};

const LEAF: LabelId = LabelId(1);
const STEM: LabelId = LabelId(2);

fn opened(folder: &tempfile::TempDir, masks: &[FrameMask]) -> Session {
    let mut start = project();
    for (frame, mask) in masks.iter().enumerate() {
        start
            .apply(Edit::SetMask {
                frame,
                mask: Some(mask.clone()),
            })
            .unwrap();
    }
    let mut session = Session::new();
    session.open = Some(OpenProject::create(&folder.path().join("p"), start).unwrap());
    session
}

fn change(
    session: &mut Session,
    labels: &[LabelId],
    range: (usize, usize),
    change: RangeChange,
) -> anyhow::Result<()> {
    let request = RangeRequest {
        labels: labels.to_vec(),
        from: range.0,
        to: range.1,
        change,
        replace: false,
    };
    perform(session, Command::Range(request)).map(drop)
}

fn now(session: &Session) -> &Project {
    session.project().unwrap()
}

/// Returns the labels of the three rows of a frame.
fn rows(session: &Session, frame: usize) -> [u16; 3] {
    let ids = now(session).masks[&frame].runs.decode().ids;
    [0, 4, 8].map(|at| ids[at].0)
}

fn click(x: f64, y: f64) -> Click {
    Click {
        at_px: DVec2::new(x, y),
        include: true,
    }
}

fn prompt(clicks: Vec<Click>) -> Prompt {
    Prompt {
        clicks,
        ..Prompt::default()
    }
}

fn both(ids: [u16; 3]) -> FrameMask {
    FrameMask {
        confidence: BTreeMap::from([(LEAF, 0.7), (STEM, 0.4)]),
        ..tracked(ids)
    }
}

#[test]
fn deleted_label_stays_absent_until_restored_or_painted() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(
        &folder,
        &[
            keyframe([1, 2, 0]),
            both([1, 2, 0]),
            both([1, 2, 0]),
            keyframe([1, 2, 0]),
        ],
    );
    session
        .commit(
            "",
            vec![Edit::SetPrompt {
                frame: 3,
                label: LEAF,
                prompt: Some(prompt(vec![click(1.0, 0.5)])),
            }],
        )
        .unwrap();
    let start = Project::clone(now(&session));
    change(&mut session, &[LEAF], (1, 3), RangeChange::Delete).unwrap();
    assert_eq!(
        [0, 1, 2, 3].map(|frame| rows(&session, frame)),
        [[1, 2, 0], [0, 2, 0], [0, 2, 0], [0, 2, 0]]
    );
    assert_eq!(
        now(&session).masks[&1].confidence,
        BTreeMap::from([(STEM, 0.4)])
    );
    assert!(now(&session).prompts.is_empty());
    assert_eq!(now(&session).masks[&3].origin, MaskOrigin::Keyframe);
    let brought = now(&session).within_marks(2, tracked([2, 1, 1]));
    assert_eq!(
        (brought.runs, brought.confidence.len()),
        (tracked([2, 0, 0]).runs, 0),
        "no tracker brings it back"
    );
    let given =
        ostra_project::mask_edits::by_hand(now(&session), 2, &tracked([1, 2, 0]).runs.decode());
    session.commit("Paint", given).unwrap();
    assert_eq!(
        now(&session)
            .marks_of(LEAF)
            .absent
            .ranges()
            .collect::<Vec<_>>(),
        [1..=1, 3..=3]
    );
    change(&mut session, &[], (0, 4), RangeChange::Restore).unwrap();
    assert!(now(&session).marks.is_empty());
    for _ in 0..3 {
        session.undo().unwrap();
    }
    assert_eq!(*now(&session), start);
}

#[test]
fn locked_label_is_not_changed_by_any_operation() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(
        &folder,
        &[keyframe([1, 2, 0]), both([1, 2, 0]), both([1, 2, 0])],
    );
    change(&mut session, &[LEAF], (1, 2), RangeChange::Lock).unwrap();
    let held = now(&session).within_marks(
        1,
        FrameMask {
            confidence: BTreeMap::from([(LEAF, 0.1)]),
            ..tracked([2, 1, 1])
        },
    );
    assert_eq!(held.runs, tracked([1, 0, 0]).runs);
    assert_eq!(held.confidence, BTreeMap::from([(LEAF, 0.7)]));
    for (labels, what) in [
        (vec![LEAF], RangeChange::Delete),
        (vec![LEAF], RangeChange::Merge { into: STEM }),
    ] {
        assert!(
            change(&mut session, &labels, (1, 2), what).is_err(),
            "{what:?}"
        );
    }
    change(&mut session, &[], (0, 2), RangeChange::Delete).unwrap();
    assert_eq!(
        [0, 1, 2].map(|frame| rows(&session, frame)),
        [[0, 0, 0], [1, 0, 0], [1, 0, 0]]
    );
    assert_eq!(
        now(&session)
            .marks_of(LEAF)
            .absent
            .ranges()
            .collect::<Vec<_>>(),
        [0..=0]
    );
    let paint = |label, erase| crate::PaintRequest {
        frame: 1,
        label,
        points_px: vec![DVec2::new(1.0, 0.5)],
        radius_px: 9.0,
        erase,
        replace: true,
        snap: false,
    };
    let error = perform(&mut session, Command::Paint(paint(LEAF, true)))
        .unwrap_err()
        .to_string();
    assert_eq!(
        error,
        "label 'leaf' is locked on frame 1; unlock it there first"
    );
    perform(&mut session, Command::Paint(paint(STEM, false))).unwrap();
    assert_eq!(rows(&session, 1), [1, 2, 2], "painting over it leaves it");
    assert!(session.clear_mask(1).is_err());
    change(&mut session, &[LEAF], (1, 1), RangeChange::Unlock).unwrap();
    session.clear_mask(1).unwrap();
}

#[test]
fn hidden_label_is_kept_but_not_in_play() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(&folder, &[keyframe([1, 2, 0]), both([1, 2, 0])]);
    change(&mut session, &[STEM], (1, 4), RangeChange::Hide).unwrap();
    assert_eq!(rows(&session, 1), [1, 2, 0]);
    let shown = |session: &Session, frame| now(session).mask_in_play(frame).unwrap();
    assert_eq!(
        (shown(&session, 0), shown(&session, 1)),
        (keyframe([1, 2, 0]).runs, keyframe([1, 0, 0]).runs)
    );
    change(&mut session, &[STEM], (0, 1), RangeChange::Show).unwrap();
    assert_eq!(shown(&session, 1), keyframe([1, 2, 0]).runs);
    assert_eq!(
        now(&session)
            .marks_of(STEM)
            .hidden
            .ranges()
            .collect::<Vec<_>>(),
        [2..=4]
    );
    assert!(
        change(&mut session, &[STEM], (0, 1), RangeChange::Show)
            .unwrap_err()
            .to_string()
            .contains("nothing to change")
    );
}

#[test]
fn merged_label_passes_on_pixels_clicks_and_lower_confidence() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(
        &folder,
        &[keyframe([1, 2, 0]), both([1, 2, 0]), both([1, 2, 0])],
    );
    let given = |label, x| Edit::SetPrompt {
        frame: 0,
        label,
        prompt: Some(prompt(vec![click(x, 0.5)])),
    };
    session
        .commit("", vec![given(LEAF, 1.0), given(STEM, 2.0)])
        .unwrap();
    change(
        &mut session,
        &[STEM],
        (0, 1),
        RangeChange::Merge { into: LEAF },
    )
    .unwrap();
    assert_eq!(
        [0, 1, 2].map(|frame| rows(&session, frame)),
        [[1, 1, 0], [1, 1, 0], [1, 2, 0]]
    );
    assert_eq!(
        now(&session).masks[&1].confidence,
        BTreeMap::from([(LEAF, 0.4)]),
        "the lesser one"
    );
    assert_eq!(
        now(&session).prompts,
        BTreeMap::from([((0, LEAF), prompt(vec![click(1.0, 0.5), click(2.0, 0.5)]))])
    );
    assert!(
        change(
            &mut session,
            &[LEAF],
            (0, 1),
            RangeChange::Merge { into: LEAF }
        )
        .is_err()
    );
}

#[test]
fn split_piece_is_followed_through_the_range() {
    let folder = tempfile::tempdir().unwrap();
    let masks = [
        both([1, 0, 1]),
        keyframe([1, 0, 1]),
        both([1, 0, 0]),
        both([1, 0, 1]),
    ];
    let mut session = opened(&folder, &masks);
    let given = Edit::SetPrompt {
        frame: 1,
        label: LEAF,
        prompt: Some(prompt(vec![click(1.0, 0.5), click(1.0, 2.5)])),
    };
    session.commit("", vec![given]).unwrap();
    let cut = |y| RangeChange::Split {
        frame: 1,
        at_px: DVec2::new(2.0, y),
        into: STEM,
    };
    assert!(
        change(&mut session, &[LEAF], (0, 3), cut(1.5))
            .unwrap_err()
            .to_string()
            .contains("is not label 'leaf'")
    );
    change(&mut session, &[LEAF], (0, 3), cut(2.5)).unwrap();
    assert_eq!(
        [0, 1, 2, 3].map(|frame| rows(&session, frame)),
        [[1, 0, 2], [1, 0, 2], [1, 0, 0], [1, 0, 2]]
    );
    assert_eq!(
        now(&session).prompts[&(1, LEAF)],
        prompt(vec![click(1.0, 0.5)])
    );
    assert_eq!(
        now(&session).prompts[&(1, STEM)],
        prompt(vec![click(1.0, 2.5)])
    );
    session.undo().unwrap();
    assert_eq!(now(&session).masks[&0], masks[0]);
    let error = change(
        &mut session,
        &[LEAF],
        (2, 2),
        RangeChange::Split {
            frame: 2,
            at_px: DVec2::ONE / 2.0,
            into: STEM,
        },
    );
    assert!(
        error
            .unwrap_err()
            .to_string()
            .contains("one connected part")
    );
}

#[test]
fn frames_in_between_get_interpolated_shapes() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(
        &folder,
        &[
            keyframe([1, 0, 0]),
            both([2, 2, 2]),
            keyframe([1, 0, 2]),
            both([0, 0, 2]),
            keyframe([0, 0, 1]),
        ],
    );
    change(&mut session, &[LEAF], (0, 4), RangeChange::Interpolate).unwrap();
    assert_eq!(rows(&session, 1), [2, 2, 2], "pixels of other labels stay");
    assert_eq!(
        now(&session).masks[&2],
        keyframe([1, 0, 2]),
        "a keyframe that shows it stays"
    );
    let request = RangeRequest {
        labels: vec![LEAF],
        from: 0,
        to: 4,
        change: RangeChange::Interpolate,
        replace: true,
    };
    perform(&mut session, Command::Range(request)).unwrap();
    assert_eq!(
        (rows(&session, 1)[0], now(&session).masks[&1].origin),
        (1, MaskOrigin::Tracked)
    );
    let error = change(&mut session, &[STEM], (0, 2), RangeChange::Interpolate)
        .unwrap_err()
        .to_string();
    assert_eq!(error, "label 'stem' is not on frame 0; give it there first");
}

#[test]
fn copied_mask_is_a_keyframe() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(&folder, &[keyframe([1, 1, 0]), both([2, 0, 1])]);
    change(
        &mut session,
        &[LEAF],
        (1, 2),
        RangeChange::Copy { frame: 0 },
    )
    .unwrap();
    assert_eq!(
        (rows(&session, 1), rows(&session, 2)),
        ([2, 1, 0], [1, 1, 0])
    );
    assert!(
        [1, 2]
            .iter()
            .all(|frame| now(&session).masks[frame].origin == MaskOrigin::Keyframe)
    );
    let error = change(
        &mut session,
        &[STEM],
        (3, 3),
        RangeChange::Copy { frame: 0 },
    )
    .unwrap_err()
    .to_string();
    assert_eq!(error, "frame 0 does not show the labels to copy");
}

#[test]
fn absent_label_does_not_erase_other_labels() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(
        &folder,
        &[keyframe([1, 2, 0]), both([0, 2, 2]), keyframe([0, 1, 1])],
    );
    change(&mut session, &[LEAF], (1, 1), RangeChange::Delete).unwrap();
    let replace = |change| RangeRequest {
        labels: vec![LEAF],
        from: 0,
        to: 2,
        change,
        replace: true,
    };
    assert!(
        perform(
            &mut session,
            Command::Range(replace(RangeChange::Interpolate))
        )
        .is_err(),
        "nothing may change"
    );
    assert_eq!(rows(&session, 1), [0, 2, 2]);
    let settings = TrackSettings {
        labels: vec![LEAF],
        replace: true,
        ..TrackSettings::default()
    };
    let choice = ostra_project::LabelChoice::new(&settings.labels, settings.replace);
    let Some(Edit::SetMask {
        mask: Some(mask), ..
    }) = choice.edit(now(&session), 1, tracked([1, 1, 1]))
    else {
        panic!()
    };
    assert_eq!(mask.runs, tracked([0, 2, 2]).runs);
    change(&mut session, &[LEAF], (1, 1), RangeChange::Restore).unwrap();
    change(&mut session, &[LEAF], (1, 1), RangeChange::Lock).unwrap();
    assert!(
        perform(
            &mut session,
            Command::Range(replace(RangeChange::Copy { frame: 2 }))
        )
        .is_ok()
    );
    assert_eq!(
        [0, 1].map(|frame| rows(&session, frame)),
        [[0, 1, 1], [0, 2, 2]]
    );
}

#[test]
fn label_that_receives_a_merge_or_split_is_no_longer_absent() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(
        &folder,
        &[both([1, 0, 1]), both([1, 0, 1]), both([1, 2, 0])],
    );
    change(&mut session, &[STEM], (0, 2), RangeChange::Delete).unwrap();
    change(
        &mut session,
        &[LEAF],
        (0, 0),
        RangeChange::Merge { into: STEM },
    )
    .unwrap();
    let split = RangeChange::Split {
        frame: 1,
        at_px: DVec2::new(1.0, 2.5),
        into: STEM,
    };
    change(&mut session, &[LEAF], (1, 1), split).unwrap();
    assert_eq!(
        now(&session)
            .marks_of(STEM)
            .absent
            .ranges()
            .collect::<Vec<_>>(),
        [2..=2]
    );
    assert_eq!(
        [0, 1].map(|frame| rows(&session, frame)),
        [[2, 0, 2], [1, 0, 2]]
    );
}
