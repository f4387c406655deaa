//! Tests of the arrangement of the window: shares of the area, places, steps.

use std::collections::BTreeMap;
use std::sync::Arc;

use egui::{Key, Modifiers, Rect, Role, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use ostra_app::Panes;
use ostra_frames::{DepthSource, Orientation};
use ostra_masks::LabelTree;
use ostra_project::Project;
use ostra_project::workflow::WorkflowStep;
use ostra_session::Command;
use ostra_view::Coloring;

use crate::desk::{Desk, drag, labels, on_screen, open_advanced, open_step, press};
use crate::running::reconstruction;

const STEPS: [WorkflowStep; 5] = [
    WorkflowStep::Label,
    WorkflowStep::Track,
    WorkflowStep::Geometry,
    WorkflowStep::Cloud,
    WorkflowStep::Measure,
];

fn at_size(desk: Desk, size: Vec2) -> Harness<'static, Desk> {
    // The harness keeps 8 points free around the window, which eframe does not.
    desk.shown_at(Harness::builder(), size + Vec2::splat(16.0))
}

fn rect(harness: &Harness<'_, Desk>, name: &str) -> Rect {
    harness.get_by_label(name).rect()
}

/// Returns the share of the window that a pane covers; 0 if it is not shown.
fn share(harness: &Harness<'_, Desk>, name: &str, size: Vec2) -> f32 {
    harness
        .query_by_label(name)
        .map_or(0.0, |node| node.rect().area() / (size.x * size.y))
}

#[test]
fn image_and_cloud_get_most_of_the_window_in_every_step() {
    let size = Vec2::new(1280.0, 800.0);
    let mut harness = at_size(Desk::sample(), size);
    for step in STEPS {
        open_step(&mut harness, step);
        let image = share(&harness, "Image 000.png", size);
        let scene = share(&harness, "3-D view", size);
        assert!(image >= 0.3, "{step:?}: the image has {image}");
        assert!(image + scene >= 0.6, "{step:?}: {image} and {scene}");
        harness.state_mut().shell.view.prefs.panes = Panes::Image;
        harness.run_steps(3);
        let alone = share(&harness, "Image 000.png", size);
        assert!(alone >= 0.55, "{step:?}: alone {alone}");
        harness.state_mut().shell.view.prefs.panes = Panes::Both;
        harness.run_steps(3);
    }
}

#[test]
fn small_window_is_usable_in_every_step() {
    let size = Vec2::new(800.0, 600.0);
    let mut harness = at_size(Desk::sample(), size);
    harness.state_mut().shell.view.prefs.panes = Panes::Image;
    harness.run_steps(3);
    let strip = share(&harness, "Image 000.png", size);
    assert!(strip >= 0.4, "with the strip of steps: {strip}");
    for step in STEPS {
        open_step(&mut harness, step);
        let alone = share(&harness, "Image 000.png", size);
        assert!(alone >= 0.4, "{step:?}: {alone}");
    }
    harness.get_by_label("Hide panel").click();
    harness.run_steps(3);
    assert_eq!(share(&harness, "Image 000.png", size), strip);
    let tools = ["Click", "Stem & wire", "More image tools"].map(|name| rect(&harness, name));
    let top = tools[0].center().y;
    assert!(
        tools.iter().all(|tool| (tool.center().y - top).abs() < 3.0),
        "one row: {tools:?}"
    );
}

#[test]
fn nothing_in_the_side_panel_is_cut_off_at_its_right_edge() {
    let mut all = Vec::new();
    for size in [Vec2::new(1280.0, 800.0), Vec2::new(800.0, 600.0)] {
        for step in STEPS {
            let mut harness = at_size(Desk::sample(), size);
            let view = &mut harness.state_mut().shell.view;
            view.steps.is_expanded = true;
            view.reconstruct.max_side = Some(1600);
            view.fuse.voxel = Some(0.000_125);
            (view.track.from, view.track.to) = (Some(10), Some(11));
            harness.run_steps(3);
            open_step(&mut harness, step);
            if let Some(advanced) = harness.query_by_label("Advanced") {
                advanced.click();
                harness.run_steps(30);
            }
            let edge = f64::from(harness.ctx.content_rect().right());
            let cut: Vec<String> = harness
                .root()
                .children_recursive()
                .filter_map(|node| {
                    let node = node.accesskit_node();
                    let right = node.bounding_box()?.x1;
                    (right > edge + 0.5).then(|| format!("{:?} to {right}", node.label()))
                })
                .collect();
            all.extend(
                cut.into_iter()
                    .map(|name| format!("{size} {step:?}: {name}")),
            );
        }
    }
    assert!(all.is_empty(), "{all:#?}");
}

