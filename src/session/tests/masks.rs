mod auto;
mod clicks;
mod painting;

use std::ops::ControlFlow;
use std::path::Path;

use glam::DVec2;

use super::making::{images, perform};
use crate::Event;
use crate::{
    Command, MoveBorderRequest, NewProject, PaintRequest, PromptRequest, RangeChange, RangeRequest,
    Session,
};
use ostra_frames::{FrameFolder, OpenRequest};
use ostra_masks::{Click, LabelId, LabelMask, MaskFormat, Prompt};
use ostra_project::{MaskOrigin, SegmenterId};

const PLANT: LabelId = LabelId(1);
const LEAF: LabelId = LabelId(2);
const STONE: LabelId = LabelId(3);

/// Opens a project of three images with a red bar at columns 20 to 39.
///
/// Its labels are plant, leaf below it, and stone.
fn opened(folder: &Path) -> Session {
    let sources = vec![FrameFolder {
        frames: images(folder),
        depth: None,
    }];
    let open = OpenRequest {
        sources,
        ..OpenRequest::default()
    };
    let mut session = Session::new();
    let new = NewProject {
        root: folder.join("p"),
        open,
        cameras: None,
        intrinsics: None,
    };
    perform(&mut session, Command::New(new)).unwrap();
    for (name, parent) in [("plant", None), ("leaf", Some("plant")), ("stone", None)] {
        let parent = parent.map(str::to_owned);
        perform(
            &mut session,
            Command::AddLabel {
                name: name.into(),
                parent,
                color: None,
            },
        )
        .unwrap();
    }
    session
}

fn click(label: LabelId, points: &[(f64, f64)]) -> Command {
    let clicks = points
        .iter()
        .map(|&(x, y)| Click {
            at_px: DVec2::new(x, y),
            include: true,
        })
        .collect();
    let prompt = Prompt {
        clicks,
        ..Prompt::default()
    };
    Command::Prompt(PromptRequest {
        frame: 0,
        label,
        prompt,
        segmenter: SegmenterId::Builtin,
    })
}

fn square(label: LabelId, from: f64, to: f64, erase: bool, replace: bool) -> Command {
    let corners = [(from, from), (to, from), (to, to), (from, to)];
    let points_px = corners.map(|(x, y)| DVec2::new(x, y)).to_vec();
    Command::Paint(PaintRequest {
        frame: 0,
        label,
        points_px,
        radius_px: 0.0,
        erase,
        replace,
        snap: false,
    })
}

fn mask(session: &Session) -> LabelMask {
    session.project().unwrap().masks[&0].runs.decode()
}

#[test]
fn prompt_segments_and_an_empty_prompt_removes_the_label() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(folder.path());
    perform(&mut session, click(STONE, &[(30.5, 20.5)])).unwrap();
    let region = mask(&session).region(STONE);
    assert!(
        region.at(30, 20) && !region.at(5, 20) && region.area() > 20 * 48 / 2,
        "{}",
        region.area()
    );
    assert_eq!(session.undo_title(), Some("Click on stone, frame 0"));
    assert_eq!(
        session.project().unwrap().masks[&0].origin,
        MaskOrigin::Keyframe
    );
    perform(&mut session, click(STONE, &[])).unwrap();
    assert!(
        session.project().unwrap().masks.is_empty()
            && session.project().unwrap().prompts.is_empty()
    );
    let error = perform(&mut session, click(STONE, &[]))
        .unwrap_err()
        .to_string();
    assert_eq!(error, "label 'stone' is not on frame 0");
}

