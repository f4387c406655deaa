//! Tests of the pointer tools on the image.

use egui::{Key, Modifiers, PointerButton};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use ostra_app::Tool;
use ostra_masks::{ElasticBorders, LabelId};
use ostra_session::{Command, MoveBorderRequest, PaintRequest, PromptRequest, TraceRequest};

use crate::desk::{
    Desk, button_event, choose_more, click_at, drag, drag_fast, drag_in_two_frames, flick, hold,
    on_screen, press,
};

fn prompts(requested: &[Command]) -> Vec<&PromptRequest> {
    requested
        .iter()
        .filter_map(|command| {
            if let Command::Prompt(request) = command {
                Some(request)
            } else {
                None
            }
        })
        .collect()
}

fn paints(requested: &[Command]) -> Vec<&PaintRequest> {
    requested
        .iter()
        .filter_map(|command| {
            if let Command::Paint(request) = command {
                Some(request)
            } else {
                None
            }
        })
        .collect()
}

/// Presses Escape with the button held, moves the pointer and releases the button.
fn escape_and_let_go(harness: &mut Harness<'_, Desk>, at: egui::Pos2) {
    press(harness, Modifiers::NONE, Key::Escape);
    harness.hover_at(at);
    harness.run_steps(1);
    harness.drop_at(at);
    harness.run_steps(2);
}

#[test]
fn left_click_includes_and_right_click_excludes_the_pixel_under_the_pointer() {
    let mut harness = Desk::sample().shown();
    let (first, second) = (
        on_screen(&harness, 12.5, 30.5),
        on_screen(&harness, 50.5, 8.5),
    );
    click_at(&mut harness, first, PointerButton::Primary);
    click_at(&mut harness, second, PointerButton::Secondary);
    let requested = prompts(&harness.state().requested);
    assert_eq!(requested.len(), 2, "{:?}", harness.state().requested);
    let clicks = &requested[1].prompt.clicks;
    assert_eq!(clicks.len(), 2, "the second prompt keeps the first click");
    assert!((clicks[0].at_px - glam::DVec2::new(12.5, 30.5)).length() < 0.1 && clicks[0].include);
    assert!((clicks[1].at_px - glam::DVec2::new(50.5, 8.5)).length() < 0.1 && !clicks[1].include);
    assert_eq!((requested[1].frame, requested[1].label), (0, LabelId(1)));
}

#[test]
fn dragging_makes_a_box_and_escape_drops_it() {
    let mut harness = Desk::sample().shown();
    let (from, to) = (
        on_screen(&harness, 40.0, 30.0),
        on_screen(&harness, 10.0, 12.0),
    );
    drag(&mut harness, from, to, PointerButton::Primary);
    let px_box = prompts(&harness.state().requested)[0].prompt.boxes[0];
    assert!(
        (px_box.min_px - glam::DVec2::new(10.0, 12.0)).length() < 0.3,
        "{px_box:?}"
    );
    assert!(
        (px_box.max_px - glam::DVec2::new(40.0, 30.0)).length() < 0.3,
        "{px_box:?}"
    );

    harness.state_mut().requested.clear();
    hold(&mut harness, from, to);
    escape_and_let_go(&mut harness, from);
    assert!(prompts(&harness.state().requested).is_empty());
}

/// Returns a place on the border of label 2 on the first frame, in image pixels.
fn border_of_leaf(harness: &Harness<'_, Desk>) -> glam::DVec2 {
    let region = harness.state().project.masks[&0]
        .runs
        .decode()
        .region(LabelId(2));
    ElasticBorders::of(&region)
        .nearest(glam::DVec2::new(17.0, 21.0))
        .unwrap()
}

#[test]
fn box_and_border_obey_a_drag_within_one_or_two_slow_frames() {
    let whole = |harness: &mut Harness<'_, Desk>, from, to| {
        flick(harness, &[from, to], PointerButton::Primary);
    };
    for (way, drag) in [
        (
            "two frames",
            drag_in_two_frames as fn(&mut Harness<'_, Desk>, _, _),
        ),
        ("one frame", whole),
    ] {
        let mut harness = Desk::sample().shown();
        let (from, to) = (
            on_screen(&harness, 10.0, 12.0),
            on_screen(&harness, 40.0, 30.0),
        );
        drag(&mut harness, from, to);
        let requested = prompts(&harness.state().requested);
        let [PromptRequest { prompt, .. }] = &requested[..] else {
            panic!("{way}: {:?}", harness.state().requested)
        };
        assert!(prompt.clicks.is_empty(), "{way}");
        let corner = prompt.boxes[0].min_px;
        assert!(
            corner.distance(glam::DVec2::new(10.0, 12.0)) < 0.3,
            "{way}: {corner}"
        );

        harness.state_mut().requested.clear();
        harness.state_mut().shell.view.label = Some(LabelId(2));
        harness.state_mut().shell.view.tool = Tool::Border;
        let border = border_of_leaf(&harness);
        let from = on_screen(&harness, border.x as f32, border.y as f32);
        let to = on_screen(&harness, border.x as f32 + 6.0, border.y as f32);
        drag(&mut harness, from, to);
        assert_eq!(pulls(&harness.state().requested).len(), 1, "{way}");
    }
}