/// Returns a project as it is after it was created from photos.
fn fresh() -> Desk {
    let mut desk = Desk::sample();
    let mut frames = desk.project.frames.to_vec();
    frames.iter_mut().for_each(|frame| frame.camera = None);
    desk.project = Project {
        frames: Arc::new(frames),
        labels: LabelTree::default(),
        masks: BTreeMap::new(),
        ..Project::default()
    };
    desk.cloud = None;
    desk
}

#[test]
fn nothing_moves_when_labels_cameras_and_cloud_come() {
    let names = [
        "Image 000.png",
        "3-D view",
        "Click",
        "Brush",
        "Fit",
        "More image tools",
        "Confidence over frames",
        "Colour by",
    ];
    // The 3-D view opens with the reconstruction, when the pointer is in the side panel.
    let mut desk = fresh();
    desk.jobs = vec![reconstruction()];
    let mut harness = at_size(desk, Vec2::new(1280.0, 800.0));
    let places = |harness: &Harness<'_, Desk>| names.map(|name| rect(harness, name));
    let before = places(&harness);
    let sample = Desk::sample();
    let desk = harness.state_mut();
    desk.project.labels = sample.project.labels.clone();
    desk.project.masks = sample.project.masks.clone();
    harness.run_steps(5);
    assert_eq!(places(&harness), before, "first click");
    harness.state_mut().project.frames = Arc::clone(&sample.project.frames);
    harness.run_steps(5);
    assert_eq!(places(&harness), before, "first cameras");
    harness.state_mut().cloud = sample.cloud;
    harness.run_steps(5);
    assert_eq!(places(&harness), before, "first cloud");
    let view = &mut harness.state_mut().shell.view;
    (view.range, view.ruler.in_hand) = (Some((1, 3)), true);
    harness.run_steps(5);
    assert_eq!(places(&harness), before, "range and ruler");
}

#[test]
fn image_is_alone_until_there_is_something_in_3d() {
    let size = Vec2::new(1280.0, 800.0);
    let mut harness = at_size(fresh(), size);
    assert!(harness.query_by_label("3-D view").is_none());
    let alone = share(&harness, "Image 000.png", size);
    assert!(alone >= 0.55, "{alone}");
    harness.state_mut().jobs = vec![reconstruction()];
    harness.run_steps(3);
    assert!(harness.query_by_label("3-D view").is_some(), "its preview");
    harness.state_mut().jobs.clear();
    harness.state_mut().project.frames = Arc::clone(&Desk::sample().project.frames);
    harness.run_steps(3);
    assert!(harness.query_by_label("3-D view").is_some(), "cameras");
    harness.state_mut().project.frames = fresh().project.frames;
    harness.state_mut().shell.view.prefs.panes = Panes::Scene;
    harness.run_steps(3);
    assert!(harness.query_by_label("3-D view").is_some(), "chosen");
}

