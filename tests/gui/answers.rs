//! Tests of what follows a click: its size, the bar below the image, a new object, the keyboard.

use egui::{Key, Modifiers, PointerButton};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use glam::DVec2;
use ostra_app::Tool;
use ostra_frames::{DepthSource, Orientation};
use ostra_masks::{AnswerSize, Click, LabelId, LabelMask, LabelTree, Prompt, RunMask};
use ostra_session::{Command, PromptRequest};

use crate::desk::{Desk, HEIGHT, WIDTH, click_at, drag, flick, on_screen, press};

const LABEL: LabelId = LabelId(1);
const HINT: &str =
    "Too much? Right-click what does not belong, or drag a box. For a stem, use Stem & wire.";

fn prompts(harness: &Harness<'_, Desk>) -> Vec<PromptRequest> {
    let requested = harness.state().requested.iter();
    requested
        .filter_map(|command| match command {
            Command::Prompt(request) => Some(request.clone()),
            _ => None,
        })
        .collect()
}

fn added(harness: &Harness<'_, Desk>) -> Vec<(String, Option<String>)> {
    let requested = harness.state().requested.iter();
    requested
        .filter_map(|command| match command {
            Command::AddLabel { name, parent, .. } => Some((name.clone(), parent.clone())),
            _ => None,
        })
        .collect()
}

/// Returns a desk on whose first frame a click was just answered by `columns` columns.
fn answered(columns: u32) -> Desk {
    let mut desk = Desk::sample();
    let mut mask = LabelMask::empty(WIDTH, HEIGHT);
    for y in 2..HEIGHT - 2 {
        for x in 2..2 + columns {
            mask.ids[(y * WIDTH + x) as usize] = LABEL;
        }
    }
    let prompt = Prompt {
        clicks: vec![Click {
            at_px: DVec2::new(10.5, 20.5),
            include: true,
        }],
        ..Prompt::default()
    };
    let shown = desk.project.masks.get_mut(&0).unwrap();
    shown.runs = RunMask::encode(&mask).into();
    desk.project.prompts.insert((0, LABEL), prompt);
    desk.last_prompt = Some((0, LABEL));
    desk
}

fn image_rect(harness: &Harness<'_, Desk>) -> egui::Rect {
    harness.get_by_label("Image 000.png").rect()
}

#[test]
fn bar_below_an_answer_that_covers_much_offers_other_sizes_and_does_not_move_the_image() {
    let little = answered(8).shown();
    assert!(little.query_by_label(HINT).is_none());
    let mut harness = answered(40).shown();
    assert_eq!(image_rect(&harness), image_rect(&little));
    harness.get_by_label(HINT);
    harness.get_by_label("Smaller").click();
    harness.run_steps(3);
    let [request] = &prompts(&harness)[..] else {
        panic!("one prompt: {:?}", harness.state().requested)
    };
    assert_eq!((request.frame, request.label), (0, LABEL));
    assert_eq!(request.prompt.size, AnswerSize::Smaller);
    assert_eq!(request.prompt.clicks.len(), 1, "the same click");

    harness.get_by_label("Close hint").click();
    harness.run_steps(3);
    assert!(harness.query_by_label(HINT).is_none());
}

#[test]
fn bar_offers_sizes_after_one_click_without_depth() {
    const SIZES: &str = "Right size?";
    let is_offered = |desk: Desk| {
        let harness = desk.shown();
        harness.query_by_label_contains(SIZES).is_some()
    };
    assert!(is_offered(answered(8)));
    let mut twice = answered(8);
    let prompt = twice.project.prompts.get_mut(&(0, LABEL)).unwrap();
    prompt.clicks.push(prompt.clicks[0]);
    assert!(!is_offered(twice));
    let mut deep = answered(8);
    let mut frames = deep.project.frames.to_vec();
    frames[0].depth = Some(DepthSource::Sensor {
        path: "/000-depth.png".into(),
        unit: 0.001,
        orientation: Orientation(1),
        camera: None,
    });
    deep.project.frames = frames.into();
    assert!(!is_offered(deep), "depth shows where an object ends");
}

#[test]
fn bar_is_hidden_on_other_frames_and_with_other_tools() {
    let mut harness = answered(40).shown();
    harness.state_mut().shell.view.tool = Tool::Brush;
    harness.run_steps(2);
    assert!(harness.query_by_label(HINT).is_none());
    harness.state_mut().shell.view.tool = Tool::Click;
    harness.state_mut().shell.view.frame = 1;
    harness.run_steps(2);
    assert!(harness.query_by_label(HINT).is_none());
}