#[test]
fn slow_frame_that_ends_one_drag_and_begins_the_next_gives_both_boxes() {
    let mut harness = Desk::sample().shown();
    let at = |x, y| on_screen(&harness, x, y);
    let first = [at(10.0, 12.0), at(25.0, 20.0)];
    let second = [at(30.0, 25.0), at(50.0, 40.0)];
    let press = |pos, pressed| button_event(pos, PointerButton::Primary, pressed);
    let moved = egui::Event::PointerMoved;
    harness.hover_at(first[0]);
    harness.run_steps(1);
    for events in [
        vec![press(first[0], true)],
        vec![
            moved(first[1]),
            press(first[1], false),
            moved(second[0]),
            press(second[0], true),
        ],
        vec![moved(second[1]), press(second[1], false)],
    ] {
        harness.input_mut().events.extend(events);
        harness.run_steps(1);
    }
    harness.run_steps(2);
    let requested = prompts(&harness.state().requested);
    let corners: Vec<glam::DVec2> = requested
        .iter()
        .filter_map(|request| request.prompt.boxes.last())
        .map(|px_box| px_box.min_px)
        .collect();
    assert_eq!(corners.len(), 2, "{requested:?}");
    for (corner, expected) in corners.into_iter().zip([(10.0, 12.0), (30.0, 25.0)]) {
        assert!(corner.distance(expected.into()) < 0.3, "{corner}");
    }
}

#[test]
fn clicks_outside_the_image_request_nothing() {
    let mut harness = Desk::sample().shown();
    let outside = on_screen(&harness, -0.5, 20.0);
    click_at(&mut harness, outside, PointerButton::Primary);
    assert!(
        harness.state().requested.is_empty(),
        "{:?}",
        harness.state().requested
    );
}

#[test]
fn first_click_creates_a_label() {
    let mut desk = Desk::sample();
    desk.project.labels = Default::default();
    desk.project.masks.clear();
    let mut harness = desk.shown();
    let at = on_screen(&harness, 5.5, 5.5);
    click_at(&mut harness, at, PointerButton::Primary);
    let requested = &harness.state().requested;
    assert!(
        matches!(&requested[0], Command::AddLabel { name, .. } if name == "object 1"),
        "{requested:?}"
    );
    assert_eq!(prompts(requested)[0].label, LabelId(1));
}

#[test]
fn brush_paints_along_the_pointer_path_and_right_button_erases() {
    let mut harness = Desk::sample().shown();
    harness.state_mut().shell.view.tool = Tool::Brush;
    let (from, to) = (
        on_screen(&harness, 10.0, 10.0),
        on_screen(&harness, 30.0, 10.0),
    );
    drag(&mut harness, from, to, PointerButton::Primary);
    drag(&mut harness, from, to, PointerButton::Secondary);
    let requested = paints(&harness.state().requested);
    assert_eq!(
        requested
            .iter()
            .map(|paint| paint.erase)
            .collect::<Vec<_>>(),
        [false, true]
    );
    let points = &requested[0].points_px;
    assert!(
        points.len() >= 4 && points.iter().all(|p| (p.y - 10.0).abs() < 0.3),
        "{points:?}"
    );
    assert!((points[0].x - 10.0).abs() < 0.3 && (points[points.len() - 1].x - 30.0).abs() < 0.3);
    assert!(requested[0].radius_px > 0.0);
}

