//! Tests of the dialogs.

use egui::{Key, Modifiers};
use egui_kittest::kittest::{NodeT, Queryable};
use ostra_app::Dialog;
use ostra_cloud::measure::GroundChoice;
use ostra_compute::nn::Installed;
use ostra_frames::cameras::ModelEncoding;
use ostra_session::{Command, ModelRequest, ModelTask};

use crate::desk::{Desk, press};

fn type_into(harness: &mut egui_kittest::Harness<'_, Desk>, name: &str, text: &str) {
    harness.get_by_label(name).focus();
    harness.run_steps(2);
    harness.event(egui::Event::Text(text.into()));
    harness.run_steps(2);
}

#[test]
fn new_project_uses_the_typed_paths() {
    let mut harness = Desk::empty().shown();
    harness.get_by_label("New project…").click();
    harness.run_steps(3);
    assert!(
        harness
            .get_by_label("Create")
            .accesskit_node()
            .is_disabled()
    );
    type_into(&mut harness, "Frames folder or video", "/photos/rice");
    type_into(&mut harness, "Depth folder", "/photos/rice-depth");
    type_into(&mut harness, "Cameras file or folder", "/photos/sparse");
    harness.get_by_label("Create").click();
    harness.run_steps(2);
    let Command::New(new) = &harness.state().requested[0] else {
        panic!("{:?}", harness.state().requested)
    };
    assert_eq!(new.root, std::path::Path::new("/photos/rice-ostra"));
    assert_eq!(
        new.open.sources[0].depth.as_deref(),
        Some(std::path::Path::new("/photos/rice-depth"))
    );
    assert_eq!(
        new.cameras.as_deref(),
        Some(std::path::Path::new("/photos/sparse"))
    );
    assert_eq!((new.open.every, new.open.depth_unit), (1, 0.001));
    assert_eq!(harness.state().shell.view.dialog, None);
}

#[test]
fn export_writes_the_checked_outputs() {
    let mut harness = Desk::sample().shown();
    press(
        &mut harness,
        Modifiers {
            ctrl: true,
            command: true,
            ..Modifiers::NONE
        },
        Key::E,
    );
    assert_eq!(harness.state().shell.view.dialog, Some(Dialog::Export));
    harness.get_all_by_label("Masks").last().unwrap().click();
    harness.get_by_label("Undistorted").click();
    harness.get_by_label("binary").click();
    harness.run_steps(2);
    harness.get_by_label("Ground").click();
    harness.run_steps(3);
    harness.get_by_label("given as numbers").click();
    harness.run_steps(3);
    assert_eq!(harness.unnamed_widgets(), Vec::<String>::new());
    type_into(&mut harness, "Export folder", "/out");
    harness.get_by_label("Write files").click();
    harness.run_steps(2);
    let Command::Export(request) = &harness.state().requested[0] else {
        panic!("{:?}", harness.state().requested)
    };
    assert_eq!(
        request.cloud.as_deref(),
        Some(std::path::Path::new("/out/cloud.ply"))
    );
    assert_eq!(
        request.masks.as_deref(),
        Some(std::path::Path::new("/out/masks"))
    );
    assert_eq!(request.cameras, None);
    assert_eq!(
        request.undistorted.as_deref(),
        Some(std::path::Path::new("/out/undistorted"))
    );
    assert_eq!(request.camera_encoding, ModelEncoding::Binary);
    assert_eq!(
        request.ground,
        GroundChoice::Plane {
            normal: [0.0, 0.0, 1.0],
            offset: 0.0
        }
    );
}

const DIALOGS: [Dialog; 6] = [
    Dialog::NewProject,
    Dialog::AddFrames,
    Dialog::Export,
    Dialog::Models,
    Dialog::Shortcuts,
    Dialog::Palette,
];

#[test]
fn escape_closes_a_dialog_and_requests_nothing() {
    let mut harness = Desk::sample().shown();
    for dialog in DIALOGS {
        harness.state_mut().shell.view.dialog = Some(dialog);
        harness.run_steps(3);
        assert_eq!(
            harness.unnamed_widgets(),
            Vec::<String>::new(),
            "{dialog:?}"
        );
        press(&mut harness, Modifiers::NONE, Key::Escape);
        assert_eq!(harness.state().shell.view.dialog, None, "{dialog:?}");
    }
    assert!(harness.state().requested.is_empty());
}

#[test]
fn networks_are_installed_added_and_checked() {
    let mut desk = Desk::empty();
    for row in &mut desk.models {
        let there = Installed {
            paths: vec!["/networks/xfeat.onnx".into()],
            bytes: 2_700_000,
        };
        row.installed = (row.name == "xfeat").then_some(there);
    }
    desk.shell.view.dialog = Some(Dialog::Models);
    let mut harness = desk.shown();
    assert!(
        harness
            .query_by_label_contains("installed, 2.7 MB")
            .is_some()
    );
    assert!(
        harness
            .get_by_label("Install sam-vit-b")
            .accesskit_node()
            .is_disabled(),
        "it has no address"
    );
    assert!(
        harness.query_by_label("Install xfeat").is_none(),
        "it is there"
    );
    for button in ["Install onnxruntime", "Add sam-vit-b"] {
        harness.get_by_label(button).click();
        harness.run_steps(3);
    }
    type_into(&mut harness, "Network files", "/downloads/sam");
    harness.get_by_label("Add files").click();
    harness.run_steps(6);
    assert!(
        harness.query_by_label("Add files").is_none(),
        "the form is closed"
    );
    harness.get_by_label("Check xfeat").click();
    harness.run_steps(3);
    let requested = |name: &str, task| {
        Command::Model(ModelRequest {
            name: name.into(),
            task,
        })
    };
    let expected = [
        requested("onnxruntime", ModelTask::Install),
        requested("sam-vit-b", ModelTask::Add(vec!["/downloads/sam".into()])),
        requested("xfeat", ModelTask::Check),
    ];
    assert_eq!(harness.state().requested, expected);
}