#[test]
fn bar_says_that_a_click_changed_nothing() {
    let mut harness = Desk::sample().shown();
    let text = "The click changed nothing: 'leaf' is here already";
    let answer = &mut harness.state_mut().shell.view.answer;
    answer.note_unchanged(0, text.into());
    harness.run_steps(3);
    harness.get_by_label(text);
    assert!(harness.query_by_label("Smaller").is_none(), "no answer yet");
    let at = on_screen(&harness, 5.5, 5.5);
    click_at(&mut harness, at, PointerButton::Primary);
    assert!(harness.query_by_label(text).is_none(), "the next click");
}

#[test]
fn brackets_and_alt_wheel_step_through_the_sizes_of_the_last_click() {
    let mut harness = answered(8).shown();
    let brush_px = harness.state().shell.view.prefs.brush_px;
    press(&mut harness, Modifiers::NONE, Key::OpenBracket);
    press(&mut harness, Modifiers::NONE, Key::OpenBracket);
    press(&mut harness, Modifiers::NONE, Key::OpenBracket);
    press(&mut harness, Modifiers::NONE, Key::CloseBracket);
    let sizes: Vec<AnswerSize> = prompts(&harness)
        .iter()
        .map(|request| request.prompt.size)
        .collect();
    let (smaller, smallest) = (AnswerSize::Smaller, AnswerSize::Smallest);
    assert_eq!(sizes, [smaller, smallest, smaller], "it stops at the end");
    assert_eq!(harness.state().shell.view.prefs.brush_px, brush_px);

    harness.state_mut().requested.clear();
    harness.state_mut().shell.view.draft.forget_sent();
    let at = on_screen(&harness, 30.5, 20.5);
    harness.hover_at(at);
    harness.event(egui::Event::ModifiersChanged(Modifiers::ALT));
    let turn = |harness: &mut Harness<'_, Desk>, lines: f32| {
        harness.event(egui::Event::MouseWheel {
            unit: egui::MouseWheelUnit::Line,
            delta: egui::vec2(0.0, lines),
            phase: egui::TouchPhase::Move,
            source: egui::MouseWheelSource::Wheel,
            modifiers: Modifiers::ALT,
        });
        harness.run_steps(30);
    };
    turn(&mut harness, 1.0);
    turn(&mut harness, -1.0);
    let sizes: Vec<AnswerSize> = prompts(&harness)
        .iter()
        .map(|request| request.prompt.size)
        .collect();
    assert_eq!(sizes, [AnswerSize::Larger, AnswerSize::Automatic]);
    assert!(
        harness.state().shell.view.zoom.scale.is_none(),
        "the image does not zoom"
    );
}

#[test]
fn brackets_set_the_brush_size_with_the_brush() {
    let mut harness = answered(8).shown();
    harness.state_mut().shell.view.tool = Tool::Brush;
    let brush_px = harness.state().shell.view.prefs.brush_px;
    press(&mut harness, Modifiers::NONE, Key::CloseBracket);
    assert!(harness.state().shell.view.prefs.brush_px > brush_px);
    assert!(prompts(&harness).is_empty());
}

#[test]
fn next_click_is_automatic_again() {
    let mut desk = answered(8);
    desk.project.prompts.get_mut(&(0, LABEL)).unwrap().size = AnswerSize::Smaller;
    let mut harness = desk.shown();
    let at = on_screen(&harness, 50.5, 20.5);
    click_at(&mut harness, at, PointerButton::Primary);
    let request = &prompts(&harness)[0];
    assert_eq!(request.prompt.clicks.len(), 2);
    assert_eq!(request.prompt.size, AnswerSize::Automatic);
}

#[test]
fn ctrl_click_and_ctrl_drag_label_a_new_object() {
    let mut harness = Desk::sample().shown();
    let tree = &harness.state().project.labels;
    let (next, chosen) = (tree.next_id(), harness.state().shell.view.label.unwrap());
    let name = tree.get(chosen).unwrap().name.clone();
    harness.event(egui::Event::ModifiersChanged(Modifiers::COMMAND));
    let at = on_screen(&harness, 50.5, 40.5);
    click_at(&mut harness, at, PointerButton::Primary);
    assert_eq!(added(&harness), [(format!("{name} 2"), None)]);
    let request = &prompts(&harness)[0];
    assert_eq!(request.label, next);
    assert_eq!(request.prompt.clicks.len(), 1);

    harness.state_mut().requested.clear();
    harness.state_mut().shell.view.draft.forget_sent();
    let (from, to) = (
        on_screen(&harness, 45.0, 30.0),
        on_screen(&harness, 60.0, 44.0),
    );
    drag(&mut harness, from, to, PointerButton::Primary);
    assert_eq!(added(&harness).len(), 1);
    let request = &prompts(&harness)[0];
    assert_eq!((request.label, request.prompt.boxes.len()), (next, 1));

    harness.state_mut().requested.clear();
    click_at(&mut harness, at, PointerButton::Secondary);
    assert!(added(&harness).is_empty(), "the right button only excludes");
}