#[test]
fn brush_follows_the_whole_pointer_path_while_frames_are_slow() {
    let mut harness = Desk::sample().shown();
    harness.state_mut().shell.view.tool = Tool::Brush;
    let corners = [
        [10.0, 10.0],
        [30.0, 10.0],
        [30.0, 30.0],
        [10.0, 30.0],
        [10.0, 20.0],
        [20.0, 20.0],
    ];
    let places = corners.map(|[x, y]| on_screen(&harness, x, y));
    drag_fast(&mut harness, &places, PointerButton::Primary);
    let requested = paints(&harness.state().requested);
    let [paint] = &requested[..] else {
        panic!("one stroke: {}", requested.len())
    };
    assert_eq!(
        paint.points_px.len(),
        corners.len(),
        "{:?}",
        paint.points_px
    );
    for (at, [x, y]) in paint.points_px.iter().zip(corners) {
        assert!(
            (at.x - f64::from(x)).abs() < 0.3 && (at.y - f64::from(y)).abs() < 0.3,
            "{:?}",
            paint.points_px
        );
    }
}

#[test]
fn brush_tap_within_one_frame_paints_a_dot() {
    let mut harness = Desk::sample().shown();
    harness.state_mut().shell.view.tool = Tool::Brush;
    let at = on_screen(&harness, 20.0, 10.0);
    for button in [PointerButton::Primary, PointerButton::Secondary] {
        flick(&mut harness, &[at], button);
    }
    let requested = paints(&harness.state().requested);
    assert_eq!(
        requested
            .iter()
            .map(|paint| paint.erase)
            .collect::<Vec<_>>(),
        [false, true]
    );
    for paint in requested {
        let [point] = paint.points_px[..] else {
            panic!("one place: {:?}", paint.points_px)
        };
        assert!(
            (point - glam::DVec2::new(20.0, 10.0)).length() < 0.3,
            "{point}"
        );
    }
}

#[test]
fn stroke_ends_when_the_pointer_leaves_and_next_press_begins_another() {
    let mut harness = Desk::sample().shown();
    harness.state_mut().shell.view.tool = Tool::Brush;
    let (from, to) = (
        on_screen(&harness, 10.0, 10.0),
        on_screen(&harness, 30.0, 20.0),
    );
    hold(&mut harness, from, to);
    harness.remove_cursor();
    harness.run_steps(2);
    assert_eq!(
        paints(&harness.state().requested).len(),
        1,
        "the release of the button may never be reported"
    );
    harness.hover_at(from);
    harness.run_steps(2);
    assert!(harness.state().shell.view.draft.stroke.is_none());
    drag(&mut harness, from, to, PointerButton::Secondary);
    let requested = paints(&harness.state().requested);
    assert_eq!(
        requested
            .iter()
            .map(|paint| paint.erase)
            .collect::<Vec<_>>(),
        [false, true]
    );
}

#[test]
fn brush_stroke_within_one_frame_is_painted_whole() {
    let mut harness = Desk::sample().shown();
    harness.state_mut().shell.view.tool = Tool::Brush;
    let places = [[10.0, 10.0], [20.0, 10.0], [30.0, 10.0]].map(|[x, y]| on_screen(&harness, x, y));
    flick(&mut harness, &places, PointerButton::Primary);
    let requested = paints(&harness.state().requested);
    let [paint] = &requested[..] else {
        panic!("one stroke: {}", requested.len())
    };
    assert_eq!(paint.points_px.len(), places.len(), "{:?}", paint.points_px);
}

#[test]
fn escape_drops_the_current_stroke_until_the_next_press() {
    let mut harness = Desk::sample().shown();
    harness.state_mut().shell.view.tool = Tool::Brush;
    let (from, to) = (
        on_screen(&harness, 10.0, 10.0),
        on_screen(&harness, 30.0, 20.0),
    );
    hold(&mut harness, from, to);
    assert!(harness.state().shell.view.draft.stroke.is_some());
    escape_and_let_go(&mut harness, from);
    assert!(
        harness.state().requested.is_empty(),
        "{:?}",
        harness.state().requested
    );
    drag(&mut harness, from, to, PointerButton::Primary);
    assert_eq!(paints(&harness.state().requested).len(), 1);
}

#[test]
fn brush_snaps_while_the_option_is_checked() {
    let mut harness = Desk::sample().shown();
    harness.state_mut().shell.view.tool = Tool::Brush;
    harness.run_steps(2);
    let (from, to) = (
        on_screen(&harness, 10.0, 10.0),
        on_screen(&harness, 30.0, 10.0),
    );
    drag(&mut harness, from, to, PointerButton::Primary);
    choose_more(&mut harness, "Snap brush to edges");
    assert!(harness.state().shell.view.prefs.snap);
    drag(&mut harness, from, to, PointerButton::Primary);
    press(&mut harness, Modifiers::NONE, Key::S);
    drag(&mut harness, from, to, PointerButton::Primary);
    let snaps: Vec<bool> = paints(&harness.state().requested)
        .iter()
        .map(|paint| paint.snap)
        .collect();
    assert_eq!(snaps, [false, true, false]);
}

