//! The book's page of shortcuts agrees with the table of actions.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use ostra_app::{Action, MenuName, Shortcuts};

use crate::generated_page;

fn table() -> String {
    let ctx = egui::Context::default();
    ctx.set_os(egui::os::OperatingSystem::Nix);
    let shortcuts = Shortcuts::default();
    let mut page = String::from("\n| action | menu | shortcut | effect |\n|---|---|---|---|\n");
    for action in Action::all() {
        let menu = action.menu().map_or_else(String::new, MenuName::path);
        let keys = match shortcuts.text(&ctx, action) {
            keys if keys.is_empty() => keys,
            keys => format!("`{keys}`"),
        };
        let _ = writeln!(
            page,
            "| {} | {menu} | {keys} | {} |",
            action.text(),
            action.tip()
        );
    }
    page.push('\n');
    page
}

#[test]
fn shortcut_reference_is_up_to_date() {
    generated_page::check("reference/shortcuts.md", "shortcuts", &table());
}

#[test]
fn every_action_has_a_name_of_its_own_and_a_tooltip() {
    let mut names = BTreeSet::new();
    for action in Action::all() {
        let (text, tip) = (action.text(), action.tip());
        assert!(
            !text.trim().is_empty() && !tip.trim().is_empty(),
            "{action:?}"
        );
        assert!(
            !text.ends_with('.') && !tip.ends_with('.'),
            "{action:?}: {tip}"
        );
        assert!(
            names.insert(text.clone()),
            "two actions are called {text:?}"
        );
    }
    assert!(names.len() > 80);
}