#[test]
fn recommended_step_opens_and_headers_tell_the_states() {
    let mut harness = fresh().shown();
    let open = |harness: &Harness<'_, Desk>| harness.state().shell.view.steps.open;
    assert_eq!(open(&harness), Some(WorkflowStep::Label));
    harness.get_by_label("Label: next, nothing marked");
    let sample = Desk::sample();
    harness.state_mut().project.labels = sample.project.labels;
    harness.state_mut().project.masks = sample.project.masks;
    harness.run_steps(3);
    assert_eq!(open(&harness), Some(WorkflowStep::Geometry), "photos first");
    harness.get_by_label("Label: done, 1 keyframe");
    harness.get_by_label("Track: stale, 1 frame to redo");
    let geometry = rect(&harness, "Cameras & depth: next, none yet").top();
    let track = rect(&harness, "Track: stale, 1 frame to redo").top();
    assert!(geometry < track, "in the order of the work");
    let mut frames = sample.project.frames.to_vec();
    for frame in &mut frames {
        frame.depth = Some(DepthSource::Sensor {
            path: "d.png".into(),
            unit: 0.001,
            orientation: Orientation(1),
            camera: None,
        });
    }
    harness.state_mut().project.frames = Arc::new(frames);
    harness.run_steps(3);
    assert_eq!(open(&harness), Some(WorkflowStep::Track));
    open_step(&mut harness, WorkflowStep::Measure);
    harness.state_mut().project.masks.clear();
    harness.run_steps(3);
    assert_eq!(
        open(&harness),
        Some(WorkflowStep::Measure),
        "chosen by the user"
    );
    let text = "Measure & export: not done, ";
    assert!(harness.query_all_by_label_contains(text).next().is_some());
}

#[test]
fn measures_and_export_are_buttons_of_the_last_step() {
    let mut harness = Desk::sample().shown();
    open_step(&mut harness, WorkflowStep::Measure);
    let before = rect(&harness, "Image 000.png");
    harness.get_by_label("Table of traits").click();
    harness.run_steps(3);
    assert!(harness.state().shell.view.measures.open);
    let cloud = rect(&harness, "3-D view");
    let table = rect(&harness, "Close traits");
    assert!(!cloud.intersects(table), "{table} covers {cloud}");
    harness.get_by_label("Close traits").click();
    harness.run_steps(3);
    assert_eq!(rect(&harness, "Image 000.png"), before);
    harness.get_by_label("Export…").click();
    harness.run_steps(3);
    assert_eq!(
        harness.state().shell.view.dialog,
        Some(ostra_app::Dialog::Export)
    );
}

#[test]
fn tab_hides_the_panels_but_still_travels_between_controls() {
    let mut harness = Desk::sample().shown();
    let before = rect(&harness, "Image 000.png");
    press(&mut harness, Modifiers::NONE, Key::Tab);
    assert!(harness.query_by_label("Confidence over frames").is_none());
    assert!(harness.query_by_label_contains("Cloud: ").is_none());
    assert!(rect(&harness, "Image 000.png").area() > 1.3 * before.area());
    press(&mut harness, Modifiers::NONE, Key::Tab);
    assert_eq!(rect(&harness, "Image 000.png"), before);
    harness.get_by_label("New label name").focus();
    harness.run_steps(2);
    press(&mut harness, Modifiers::NONE, Key::Tab);
    assert!(!harness.state().shell.view.steps.is_bare);
    let focused = harness.ctx.memory(egui::Memory::focused);
    assert!(focused.is_some(), "the next control has the keyboard");
    press(&mut harness, Modifiers::NONE, Key::Tab);
    assert!(!harness.state().shell.view.steps.is_bare, "and the next");
}

#[test]
fn panes_are_swapped_stacked_and_resized() {
    let mut harness = Desk::sample().shown();
    let panes =
        |harness: &Harness<'_, Desk>| (rect(harness, "Image 000.png"), rect(harness, "3-D view"));
    let (image, scene) = panes(&harness);
    assert!(image.right() < scene.left());
    harness.state_mut().shell.view.prefs.arrangement = Default::default();
    let at = egui::pos2((image.right() + scene.left()) / 2.0, image.center().y);
    drag(
        &mut harness,
        at,
        at + egui::vec2(100.0, 0.0),
        egui::PointerButton::Primary,
    );
    let (wider, _) = panes(&harness);
    assert!((wider.width() - image.width() - 100.0).abs() < 8.0);
    for (name, is_beside) in [("swap panes", true), ("stack panes", false)] {
        let ctrl = Modifiers {
            ctrl: true,
            ..Modifiers::COMMAND
        };
        press(&mut harness, ctrl, Key::P);
        harness.event(egui::Event::Text(name.into()));
        harness.run_steps(2);
        press(&mut harness, Modifiers::NONE, Key::Enter);
        harness.run_steps(2);
        let (image, scene) = panes(&harness);
        assert_eq!(scene.right() < image.left(), is_beside, "{name}");
        assert_eq!(scene.bottom() < image.top(), !is_beside, "{name}");
    }
    harness.get_by_label("Image only").click();
    harness.run_steps(3);
    assert_eq!(harness.state().shell.view.prefs.panes, Panes::Image);
}