#[test]
fn clicks_on_a_drawn_mask_correct_it_until_it_is_removed() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(folder.path());
    // The bar from row 10 to row 30, except for a stripe.
    perform(&mut session, square(STONE, 10.0, 30.0, false, true)).unwrap();
    perform(&mut session, square(STONE, 24.0, 27.0, true, true)).unwrap();
    let drawn = mask(&session);
    perform(&mut session, click(STONE, &[(25.5, 25.5)])).unwrap();
    let corrected = mask(&session);
    assert!(
        corrected.at(25, 25) == STONE && corrected.at(12, 12) == STONE,
        "strokes next to the bar stay"
    );
    let changed = (0..drawn.ids.len())
        .filter(|&at| drawn.ids[at] != corrected.ids[at])
        .count();
    assert!((5..20).contains(&changed), "{changed} of 9 pixels");
    let corrects = |session: &Session| session.project().unwrap().prompts[&(0, STONE)].corrects;
    assert!(corrects(&session));
    perform(&mut session, click(STONE, &[(25.5, 25.5), (32.5, 20.5)])).unwrap();
    assert!(corrects(&session), "the second click, too");
    perform(&mut session, Command::Undo).unwrap();
    perform(&mut session, Command::Undo).unwrap();
    perform(&mut session, click(STONE, &[(25.5, 25.5), (32.5, 20.5)])).unwrap();
    let at_once = mask(&session);
    assert!(
        at_once.at(25, 25) == STONE && at_once.at(12, 12) == STONE,
        "two clicks before the first was answered"
    );
    drop(session);
    let mut session = Session::new();
    perform(&mut session, Command::Open(folder.path().join("p"))).unwrap();
    assert!(corrects(&session), "and in the file");
    perform(&mut session, click(STONE, &[(30.5, 20.5)])).unwrap();
    assert!(!corrects(&session), "other clicks begin the mask again");
    perform(&mut session, click(STONE, &[])).unwrap();
    perform(&mut session, click(STONE, &[(30.5, 20.5)])).unwrap();
    assert!(!corrects(&session), "who clicks on nothing begins a mask");
}

#[test]
fn preparing_frames_skips_a_neighbour_that_cannot_be_read() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(folder.path());
    std::fs::write(folder.path().join("pictures/1.png"), "").unwrap();
    session.prepare(0, SegmenterId::Builtin);
    let events = session.settle(|_| ControlFlow::Continue(()));
    assert!(
        !events
            .iter()
            .any(|event| matches!(event, Event::Warning(_))),
        "{events:?}"
    );
}

#[test]
fn newer_prompt_replaces_one_not_yet_answered() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(folder.path());
    session.act(click(STONE, &[(30.5, 20.5)])).unwrap();
    session
        .act(click(STONE, &[(30.5, 20.5), (5.5, 5.5)]))
        .unwrap();
    perform(&mut session, click(STONE, &[(5.5, 5.5)])).unwrap();
    assert_eq!(
        session.project().unwrap().prompts[&(0, STONE)].clicks.len(),
        1
    );
    assert_eq!(mask(&session).at(5, 5), STONE);
    perform(&mut session, Command::Undo).unwrap();
    assert!(session.project().unwrap().prompts.is_empty(), "one step");
    assert_eq!(session.recipe().commands.len(), 1 + 3 + 1 + 1);
}

/// Returns the prompt of a command made by [`click`].
fn request(command: Command) -> PromptRequest {
    let Command::Prompt(request) = command else {
        panic!("{command:?}")
    };
    request
}

#[test]
fn preview_equals_the_click_result_and_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(folder.path());
    let before = session.undo_title().map(str::to_owned);
    session.hover(Some(request(click(STONE, &[(5.5, 5.5)]))));
    session.hover(Some(request(click(STONE, &[(50.5, 5.5)]))));
    session.hover(Some(request(click(STONE, &[(30.5, 20.5)]))));
    session.settle(|_| std::ops::ControlFlow::Continue(()));
    let shown = session.hovered().unwrap().decode();
    assert!(
        session.project().unwrap().masks.is_empty()
            && session.project().unwrap().prompts.is_empty()
    );
    assert_eq!(session.undo_title().map(str::to_owned), before);
    perform(&mut session, click(STONE, &[(30.5, 20.5)])).unwrap();
    assert_eq!(mask(&session), shown, "the newest request was answered");
    assert!(session.hovered().is_none(), "a click ends the preview");
    session.hover(Some(request(click(STONE, &[(200.0, 20.5)]))));
    let events = session.settle(|_| std::ops::ControlFlow::Continue(()));
    assert!(
        session.hovered().is_none() && events.is_empty(),
        "labels that cannot be shown are not reported: {events:?}"
    );
}

#[test]
fn preview_on_a_drawn_mask_equals_the_click_result() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(folder.path());
    perform(&mut session, square(STONE, 10.0, 30.0, false, true)).unwrap();
    perform(&mut session, square(LEAF, 24.0, 27.0, false, true)).unwrap();
    for clicks in [&[(25.5, 25.5)][..], &[(25.5, 25.5), (35.5, 20.5)]] {
        session.hover(Some(request(click(STONE, clicks))));
        session.settle(|_| ControlFlow::Continue(()));
        let preview = session.hovered().unwrap().region(STONE);
        perform(&mut session, click(STONE, clicks)).unwrap();
        assert_eq!(mask(&session).region(STONE), preview, "{clicks:?}");
    }
}

