use proptest::prelude::*;

use super::making::{camera, frame, keyframe, label, mask, project, record, tracked};
use ostra_frames::{DepthSource, FrameSet};
use ostra_masks::{Click, LabelId, Prompt};
use ostra_project::{Edit, FrameMask, Marks, MaskOrigin, Project, ResultKind};

fn prompt(x: f64) -> Prompt {
    Prompt {
        clicks: vec![Click {
            at_px: glam::DVec2::new(x, 1.1),
            include: x < 1.0,
        }],
        ..Prompt::default()
    }
}

fn any_mask() -> impl Strategy<Value = Option<FrameMask>> {
    let ids = proptest::array::uniform3(0u16..4);
    prop_oneof![
        1 => Just(None),
        3 => ids.clone().prop_map(|ids| Some(keyframe(ids))),
        3 => ids.clone().prop_map(|ids| Some(tracked(ids))),
        1 => (ids, any::<bool>()).prop_map(|(ids, stale)| Some(mask(ids, MaskOrigin::Tracked, stale))),
    ]
}

fn any_kind() -> impl Strategy<Value = ResultKind> {
    prop_oneof![
        Just(ResultKind::Tracking),
        Just(ResultKind::Cameras),
        Just(ResultKind::Depths),
        Just(ResultKind::Cloud)
    ]
}

fn any_marks() -> impl Strategy<Value = Marks> {
    let set = || proptest::collection::vec((0usize..7, 0usize..7), 0..2).prop_map(FrameSet::from);
    (set(), set(), set()).prop_map(|(absent, locked, hidden)| Marks {
        absent,
        locked,
        hidden,
    })
}

/// Returns edits of every kind, many of which do not fit the state to which they are applied.
pub fn any_edit() -> impl Strategy<Value = Edit> {
    let number = 0usize..7;
    let id = 0u16..4;
    prop_oneof![
        (
            id.clone(),
            any::<bool>(),
            "[ab]{1}",
            proptest::option::of(1u16..4)
        )
            .prop_map(|(id, some, name, parent)| {
                let made = ostra_masks::Label {
                    parent: parent.map(LabelId),
                    ..label(id, &name)
                };
                Edit::SetLabel {
                    id: LabelId(id),
                    label: some.then_some(made),
                }
            }),
        (number.clone(), id, proptest::option::of(0.0..4.0)).prop_map(|(frame, id, x)| {
            Edit::SetPrompt {
                frame,
                label: LabelId(id),
                prompt: x.map(prompt),
            }
        }),
        (number.clone(), any_mask()).prop_map(|(frame, mask)| Edit::SetMask { frame, mask }),
        (number.clone(), any_mask()).prop_map(|(frame, mask)| Edit::SetMask { frame, mask }),
        (0u16..4, any_marks()).prop_map(|(id, marks)| Edit::SetMarks {
            label: LabelId(id),
            marks
        }),
        (
            proptest::collection::vec(number.clone(), 0..5),
            any::<bool>()
        )
            .prop_map(|(frames, stale)| Edit::SetStale { frames, stale }),
        (number.clone(), proptest::option::of(-1.0..1.0)).prop_map(|(frame, shift)| {
            Edit::SetCamera {
                frame,
                camera: shift.map(camera),
            }
        }),
        (number.clone(), proptest::option::of(0.0..2.0)).prop_map(|(frame, scale)| {
            Edit::SetDepth {
                frame,
                depth: scale.map(|scale| DepthSource::Estimated {
                    made: "versions/depths-1/a.tiff".into(),
                    scale,
                }),
            }
        }),
        "[c-f]{1}".prop_map(|name| Edit::AddFrames {
            frames: vec![frame(&name)]
        }),
        (0usize..8).prop_map(|keep| Edit::DropFrames { keep }),
        (number, 4u32..6).prop_map(|(at, width)| {
            let names = [
                "a/0.png", "a/1.png", "b/0.png", "b/1.jpg", "b/1.png", "c", "d",
            ];
            Edit::SetFrame {
                frame: at,
                value: Box::new(ostra_frames::Frame {
                    width,
                    ..frame(names[at])
                }),
            }
        }),
        (any_kind(), proptest::option::of("geometry|flow")).prop_map(|(kind, engine)| {
            Edit::SetResult {
                kind,
                record: engine.as_deref().map(record),
            }
        }),
    ]
}