#[test]
fn polygon_is_filled_when_the_first_corner_is_clicked_again() {
    let mut harness = Desk::sample().shown();
    press(&mut harness, Modifiers::NONE, Key::G);
    for (x, y) in [(10.0, 10.0), (40.0, 12.0), (30.0, 35.0), (10.0, 10.0)] {
        let at = on_screen(&harness, x, y);
        click_at(&mut harness, at, PointerButton::Primary);
        harness.run_steps(30);
    }
    let requested = paints(&harness.state().requested);
    assert_eq!(requested.len(), 1);
    assert_eq!(
        (requested[0].points_px.len(), requested[0].radius_px),
        (3, 0.0)
    );
}

#[test]
fn lasso_fills_on_release_and_erases_with_ctrl() {
    let mut harness = Desk::sample().shown();
    press(&mut harness, Modifiers::NONE, Key::G);
    let places = [[10.0, 10.0], [30.0, 10.0], [30.0, 30.0], [10.0, 30.0]]
        .map(|[x, y]| on_screen(&harness, x, y));
    drag_fast(&mut harness, &places, PointerButton::Primary);
    let requested = paints(&harness.state().requested);
    let [lasso] = &requested[..] else {
        panic!("one lasso: {:?}", harness.state().requested)
    };
    assert_eq!(
        (lasso.radius_px, lasso.erase, lasso.label),
        (0.0, false, LabelId(1))
    );
    assert!(lasso.points_px.len() >= 4, "{:?}", lasso.points_px);
    assert!(
        lasso
            .points_px
            .iter()
            .all(|p| (9.5..30.5).contains(&p.x) && (9.5..30.5).contains(&p.y))
    );
    assert!(
        !harness.state().shell.view.draft.is_half_made(),
        "the next one begins again"
    );

    harness.state_mut().requested.clear();
    for (x, y) in [(10.0, 10.0), (40.0, 12.0), (30.0, 35.0)] {
        let at = on_screen(&harness, x, y);
        click_at(&mut harness, at, PointerButton::Primary);
        harness.run_steps(30);
    }
    drag(&mut harness, places[0], places[2], PointerButton::Primary);
    assert!(
        harness.state().requested.is_empty(),
        "corners are not ended by a drag"
    );
    press(&mut harness, Modifiers::COMMAND, Key::Enter);
    let requested = paints(&harness.state().requested);
    assert_eq!(
        requested
            .iter()
            .map(|paint| (paint.points_px.len(), paint.erase))
            .collect::<Vec<_>>(),
        [(3, true)]
    );
}

#[test]
fn escape_drops_the_current_lasso() {
    let mut harness = Desk::sample().shown();
    press(&mut harness, Modifiers::NONE, Key::G);
    let (from, to) = (
        on_screen(&harness, 10.0, 10.0),
        on_screen(&harness, 30.0, 20.0),
    );
    hold(&mut harness, from, to);
    assert!(harness.state().shell.view.draft.lasso.is_some());
    escape_and_let_go(&mut harness, from);
    assert!(
        paints(&harness.state().requested).is_empty()
            && harness.state().shell.view.draft.corners.is_empty()
    );
}

/// Returns the requested border moves.
fn pulls(requested: &[Command]) -> Vec<&MoveBorderRequest> {
    requested
        .iter()
        .filter_map(|command| {
            if let Command::MoveBorder(request) = command {
                Some(request)
            } else {
                None
            }
        })
        .collect()
}

