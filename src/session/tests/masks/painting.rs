//! Tests of brush, eraser and dragged borders.

use super::*;

#[test]
fn brush_and_eraser_make_keyframes() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(folder.path());
    perform(&mut session, square(STONE, 0.0, 10.0, false, false)).unwrap();
    perform(&mut session, square(LEAF, 5.0, 15.0, false, false)).unwrap();
    assert_eq!(
        (mask(&session).at(7, 7), mask(&session).at(12, 12)),
        (STONE, LEAF)
    );
    perform(&mut session, square(LEAF, 5.0, 15.0, false, true)).unwrap();
    assert_eq!(mask(&session).at(7, 7), LEAF);
    perform(&mut session, square(LEAF, 0.0, 64.0, true, false)).unwrap();
    assert_eq!(
        (mask(&session).at(7, 7), mask(&session).at(2, 2)),
        (LabelId::NONE, STONE)
    );
    assert_eq!(session.undo_title(), Some("Erase leaf on frame 0"));
    perform(&mut session, Command::RemoveLabel(STONE)).unwrap();
    assert!(mask(&session).ids.iter().all(|&id| id == LabelId::NONE));
    let error = perform(&mut session, Command::RemoveLabel(PLANT))
        .unwrap_err()
        .to_string();
    assert!(error.contains("still has the child 'leaf'"), "{error}");
    perform(&mut session, Command::ClearMask { frame: 0 }).unwrap();
    assert!(session.project().unwrap().masks.is_empty());
}

#[test]
fn dragged_border_is_one_undoable_step_and_respects_locks() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(folder.path());
    let pull = |label, to: f64| {
        let (from_px, to_px) = (DVec2::new(12.0, 7.0), DVec2::new(to, 7.0));
        Command::MoveBorder(MoveBorderRequest {
            frame: 0,
            label,
            from_px,
            to_px,
            replace: true,
        })
    };
    let error = perform(&mut session, pull(LEAF, 16.0)).unwrap_err();
    assert!(
        format!("{error:#}").contains("border of 'leaf' on frame 0"),
        "{error:#}"
    );
    perform(&mut session, square(LEAF, 3.0, 12.0, false, false)).unwrap();
    let before = mask(&session);
    perform(&mut session, pull(LEAF, 16.0)).unwrap();
    let pulled = mask(&session);
    assert_eq!(
        (before.at(13, 7), pulled.at(13, 7), pulled.at(13, 1)),
        (LabelId::NONE, LEAF, LabelId::NONE)
    );
    assert_eq!(session.undo_title(), Some("Move border of leaf on frame 0"));
    perform(&mut session, Command::Undo).unwrap();
    assert_eq!(mask(&session), before);
    perform(&mut session, square(STONE, 30.0, 40.0, false, false)).unwrap();
    let (from_px, to_px) = (DVec2::new(12.0, 7.0), DVec2::new(12.0, 7.0));
    perform(
        &mut session,
        Command::MoveBorder(MoveBorderRequest {
            frame: 0,
            label: LEAF,
            from_px,
            to_px,
            replace: true,
        }),
    )
    .unwrap();
    assert_eq!(
        session.undo_title(),
        Some("Paint stone on frame 0"),
        "what changes nothing is no step"
    );
    let lock = RangeRequest {
        labels: vec![LEAF],
        from: 0,
        to: 0,
        change: RangeChange::Lock,
        replace: false,
    };
    perform(&mut session, Command::Range(lock)).unwrap();
    let error = perform(&mut session, pull(LEAF, 16.0))
        .unwrap_err()
        .to_string();
    assert!(error.contains("locked"), "{error}");
}

#[test]
fn snapping_brush_stops_at_the_edge_and_is_one_step() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(folder.path());
    let stroke = |snap| {
        let points_px = vec![DVec2::new(33.0, 10.0), DVec2::new(33.0, 38.0)];
        let request = PaintRequest {
            frame: 0,
            label: LEAF,
            points_px,
            radius_px: 12.0,
            erase: false,
            replace: true,
            snap,
        };
        Command::Paint(request)
    };
    perform(&mut session, stroke(false)).unwrap();
    assert_eq!(
        (mask(&session).at(37, 24), mask(&session).at(43, 24)),
        (LEAF, LEAF),
        "the plain brush spills"
    );
    perform(&mut session, Command::Undo).unwrap();
    perform(&mut session, stroke(true)).unwrap();
    assert_eq!(
        (mask(&session).at(37, 24), mask(&session).at(43, 24)),
        (LEAF, LabelId::NONE)
    );
    assert_eq!(session.undo_title(), Some("Paint leaf on frame 0"));
    assert_eq!(
        session.project().unwrap().masks[&0].origin,
        MaskOrigin::Keyframe
    );
    let plain = serde_json::json!({
        "frame": 0, "label": 2, "points_px": [[1.0, 2.0]], "radius_px": 3.0, "erase": false, "replace": true
    });
    assert!(
        !serde_json::from_value::<PaintRequest>(plain).unwrap().snap,
        "recipes from before still run"
    );
}
