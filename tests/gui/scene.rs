//! Tests of the 3-D view: colours, light, sides, clip box and isolated labels.

use egui::{
    Color32, Event, Key, Modifiers, MouseWheelSource, MouseWheelUnit, Pos2, Shape, TouchPhase, Vec2,
};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use glam::Vec3;
use ostra_app::{ClipSides, InspectedPoint, Panes};
use ostra_cloud::measure::GroundChoice;
use ostra_masks::LabelId;
use ostra_view::Coloring;

use crate::desk::{Desk, drag, labels, press};

fn shown() -> Harness<'static, Desk> {
    let mut desk = Desk::sample();
    desk.shell.view.prefs.panes = Panes::Scene;
    desk.shown()
}

fn choose(harness: &mut Harness<'static, Desk>, menu: &str, item: &str) {
    harness.get_by_label(menu).click();
    harness.run_steps(3);
    harness.get_all_by_label(item).last().unwrap().click();
    harness.run_steps(3);
}

#[test]
fn colours_are_selectable_and_vote_colours_need_votes() {
    let mut harness = shown();
    for (name, coloring) in [
        ("Normals", Coloring::Normals),
        ("Height", Coloring::Height),
        ("Label", Coloring::Label),
    ] {
        choose(&mut harness, "Colour by", name);
        assert_eq!(harness.state().shell.view.coloring, coloring, "{name}");
    }
    harness.get_by_label("Colour by").click();
    harness.run_steps(3);
    assert!(
        harness
            .get_by_label("Conflict")
            .accesskit_node()
            .is_disabled(),
        "{:?}",
        labels(&harness)
    );
    press(&mut harness, Modifiers::NONE, Key::Escape);
    choose(&mut harness, "Level of labels", "Level 1");
    assert_eq!(harness.state().shell.view.scene.level, Some(1));
}

#[test]
fn display_menu_stays_open_while_options_change() {
    let mut harness = shown();
    harness.get_by_label("Display").click();
    harness.run_steps(3);
    for name in [
        "Orthographic",
        "Eye-dome lighting",
        "Custom background",
        "Scale bar",
        "Axes",
        "Turntable",
    ] {
        harness.get_by_label(name).click();
        harness.run_steps(3);
    }
    let view = &harness.state().shell.view;
    let scene = &view.prefs.scene;
    assert!(
        scene.orthographic && !scene.edl && !scene.scale_bar && !scene.axes && view.scene.turning
    );
    assert_eq!(scene.background, Some([255; 3]));
    assert!(harness.query_by_label("Background colour").is_some());
    assert_eq!(harness.unnamed_widgets(), Vec::<String>::new());
}

#[test]
fn uncertain_points_are_shown_alone_until_a_button_shows_all() {
    let mut harness = shown();
    harness.get_by_label("Display").click();
    harness.run_steps(3);
    assert!(harness.query_by_label("Uncertain below").is_none());
    harness.get_by_label("Uncertain points only").click();
    harness.run_steps(3);
    assert_eq!(harness.state().shell.view.scene.uncertain_below, Some(0.7));
    assert!(
        harness.query_by_label("Uncertain below").is_some(),
        "{:?}",
        labels(&harness)
    );
    press(&mut harness, Modifiers::NONE, Key::Escape);
    harness.get_by_label("Show all points").click();
    harness.run_steps(3);
    assert_eq!(harness.state().shell.view.scene.uncertain_below, None);
}

#[test]
fn click_in_the_view_ends_the_turntable() {
    let mut harness = shown();
    press(&mut harness, Modifiers::ALT, Key::T);
    assert!(harness.state().shell.view.scene.turning);
    harness.get_by_label("3-D view").click();
    harness.run_steps(3);
    assert!(!harness.state().shell.view.scene.turning);
}

