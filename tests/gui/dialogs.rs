//! Dialogs.

use egui::{Key, Modifiers};
use egui_kittest::kittest::{NodeT, Queryable};
use ostra::app::Dialog;
use ostra::session::Command;

use crate::desk::{Desk, press};

fn type_into(harness: &mut egui_kittest::Harness<'_, Desk>, name: &str, text: &str) {
    harness.get_by_label(name).focus();
    harness.run_steps(2);
    harness.event(egui::Event::Text(text.into()));
    harness.run_steps(2);
}

#[test]
fn a_new_project_is_made_from_what_was_typed() {
    let mut harness = Desk::empty().shown();
    harness.get_by_label("New project from frames…").click();
    harness.run_steps(3);
    assert!(harness.get_by_label("Create").accesskit_node().is_disabled());
    type_into(&mut harness, "Frames folder or film", "/photos/rice");
    type_into(&mut harness, "Depth folder", "/photos/rice-depth");
    type_into(&mut harness, "Cameras file or folder", "/photos/sparse");
    harness.get_by_label("Create").click();
    harness.run_steps(2);
    let Command::New(new) = &harness.state().asked[0] else { panic!("{:?}", harness.state().asked) };
    assert_eq!(new.root, std::path::Path::new("/photos/rice-ostra"));
    assert_eq!(new.open.sources[0].depth.as_deref(), Some(std::path::Path::new("/photos/rice-depth")));
    assert_eq!(new.cameras.as_deref(), Some(std::path::Path::new("/photos/sparse")));
    assert_eq!((new.open.every, new.open.depth_unit), (1, 0.001));
    assert_eq!(harness.state().shell.view.dialog, None);
}

#[test]
fn export_writes_what_is_ticked() {
    let mut harness = Desk::sample().shown();
    press(&mut harness, Modifiers { ctrl: true, command: true, ..Modifiers::NONE }, Key::E);
    assert_eq!(harness.state().shell.view.dialog, Some(Dialog::Export));
    harness.get_all_by_label("Masks").last().unwrap().click();
    type_into(&mut harness, "Export folder", "/out");
    harness.get_by_label("Write files").click();
    harness.run_steps(2);
    let Command::Export(request) = &harness.state().asked[0] else { panic!("{:?}", harness.state().asked) };
    assert_eq!(request.cloud.as_deref(), Some(std::path::Path::new("/out/cloud.ply")));
    assert_eq!(request.masks.as_deref(), Some(std::path::Path::new("/out/masks")));
    assert_eq!(request.cameras, None);
}

#[test]
fn escape_closes_a_dialog_and_asks_for_nothing() {
    let mut harness = Desk::sample().shown();
    for dialog in [Dialog::NewProject, Dialog::AddFrames, Dialog::Export, Dialog::Shortcuts, Dialog::Palette] {
        harness.state_mut().shell.view.dialog = Some(dialog);
        harness.run_steps(3);
        assert_eq!(harness.unnamed_widgets(), Vec::<String>::new(), "{dialog:?}");
        press(&mut harness, Modifiers::NONE, Key::Escape);
        assert_eq!(harness.state().shell.view.dialog, None, "{dialog:?}");
    }
    assert!(harness.state().asked.is_empty());
}
