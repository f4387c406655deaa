//! Tests of marks that change during a job, and of changes in any order.

use super::*;

#[test]
fn job_overtaken_by_marks_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(
        &folder,
        &[keyframe([1, 0, 0]), both([0, 0, 0]), keyframe([0, 0, 1])],
    );
    let request = |change| RangeRequest {
        labels: vec![LEAF],
        from: 0,
        to: 2,
        change,
        replace: false,
    };
    session
        .act(Command::Range(request(RangeChange::Interpolate)))
        .unwrap();
    session
        .act(Command::Range(request(RangeChange::Lock)))
        .unwrap();
    let events = session.settle(|_| std::ops::ControlFlow::Continue(()));
    let overtaken =
        |event: &Event| matches!(event, Event::Failed { error, .. } if error.contains("meanwhile"));
    assert!(events.iter().any(overtaken), "{events:?}");
    assert_eq!(rows(&session, 1), [0, 0, 0]);
}

fn any_change() -> impl Strategy<Value = RangeChange> {
    prop_oneof![
        Just(RangeChange::Delete),
        Just(RangeChange::Restore),
        Just(RangeChange::Lock),
        Just(RangeChange::Unlock),
        Just(RangeChange::Hide),
        Just(RangeChange::Show),
        Just(RangeChange::Merge { into: LEAF }),
        (0usize..5, 0.0..4.0, 0.0..3.0).prop_map(|(frame, x, y)| RangeChange::Split {
            frame,
            at_px: DVec2::new(x, y),
            into: STEM
        }),
        Just(RangeChange::Interpolate),
        (0usize..5).prop_map(|frame| RangeChange::Copy { frame }),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Frames outside the range, locked labels and labels not in the request keep their pixels.
    ///
    /// Undo restores the start.
    #[test]
    fn only_requested_labels_and_frames_change(
        masks in proptest::collection::vec((proptest::array::uniform3(0u16..3), any::<bool>()), 5),
        locked in (0u16..3, 0usize..5),
        changes in proptest::collection::vec((any_change(), 0u16..3, 0usize..5, 0usize..5, any::<bool>()), 1..5),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let masks: Vec<_> = masks.into_iter().map(|(ids, is)| if is { keyframe(ids) } else { both(ids) }).collect();
        let mut session = opened(&folder, &masks);
        if locked.0 > 0 {
            change(&mut session, &[LabelId(locked.0)], (locked.1, 4), RangeChange::Lock).unwrap();
        }
        let start = Project::clone(now(&session));
        let mut done = 0;
        for (what, label, from, to, replace) in changes {
            let labels: Vec<LabelId> = (label > 0).then_some(LabelId(label)).into_iter().collect();
            let before = Project::clone(now(&session));
            let request = RangeRequest { labels: labels.clone(), from, to, change: what, replace };
            if perform(&mut session, Command::Range(request)).is_err() {
                prop_assert_eq!(now(&session), &before, "what is refused changes nothing");
                continue;
            }
            done += 1;
            for (&frame, mask) in &before.masks {
                let after = &now(&session).masks[&frame];
                if frame < from || frame > to {
                    prop_assert_eq!(&after.runs, &mask.runs);
                }
                for id in before.locked_on(frame) {
                    prop_assert_eq!(after.runs.region(id), mask.runs.region(id));
                }
                let gives = replace || matches!(what, RangeChange::Merge { .. } | RangeChange::Split { .. });
                for id in [LEAF, STEM] {
                    if !labels.is_empty() && !labels.contains(&id) && !gives {
                        prop_assert_eq!(after.runs.region(id), mask.runs.region(id));
                    }
                }
            }
        }
        for _ in 0..done {
            session.undo().unwrap();
        }
        prop_assert_eq!(now(&session), &start);
    }
}