#[test]
fn drag_moves_the_pressed_border_and_does_nothing_away_from_it() {
    let mut harness = Desk::sample().shown();
    harness.state_mut().shell.view.label = Some(LabelId(2));
    let border = border_of_leaf(&harness);
    press(&mut harness, Modifiers::SHIFT, Key::G);
    assert_eq!(harness.state().shell.view.tool, Tool::Border);
    let from = on_screen(&harness, border.x as f32, border.y as f32);
    let to = on_screen(&harness, border.x as f32 + 6.0, border.y as f32 + 2.0);
    drag(&mut harness, from, to, PointerButton::Primary);
    let requested = pulls(&harness.state().requested);
    let [pull] = &requested[..] else {
        panic!("one pull: {:?}", harness.state().requested)
    };
    assert_eq!((pull.frame, pull.label), (0, LabelId(2)));
    assert!(
        pull.from_px.distance(border) < 0.3
            && pull.to_px.distance(border + glam::DVec2::new(6.0, 2.0)) < 0.3
    );

    harness.state_mut().requested.clear();
    let (near, outside) = (
        on_screen(&harness, 20.5, 20.0),
        on_screen(&harness, 20.5, -3.0),
    );
    drag(&mut harness, near, outside, PointerButton::Primary);
    let to_px = pulls(&harness.state().requested)[0].to_px;
    assert!(
        to_px.distance(glam::DVec2::new(20.0, -3.0)) < 0.3,
        "as far as was shown, from the border: {to_px}"
    );

    harness.state_mut().requested.clear();
    harness.state_mut().shell.view.hidden.insert(LabelId(2));
    drag(&mut harness, from, to, PointerButton::Primary);
    assert!(
        harness.state().requested.is_empty() && harness.state().shell.view.note.contains("hidden")
    );
    harness.state_mut().shell.view.hidden.clear();
    let adjacent = on_screen(&harness, 55.0, 4.0);
    drag(&mut harness, adjacent, to, PointerButton::Primary);
    assert!(
        harness.state().requested.is_empty(),
        "{:?}",
        harness.state().requested
    );
    assert!(
        harness.state().shell.view.note.contains("border"),
        "{}",
        harness.state().shell.view.note
    );
}

/// Returns the requested traces.
fn traces(requested: &[Command]) -> Vec<&TraceRequest> {
    requested
        .iter()
        .filter_map(|command| {
            if let Command::Trace(request) = command {
                Some(request)
            } else {
                None
            }
        })
        .collect()
}

#[test]
fn thin_structure_is_traced_through_the_clicked_points_when_enter_is_pressed() {
    let mut harness = Desk::sample().shown();
    press(&mut harness, Modifiers::NONE, Key::W);
    assert_eq!(harness.state().shell.view.tool, Tool::Stem);
    for (x, y) in [(10.0, 10.0), (25.0, 40.0), (40.0, 12.0), (50.0, 20.0)] {
        let at = on_screen(&harness, x, y);
        click_at(&mut harness, at, PointerButton::Primary);
        harness.run_steps(30);
    }
    press(&mut harness, Modifiers::NONE, Key::Backspace);
    let adjacent = on_screen(&harness, 30.0, 30.0);
    click_at(&mut harness, adjacent, PointerButton::Secondary);
    press(&mut harness, Modifiers::NONE, Key::Enter);
    let requested = traces(&harness.state().requested);
    assert_eq!(requested.len(), 1, "{:?}", harness.state().requested);
    let expected = [glam::DVec2::new(10.0, 10.0), glam::DVec2::new(25.0, 40.0)];
    assert_eq!(
        requested[0].points_px.len(),
        2,
        "two were taken back: {:?}",
        requested[0].points_px
    );
    assert!(
        requested[0]
            .points_px
            .iter()
            .zip(expected)
            .all(|(a, b)| a.distance(b) < 0.3)
    );
    assert_eq!(
        (requested[0].frame, requested[0].label, requested[0].replace),
        (0, LabelId(1), true)
    );
}

#[test]
fn trace_with_one_point_waits_for_a_second() {
    // With steps of 20 ms, two clicks are fast enough for a double click.
    let mut harness = Desk::sample().shown_by(Harness::builder().with_step_dt(0.02));
    harness.get_by_label("Stem & wire").click();
    harness.run_steps(2);
    let at = on_screen(&harness, 10.0, 10.0);
    click_at(&mut harness, at, PointerButton::Primary);
    press(&mut harness, Modifiers::NONE, Key::Enter);
    assert!(harness.state().requested.is_empty());
    assert!(
        harness.state().shell.view.note.contains("two points"),
        "{}",
        harness.state().shell.view.note
    );
    harness.run_steps(30);
    let at = on_screen(&harness, 10.0, 40.0);
    for _ in 0..2 {
        click_at(&mut harness, at, PointerButton::Primary);
    }
    assert_eq!(
        traces(&harness.state().requested).len(),
        1,
        "a double click finishes: {:?}",
        harness.state().requested
    );
}