/// Applies the edits that fit and returns each with its inverse.
///
/// Checks that rejected edits change nothing.
fn apply_all(project: &mut Project, edits: Vec<Edit>) -> Vec<(Edit, Edit)> {
    let mut done = Vec::new();
    for edit in edits {
        let before = project.clone();
        match project.apply(edit.clone()) {
            Ok(inverse) => done.push((edit, inverse)),
            Err(_) => assert_eq!(*project, before, "a refused edit changes nothing"),
        }
    }
    done
}

proptest! {
    #[test]
    fn undo_restores_the_start_and_redo_the_end(edits in proptest::collection::vec(any_edit(), 1..60)) {
        let start = project();
        let mut now = start.clone();
        let done = apply_all(&mut now, edits);
        let end = now.clone();
        for (_, inverse) in done.iter().rev() {
            now.apply(inverse.clone()).unwrap();
        }
        prop_assert_eq!(&now, &start);
        for (edit, _) in done {
            now.apply(edit).unwrap();
        }
        prop_assert_eq!(&now, &end);
    }

    #[test]
    fn edits_survive_json(edit in any_edit()) {
        let line = serde_json::to_string(&edit).unwrap();
        prop_assert_eq!(serde_json::from_str::<Edit>(&line).unwrap(), edit);
    }
}

#[test]
fn invalid_edits_are_rejected() {
    let mut project = project();
    let refused = [
        Edit::SetMask {
            frame: 9,
            mask: None,
        },
        Edit::SetMask {
            frame: 0,
            mask: Some(keyframe([7, 0, 0])),
        },
        Edit::SetMask {
            frame: 0,
            mask: Some(FrameMask {
                stale: true,
                ..keyframe([1, 0, 0])
            }),
        },
        Edit::SetPrompt {
            frame: 0,
            label: LabelId(1),
            prompt: Some(prompt(f64::NAN)),
        },
        Edit::SetPrompt {
            frame: 0,
            label: LabelId(1),
            prompt: Some(Prompt::default()),
        },
        Edit::SetCamera {
            frame: 0,
            camera: Some(camera(f64::INFINITY)),
        },
        Edit::SetDepth {
            frame: 0,
            depth: Some(DepthSource::Estimated {
                made: "../outside.tiff".into(),
                scale: 1.0,
            }),
        },
        Edit::SetDepth {
            frame: 0,
            depth: Some(DepthSource::Estimated {
                made: "a.tiff".into(),
                scale: 0.0,
            }),
        },
        Edit::AddFrames {
            frames: vec![frame("../outside.png")],
        },
        Edit::AddFrames {
            frames: vec![frame("a/0.png")],
        },
        Edit::AddFrames {
            frames: vec![frame("/outside.png")],
        },
    ];
    for edit in refused {
        let error = project.apply(edit.clone()).expect_err(&format!("{edit:?}"));
        assert!(!error.to_string().contains('\n'), "{error}");
    }
    let smaller = ostra_masks::RunMask::empty(2, 2);
    let mask = FrameMask {
        runs: smaller.into(),
        ..keyframe([0; 3])
    };
    let error = project
        .apply(Edit::SetMask {
            frame: 0,
            mask: Some(mask),
        })
        .unwrap_err()
        .to_string();
    assert_eq!(
        error,
        "a/0.png: the mask has 2×2 pixels, the frame 4×3; give a mask of the frame's size"
    );
}

#[test]
fn label_in_use_cannot_be_removed() {
    let mut project = project();
    project
        .apply(Edit::SetMask {
            frame: 0,
            mask: Some(keyframe([1, 0, 0])),
        })
        .unwrap();
    assert!(
        project
            .apply(Edit::SetLabel {
                id: LabelId(1),
                label: None
            })
            .is_err()
    );
    assert!(
        project
            .apply(Edit::SetLabel {
                id: LabelId(2),
                label: None
            })
            .is_ok()
    );
}