#[test]
fn cloud_with_labels_is_coloured_by_label() {
    assert_eq!(
        Desk::sample().shown().state().shell.view.coloring,
        Coloring::Label
    );
    let mut alone = Desk::empty();
    alone.cloud = Desk::sample().cloud;
    alone.inspected = Some("/clouds/plant.ply".into());
    assert_eq!(alone.shown().state().shell.view.coloring, Coloring::Label);
    let mut harness = fresh().shown();
    assert_eq!(harness.state().shell.view.coloring, Coloring::Rgb);
    harness.state_mut().cloud = Desk::sample().cloud;
    harness.run_steps(2);
    assert_eq!(harness.state().shell.view.coloring, Coloring::Label);
    harness.state_mut().shell.view.coloring = Coloring::Rgb;
    harness.run_steps(2);
    assert_eq!(
        harness.state().shell.view.coloring,
        Coloring::Rgb,
        "the user's choice stays"
    );
}

#[test]
fn frames_are_counted_for_people() {
    let mut harness = Desk::sample().shown();
    harness.get_by_label("Frame 0 (1 of 12)");
    press(&mut harness, Modifiers::NONE, Key::End);
    harness.get_by_label("Frame 11 (12 of 12)");
}

#[test]
fn range_actions_are_in_the_status_line_and_its_menu() {
    let mut harness = Desk::sample().shown();
    assert!(harness.query_by_label("More range actions").is_none());
    harness.state_mut().shell.view.label = Some(ostra_masks::LabelId(2));
    harness.state_mut().shell.view.range = Some((1, 3));
    harness.run_steps(3);
    harness.get_by_label("leaf, frames 1–3");
    harness.get_by_label("More range actions").click();
    harness.run_steps(3);
    harness.get_by_label("Lock label in range").click();
    harness.run_steps(2);
    assert!(matches!(harness.state().requested[..], [Command::Range(_)]));
    harness.get_by_label("Clear range").click();
    harness.run_steps(3);
    assert_eq!(harness.state().shell.view.range, None);
}

#[test]
fn advanced_settings_are_closed_in_the_next_project() {
    let mut harness = Desk::sample().shown();
    open_advanced(&mut harness, WorkflowStep::Track);
    let is_open =
        |harness: &Harness<'_, Desk>| harness.query_by_label("Replace other labels").is_some();
    assert!(is_open(&harness), "{:?}", labels(&harness));
    harness.state_mut().root = Some("/projects/another".into());
    harness.state_mut().shell.project_changed();
    harness.run_steps(2);
    open_step(&mut harness, WorkflowStep::Track);
    harness.run_steps(20);
    assert!(!is_open(&harness));
}

#[test]
fn texts_of_the_status_line_do_not_overlap() {
    for size in [Vec2::new(800.0, 600.0), Vec2::new(1280.0, 800.0)] {
        let mut desk = Desk::sample();
        desk.size = size;
        desk.shell.view.note = "Exported to /projects/a folder with a long name/tiller".into();
        let mut harness = desk.shown();
        let at = on_screen(&harness, 30.0, 20.0);
        harness.hover_at(at);
        harness.run_steps(3);
        let number = harness.get_by_label_contains("(1 of 12)");
        let line = number.rect().y_range();
        let mut texts: Vec<Rect> = harness
            .root()
            .children_recursive()
            .filter(|node| {
                let node = node.accesskit_node();
                let is_text = matches!(node.role(), Role::Label | Role::Button);
                is_text && node.raw_bounds().is_some()
            })
            .map(|node| node.rect())
            .filter(|rect| line.contains(rect.center().y))
            .collect();
        texts.sort_by(|a, b| a.left().total_cmp(&b.left()));
        assert!(texts.len() > 5, "{texts:?}");
        for pair in texts.windows(2) {
            assert!(pair[0].right() <= pair[1].left() + 0.5, "{size}: {pair:?}");
        }
        assert!(texts.iter().all(|text| text.right() <= size.x));
    }
}