#[test]
fn resting_pointer_previews_a_click_unless_busy_or_disabled() {
    let mut harness = Desk::sample().shown();
    let at = on_screen(&harness, 12.5, 30.5);
    harness.hover_at(at);
    harness.run_steps(6);
    let request = harness.state().shell.view.hover_request.clone().unwrap();
    assert_eq!(
        (request.frame, request.label, request.prompt.clicks.len()),
        (0, LabelId(1), 1)
    );
    assert!(
        request.prompt.clicks[0].include
            && request.prompt.clicks[0]
                .at_px
                .distance(glam::DVec2::new(12.5, 30.5))
                < 0.1
    );
    harness.state_mut().hovered = Some(harness.state().project.masks[&0].runs.clone());
    harness.run_steps(2);
    assert!(
        harness.state().requested.is_empty(),
        "a preview asks for no change"
    );

    press(&mut harness, Modifiers::NONE, Key::F3);
    assert!(
        !harness.state().shell.view.prefs.hover_preview
            && harness.state().shell.view.hover_request.is_none()
    );
    press(&mut harness, Modifiers::NONE, Key::F3);
    harness.run_steps(6);
    assert!(harness.state().shell.view.hover_request.is_some());
    click_at(&mut harness, at, PointerButton::Primary);
    harness.run_steps(6);
    assert!(
        harness.state().shell.view.hover_request.is_none(),
        "the click is on its way"
    );
    harness.state_mut().shell.view.draft.forget_sent();
    press(&mut harness, Modifiers::NONE, Key::P);
    harness.run_steps(6);
    assert!(
        harness.state().shell.view.hover_request.is_none(),
        "the brush has none"
    );
}

#[test]
fn wheel_zooms_at_the_pointer_and_zero_fits_again() {
    let mut harness = Desk::sample().shown();
    let at = on_screen(&harness, 20.5, 20.5);
    harness.hover_at(at);
    harness.run_steps(1);
    let delta = egui::vec2(0.0, 120.0);
    let (unit, phase) = (egui::MouseWheelUnit::Point, egui::TouchPhase::Move);
    harness.event(egui::Event::MouseWheel {
        unit,
        delta,
        phase,
        source: egui::MouseWheelSource::Wheel,
        modifiers: Modifiers::NONE,
    });
    harness.run_steps(20);
    assert!(harness.state().shell.view.zoom.scale.is_some());
    click_at(&mut harness, at, PointerButton::Primary);
    let clicked = prompts(&harness.state().requested)[0].prompt.clicks[0].at_px;
    assert!(
        (clicked - glam::DVec2::new(20.5, 20.5)).length() < 0.2,
        "stayed under the pointer: {clicked}"
    );
    press(&mut harness, Modifiers::NONE, Key::Num0);
    assert!(harness.state().shell.view.zoom.scale.is_none());
}

#[test]
fn middle_drag_pans_the_image_and_requests_nothing() {
    let mut harness = Desk::sample().shown();
    let (from, to) = (
        on_screen(&harness, 30.0, 20.0),
        on_screen(&harness, 40.0, 25.0),
    );
    drag(&mut harness, from, to, PointerButton::Middle);
    assert!(harness.state().requested.is_empty());
    assert!(harness.state().shell.view.zoom.scale.is_some());
}

#[test]
fn tool_bar_rows_stay_close_together_at_any_width() {
    /// Limit of the distance between rows: above one row with its space, below two rows.
    const MOST_BETWEEN: f64 = 32.0;
    let mut harness = Desk::sample().shown();
    for width in (1000..1800).step_by(25) {
        harness.set_size(egui::vec2(width as f32, 900.0));
        harness.run_steps(3);
        let first = harness
            .get_by_label("Stem & wire")
            .accesskit_node()
            .bounding_box()
            .unwrap();
        let image = harness
            .get_by_label("Image 000.png")
            .accesskit_node()
            .bounding_box()
            .unwrap();
        let middle = |at: &egui::accesskit::Rect| (at.y0 + at.y1) / 2.0;
        let is_control = |at: &egui::accesskit::Rect| {
            let is_adjacent = at.x0 >= image.x0 && at.x1 <= image.x1;
            is_adjacent && (first.y0..image.y0).contains(&middle(at)) && at.height() < MOST_BETWEEN
        };
        let all = harness
            .root()
            .children_recursive()
            .filter_map(|node| node.accesskit_node().bounding_box());
        let mut middles: Vec<f64> = all
            .filter(is_control)
            .map(|at| middle(&at))
            .chain([image.y0])
            .collect();
        middles.sort_by(f64::total_cmp);
        let widest = middles
            .windows(2)
            .map(|two| two[1] - two[0])
            .fold(0.0, f64::max);
        assert!(
            widest < MOST_BETWEEN,
            "rows at {middles:?} in a window {width} points wide"
        );
    }
}