#[test]
fn first_new_object_has_the_name_that_a_click_gives() {
    let mut desk = Desk::sample();
    desk.project.labels = Default::default();
    desk.project.masks.clear();
    let mut harness = desk.shown();
    harness.event(egui::Event::ModifiersChanged(Modifiers::COMMAND));
    let at = on_screen(&harness, 5.5, 5.5);
    click_at(&mut harness, at, PointerButton::Primary);
    assert_eq!(added(&harness), [("object 1".to_owned(), None)]);
    assert_eq!(prompts(&harness)[0].label, LABEL);
}

#[test]
fn press_on_the_image_takes_the_keyboard_and_the_typed_label() {
    let mut harness = Desk::sample().shown();
    let next = harness.state().project.labels.next_id();
    let field = harness.get_by_label("New label name");
    field.focus();
    harness.run_steps(2);
    harness.get_by_label("New label name").type_text("pod");
    harness.run_steps(2);
    assert!(harness.ctx.text_edit_focused());
    let (from, to) = (
        on_screen(&harness, 5.0, 5.0),
        on_screen(&harness, 15.0, 40.0),
    );
    flick(&mut harness, &[from, to], PointerButton::Primary);
    assert!(!harness.ctx.text_edit_focused());
    assert_eq!(added(&harness), [("pod".to_owned(), None)]);
    let label = prompts(&harness).first().map(|request| request.label);
    assert_eq!(label, Some(next), "the box is that of the typed label");
    press(&mut harness, Modifiers::NONE, Key::P);
    assert_eq!(
        harness.state().shell.view.tool,
        Tool::Brush,
        "keys act again"
    );
}

#[test]
fn drag_in_the_3d_view_takes_the_keyboard() {
    let mut harness = Desk::sample().shown();
    harness.get_by_label("New label name").focus();
    harness.run_steps(2);
    assert!(harness.ctx.text_edit_focused());
    let middle = harness.get_by_label("3-D view").rect().center();
    drag(
        &mut harness,
        middle,
        middle + egui::vec2(30.0, 10.0),
        PointerButton::Primary,
    );
    assert!(!harness.ctx.text_edit_focused());
    assert!(added(&harness).is_empty(), "nothing was typed");
}

#[test]
fn label_is_not_previewed_where_it_is_already() {
    let mut harness = answered(20).shown();
    let at = on_screen(&harness, 10.5, 20.5);
    harness.hover_at(at);
    harness.run_steps(8);
    assert!(harness.state().shell.view.hover_request.is_none());
    let at = on_screen(&harness, 40.5, 20.5);
    harness.hover_at(at);
    harness.run_steps(8);
    assert!(harness.state().shell.view.hover_request.is_some());
}

#[test]
fn first_click_is_previewed_before_there_is_a_label() {
    let mut desk = Desk::sample();
    desk.project.labels = LabelTree::default();
    desk.project.masks.clear();
    let mut harness = desk.shown();
    let at = on_screen(&harness, 12.5, 30.5);
    harness.hover_at(at);
    harness.run_steps(6);
    let request = harness.state().shell.view.hover_request.clone().unwrap();
    assert_eq!(request.label, LabelTree::default().next_id());
    assert!(
        harness.state().requested.is_empty(),
        "a preview adds no label"
    );
}

#[test]
fn first_answer_of_a_project_names_ctrl_click() {
    const TEXT: &str = "Ctrl+click labels another object.";
    let mut desk = answered(2);
    let first = desk.project.masks[&0].clone();
    desk.project.masks = [(0, first.clone())].into();
    let harness = desk.shown();
    assert!(harness.query_by_label_contains(TEXT).is_some());
    let mut desk = answered(2);
    desk.project.masks = [(0, first.clone()), (1, first)].into();
    let harness = desk.shown();
    assert!(
        harness.query_by_label_contains(TEXT).is_none(),
        "known by now"
    );
}

#[test]
fn status_bar_says_what_the_buttons_do_with_each_tool() {
    let mut harness = Desk::sample().shown();
    for (tool, text) in [
        (Tool::Click, "drag draws a box"),
        (Tool::Brush, "right button erases"),
        (Tool::Eraser, "Drag erases"),
        (Tool::Polygon, "double click fills"),
        (Tool::Border, "Press on the border"),
        (Tool::Stem, "Click along the stem"),
    ] {
        harness.state_mut().shell.view.tool = tool;
        harness.run_steps(2);
        assert!(harness.query_by_label_contains(text).is_some(), "{tool:?}");
        let at = on_screen(&harness, 12.5, 30.5);
        harness.hover_at(at);
        harness.run_steps(2);
        assert!(
            harness.query_by_label_contains(text).is_some(),
            "{tool:?} over the image"
        );
    }
}