#[test]
fn clip_box_and_slice_are_set_and_removed() {
    let mut harness = shown();
    harness.get_by_label("Clip").click();
    harness.run_steps(3);
    harness.get_by_label("Slice").click();
    harness.run_steps(3);
    let slice = harness.state().shell.view.scene.clip.slice.unwrap();
    assert_eq!((slice.axis, slice.at), (1, 0.5));
    assert!(
        harness.query_by_label("Clip Position").is_some(),
        "{:?}",
        labels(&harness)
    );
    for side in ["Left", "Right", "Bottom", "Top", "Front", "Back"] {
        assert!(
            harness.query_by_label(&format!("Clip {side}")).is_some(),
            "{side}"
        );
    }
    assert_eq!(harness.unnamed_widgets(), Vec::<String>::new());
    harness.get_by_label("Show everything").click();
    harness.run_steps(3);
    assert_eq!(harness.state().shell.view.scene.clip, ClipSides::default());
}

#[test]
fn alt_click_on_a_label_isolates_it_until_a_button_shows_all() {
    let mut harness = shown();
    assert!(harness.query_by_label("Show all labels").is_none());
    harness.get_by_label("leaf").click_modifiers(Modifiers::ALT);
    harness.run_steps(3);
    assert_eq!(harness.state().shell.view.scene.isolated, Some(LabelId(2)));
    harness.get_by_label("Show all labels").click();
    harness.run_steps(3);
    assert_eq!(harness.state().shell.view.scene.isolated, None);
}

#[test]
fn view_through_a_camera_follows_the_frames_until_moved() {
    let mut harness = shown();
    assert!(harness.query_by_label("Opacity of the image").is_none());
    press(&mut harness, Modifiers::NONE, Key::L);
    harness.run_steps(2);
    assert_eq!(harness.state().shell.view.scene.through, Some(0));
    harness.get_by_label("Opacity of the image");
    harness.get_by_label("Images").click();
    press(&mut harness, Modifiers::NONE, Key::ArrowRight);
    harness.run_steps(2);
    assert_eq!(harness.state().shell.view.scene.through, Some(1));
    let middle = harness.get_by_label("3-D view").rect().center();
    drag(
        &mut harness,
        middle,
        middle + egui::vec2(40.0, 10.0),
        egui::PointerButton::Primary,
    );
    assert_eq!(harness.state().shell.view.scene.through, None);
    press(&mut harness, Modifiers::NONE, Key::ArrowRight);
    harness.run_steps(2);
    assert_eq!(
        harness.state().shell.view.scene.through,
        None,
        "it stays where it was put by hand"
    );
}

/// Returns the lines of this colour in the cross at the inspected point.
fn cross(harness: &Harness<'static, Desk>, color: Color32) -> Vec<[Pos2; 2]> {
    let line = |shape: &Shape| match shape {
        Shape::LineSegment { points, stroke } if stroke.color == color => Some(*points),
        _ => None,
    };
    harness
        .output()
        .shapes
        .iter()
        .filter_map(|clipped| line(&clipped.shape))
        .collect()
}

#[test]
fn mark_of_the_inspected_point_has_the_same_size_near_and_far() {
    let mut harness = shown();
    let cloud = harness.state().cloud.clone().unwrap();
    harness.state_mut().shell.view.inspected_point =
        Some(InspectedPoint::new(&cloud, None, cloud.len() / 2));
    harness.run_steps(3);
    let pane = harness.get_by_label("3-D view").rect();
    let reach = |harness: &Harness<'static, Desk>| {
        let arms = cross(harness, Color32::from_rgb(255, 235, 90));
        assert_eq!(arms.len(), 4);
        assert!(
            cross(harness, Color32::BLACK).len() >= 4,
            "with a dark outline"
        );
        arms.iter().flatten().fold(egui::Rect::NOTHING, |all, &at| {
            all.union(egui::Rect::from_pos(at))
        })
    };
    let near = reach(&harness);
    assert!(
        near.width() >= 20.0 && near.height() >= 20.0 && pane.contains(near.center()),
        "{near}"
    );
    for _ in 0..5 {
        harness.hover_at(pane.center());
        harness.event(Event::MouseWheel {
            unit: MouseWheelUnit::Point,
            delta: Vec2::new(0.0, -200.0),
            phase: TouchPhase::Move,
            source: MouseWheelSource::Wheel,
            modifiers: Modifiers::NONE,
        });
        harness.run_steps(10);
    }
    let far = reach(&harness);
    assert_ne!(near.center(), far.center(), "the view was moved away");
    assert!(
        (near.size() - far.size()).length() < 0.1,
        "{near} and {far}"
    );
}