#[test]
fn parts_and_other_prompted_labels_keep_their_pixels() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(folder.path());
    perform(&mut session, click(LEAF, &[(30.5, 20.5)])).unwrap();
    let leaf = mask(&session).region(LEAF);
    perform(&mut session, click(PLANT, &[(5.5, 5.5), (30.5, 46.5)])).unwrap();
    let after = mask(&session);
    assert_eq!(after.at(5, 5), PLANT);
    let lost = (0..leaf.inside.len())
        .filter(|&k| leaf.inside[k] && after.ids[k] != LEAF)
        .count();
    assert!(
        lost <= 1,
        "the part keeps all but the pixel that was clicked: {lost}"
    );
    perform(&mut session, click(STONE, &[(50.5, 40.5)])).unwrap();
    let taken = (0..leaf.inside.len())
        .filter(|&k| after.ids[k] == LEAF && mask(&session).ids[k] == STONE)
        .count();
    assert_eq!(taken, 0);
}

#[test]
fn exported_masks_are_imported_as_keyframes() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(folder.path());
    perform(&mut session, square(LEAF, 3.0, 12.0, false, false)).unwrap();
    let painted = session.project().unwrap().masks.clone();
    for format in [MaskFormat::Davis, MaskFormat::Binary, MaskFormat::Coco] {
        let dir = folder.path().join(format.name());
        perform(
            &mut session,
            Command::ExportMasks {
                dir: dir.clone(),
                format,
                overwrite: false,
            },
        )
        .unwrap();
        perform(&mut session, Command::ClearMask { frame: 0 }).unwrap();
        perform(&mut session, Command::ImportMasks { dir, format }).unwrap();
        let masks = &session.project().unwrap().masks;
        assert_eq!(masks[&0], painted[&0], "{format:?}");
    }
    let unknown = r#"{"import_masks": {"dir": "masks", "format": "bmp"}}"#;
    let error = serde_json::from_str::<Command>(unknown).unwrap_err();
    assert!(error.to_string().contains("`yolo`"), "{error}");
}

#[test]
fn unknown_and_uninstalled_engines_are_rejected() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(folder.path());
    let mut prompted = |segmenter: SegmenterId| {
        let Command::Prompt(request) = click(LEAF, &[(30.5, 20.5)]) else {
            unreachable!()
        };
        let request = PromptRequest {
            segmenter,
            ..request
        };
        perform(&mut session, Command::Prompt(request))
            .unwrap_err()
            .to_string()
    };
    assert_eq!(
        "sum".parse::<SegmenterId>().unwrap_err().to_string(),
        "there is no segmenter 'sum'; choose one of auto, sam, sam-close, geometry, builtin"
    );
    assert!(
        prompted(SegmenterId::Sam).starts_with("'sam' is not installed: it needs"),
        "{}",
        prompted(SegmenterId::Sam)
    );
}

#[test]
fn added_frames_get_free_names_and_moved_frames_are_found() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = opened(folder.path());
    let more = images(&folder.path().join("more"));
    let sources = vec![FrameFolder {
        frames: more.clone(),
        depth: None,
    }];
    let open = OpenRequest {
        sources,
        ..OpenRequest::default()
    };
    let new = NewProject {
        root: Path::new("ignored").into(),
        open,
        cameras: None,
        intrinsics: None,
    };
    perform(&mut session, Command::AddFrames(new)).unwrap();
    let names: Vec<_> = session
        .project()
        .unwrap()
        .frames
        .iter()
        .map(|frame| frame.name.clone())
        .collect();
    assert_eq!(
        names,
        [
            "0.png",
            "1.png",
            "2.png",
            "pictures/0.png",
            "pictures/1.png",
            "pictures/2.png"
        ]
    );
    let moved = folder.path().join("moved");
    std::fs::rename(&more, &moved).unwrap();
    let to_nothing = Command::Relocate {
        from: more.clone(),
        to: folder.path().join("nowhere"),
    };
    assert!(
        perform(&mut session, to_nothing)
            .unwrap_err()
            .to_string()
            .contains("0.png: is missing")
    );
    perform(
        &mut session,
        Command::Relocate {
            from: more.clone(),
            to: moved,
        },
    )
    .unwrap();
    let project = session.project().unwrap().clone();
    assert!(session.store().image(&project.frames[4]).is_ok());
    let again = Command::Relocate {
        from: more,
        to: folder.path().into(),
    };
    assert!(
        perform(&mut session, again)
            .unwrap_err()
            .to_string()
            .contains("no frame comes from")
    );
}
