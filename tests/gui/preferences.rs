//! Tests of the preferences.

use egui::{Event, Key, Modifiers, Role, Theme, ThemePreference};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use ostra_app::{Dialog, Prefs};

use crate::desk::{Desk, press};

const CTRL: Modifiers = Modifiers {
    ctrl: true,
    command: true,
    ..Modifiers::NONE
};

fn shown() -> Harness<'static, Desk> {
    let mut harness = Desk::sample().shown();
    press(&mut harness, CTRL, Key::Comma);
    assert_eq!(harness.state().shell.view.dialog, Some(Dialog::Preferences));
    harness
}

/// Returns the preferences as the next session reads them.
fn stored(harness: &Harness<'_, Desk>) -> Prefs {
    let text = serde_json::to_string(&harness.state().shell.view.prefs).unwrap();
    serde_json::from_str(&text).unwrap()
}

fn choose(harness: &mut Harness<'_, Desk>, role: Role, name: &str) {
    harness.get_by_role_and_label(role, name).click();
    harness.run_steps(3);
}

#[test]
fn theme_takes_effect_at_once_and_is_stored() {
    let mut harness = shown();
    for (name, preference, theme) in [
        ("Light", ThemePreference::Light, Theme::Light),
        ("Dark", ThemePreference::Dark, Theme::Dark),
    ] {
        choose(&mut harness, Role::Button, name);
        assert_eq!(harness.ctx.theme(), theme);
        assert_eq!(stored(&harness).theme, preference);
    }
    choose(&mut harness, Role::Button, "System");
    assert_eq!(stored(&harness).theme, ThemePreference::System);
    press(&mut harness, Modifiers::NONE, Key::Escape);
    let before = harness.ctx.theme();
    press(&mut harness, Modifiers::NONE, Key::F9);
    assert_ne!(harness.ctx.theme(), before, "the key switches too");
    assert_ne!(stored(&harness).theme, ThemePreference::System);
}

#[test]
fn stored_theme_and_size_are_applied_when_the_window_opens() {
    let mut desk = Desk::sample();
    desk.shell.view.prefs.theme = ThemePreference::Light;
    desk.shell.view.prefs.scale = 1.25;
    let harness = desk.shown();
    assert_eq!(harness.ctx.theme(), Theme::Light);
    assert_eq!(harness.ctx.zoom_factor(), 1.25);
    assert_eq!(stored(&harness).scale, 1.25);
}

#[test]
fn interface_size_takes_effect_at_once_and_follows_the_keys() {
    let mut harness = shown();
    choose(&mut harness, Role::ComboBox, "Interface size");
    harness.get_by_label("150 %").click();
    harness.run_steps(4);
    assert_eq!(harness.ctx.zoom_factor(), 1.5);
    assert_eq!(stored(&harness).scale, 1.5);
    harness.ctx.set_zoom_factor(0.9);
    harness.run_steps(3);
    assert_eq!(stored(&harness).scale, 0.9, "as by Ctrl+-");
    assert_eq!(harness.ctx.zoom_factor(), 0.9);
}

#[test]
fn switches_of_the_image_take_effect_and_are_stored() {
    let mut harness = shown();
    choose(&mut harness, Role::CheckBox, "Preview the mask of a click");
    choose(&mut harness, Role::CheckBox, "Outlines");
    choose(&mut harness, Role::Button, "Left");
    let prefs = stored(&harness);
    assert!(!prefs.hover_preview && !prefs.outlines && prefs.panel_on_left);
    let labels = harness.get_by_label("New label name").rect();
    assert!(labels.right() < 700.0, "the panel is at the left: {labels}");
    let opacity = harness.get_by_label("Opacity of masks");
    assert_eq!(opacity.accesskit_node().role(), Role::Slider);
}

#[test]
fn provider_of_networks_is_chosen_and_stored() {
    let mut harness = shown();
    choose(&mut harness, Role::ComboBox, "Run networks on");
    harness.get_by_label("CUDA").click();
    harness.run_steps(3);
    let chosen = ostra_compute::nn::Provider::chosen();
    assert_eq!(chosen, ostra_compute::nn::Provider::Cuda);
    assert_eq!(stored(&harness).provider, chosen);
    ostra_compute::nn::Provider::default().choose();
}

#[test]
fn shortcuts_are_a_page_that_can_be_searched() {
    let mut harness = shown();
    choose(&mut harness, Role::Button, "Shortcuts");
    assert_eq!(harness.state().shell.view.dialog, Some(Dialog::Shortcuts));
    harness.get_by_label("Shortcut of Fuse: U");
    harness.get_by_label("Search shortcuts").focus();
    harness.run_steps(2);
    harness.event(Event::Text("fuse label vote".into()));
    harness.run_steps(3);
    let polygon = "Shortcut of Polygon tool: G";
    assert!(harness.query_by_label(polygon).is_none());
    harness.get_by_label("Shortcut of Fuse: U").click();
    harness.run_steps(2);
    press(&mut harness, Modifiers::NONE, Key::F11);
    harness.get_by_label("Shortcut of Fuse: F11");
    let key = stored(&harness).shortcuts;
    assert_eq!(key, harness.state().shell.view.prefs.shortcuts);
    assert!(key.is_changed());
    choose(&mut harness, Role::Button, "General");
    assert_eq!(harness.state().shell.view.dialog, Some(Dialog::Preferences));
}