#[test]
fn resting_pointer_shows_the_label_of_the_point() {
    const TIP: &str = "90 % of the votes";
    let mut harness = shown();
    let cloud = harness.state().cloud.clone().unwrap();
    let point = (0..cloud.len())
        .find(|&point| cloud.labels[point] == LabelId(2))
        .unwrap();
    harness.state_mut().shell.view.inspected_point = Some(InspectedPoint::new(&cloud, None, point));
    harness.run_steps(3);
    let arms = cross(&harness, Color32::from_rgb(255, 235, 90));
    let at = arms
        .iter()
        .flatten()
        .fold(egui::Rect::NOTHING, |all, &at| {
            all.union(egui::Rect::from_pos(at))
        })
        .center();
    harness.state_mut().shell.view.inspected_point = None;
    harness.run_steps(3);
    assert!(harness.query_by_label(TIP).is_none());
    harness.hover_at(at);
    let tells = |harness: &mut Harness<'static, Desk>| {
        std::thread::park_timeout(std::time::Duration::from_millis(20));
        harness.run_steps(2);
        harness.query_by_label(TIP).is_some()
    };
    assert!(
        (0..200).any(|_| tells(&mut harness)),
        "{:?}",
        labels(&harness)
    );
    let tree = &harness.state().project.labels;
    let names: Vec<&str> = tree
        .path(LabelId(2))
        .iter()
        .map(|&id| tree.get(id).unwrap().name.as_str())
        .collect();
    let path = names.join(" › ");
    assert!(harness.query_all_by_label(&path).next().is_some(), "{path}");
    harness.state_mut().shell.view.ruler.in_hand = true;
    harness.run_steps(3);
    assert!(!tells(&mut harness), "a click would measure");
    harness.state_mut().shell.view.ruler.in_hand = false;
    assert!((0..200).any(|_| tells(&mut harness)));
    harness.state_mut().shell.view.hidden.insert(LabelId(2));
    harness.run_steps(3);
    assert!(!tells(&mut harness), "it is not seen any more");
    harness.state_mut().shell.view.hidden.clear();
    let corner = harness.get_by_label("3-D view").rect().left_top() + Vec2::splat(8.0);
    harness.hover_at(corner);
    assert!(!(0..20).any(|_| tells(&mut harness)), "nothing lies there");
}

#[test]
fn view_and_measurements_follow_a_change_of_scale() {
    let mut harness = shown();
    let before = harness.state().shell.orbit().unwrap();
    let desk = harness.state_mut();
    desk.shell.view.ruler.in_hand = true;
    desk.shell.view.ruler.points = vec![Vec3::ZERO, 0.4 * Vec3::X];
    desk.shell.view.measures.settings.ground = GroundChoice::Plane {
        normal: [0.0, 0.0, 1.0],
        offset: 0.8,
    };
    desk.shell.view.fuse.voxel = Some(0.02);
    // The window does this when the frames of the project report a change of scale.
    let mut cloud = ostra_cloud::LabelledCloud::clone(desk.cloud.as_ref().unwrap());
    cloud.scale_by(0.25);
    desk.cloud = Some(std::sync::Arc::new(cloud));
    desk.shell.scale_by(0.25);
    harness.run_steps(3);
    let (after, view) = (
        harness.state().shell.orbit().unwrap(),
        &harness.state().shell.view,
    );
    assert_eq!(
        (after.distance, after.target),
        (0.25 * before.distance, 0.25 * before.target)
    );
    assert_eq!(after.rotation, before.rotation);
    assert_eq!(view.ruler.points, [Vec3::ZERO, 0.1 * Vec3::X]);
    assert_eq!(
        view.measures.settings.ground,
        GroundChoice::Plane {
            normal: [0.0, 0.0, 1.0],
            offset: 0.2
        }
    );
    assert_eq!(view.fuse.voxel, Some(0.005));
}
