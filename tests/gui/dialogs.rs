//! Tests of the dialogs.

use egui::{Key, Modifiers};
use egui_kittest::kittest::{NodeT, Queryable};
use ostra_app::Dialog;
use ostra_cloud::measure::GroundChoice;
use ostra_compute::nn::Installed;
use ostra_frames::cameras::ModelEncoding;
use ostra_project::ExportRequest;
use ostra_session::{Command, ExportedItem, ModelRequest, ModelTask};

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

/// Opens the export dialog of a desk.
fn exporting(desk: Desk) -> egui_kittest::Harness<'static, Desk> {
    let mut harness = desk.shown();
    let ctrl = Modifiers {
        ctrl: true,
        command: true,
        ..Modifiers::NONE
    };
    press(&mut harness, ctrl, Key::E);
    assert_eq!(harness.state().shell.view.dialog, Some(Dialog::Export));
    harness
}

/// Replaces the suggested folder.
fn export_into(harness: &mut egui_kittest::Harness<'_, Desk>, folder: &str) {
    harness.get_by_label("Export folder").focus();
    harness.run_steps(2);
    press(harness, Modifiers::COMMAND, Key::A);
    harness.event(egui::Event::Text(folder.into()));
    harness.run_steps(2);
}

/// Selects "Write files" and returns the request.
fn written(harness: &mut egui_kittest::Harness<'_, Desk>) -> ExportRequest {
    harness.get_by_label("Write files").click();
    harness.run_steps(2);
    let Some(Command::Export(request)) = harness.state_mut().requested.pop() else {
        panic!("nothing is exported")
    };
    request
}

#[test]
fn export_writes_the_checked_outputs() {
    let mut harness = exporting(Desk::sample());
    harness.get_all_by_label("Masks").last().unwrap().click();
    harness.get_by_label("Undistorted").click();
    harness.get_by_label("Traits").click();
    harness.get_by_label("Advanced options").click();
    harness.run_steps(30);
    harness.get_by_label("binary").click();
    harness.run_steps(2);
    harness.get_by_label("Ground").click();
    harness.run_steps(3);
    harness.get_by_label("given as numbers").click();
    harness.run_steps(3);
    assert_eq!(harness.unnamed_widgets(), Vec::<String>::new());
    export_into(&mut harness, "/out");
    let request = written(&mut harness);
    let path = |name: &str| Some(std::path::PathBuf::from(name));
    assert_eq!(request.cloud, path("/out/cloud.ply"));
    assert_eq!(request.masks, path("/out/masks"));
    assert_eq!(request.traits, path("/out/traits.csv"));
    assert_eq!(request.cameras, None);
    assert_eq!(request.undistorted, path("/out/undistorted"));
    assert_eq!(request.camera_encoding, ModelEncoding::Binary);
    assert_eq!(
        request.ground,
        GroundChoice::Plane {
            normal: [0.0, 0.0, 1.0],
            offset: 0.0
        }
    );
}

#[test]
fn export_presets_need_two_clicks_and_suggest_a_folder() {
    let dir = tempfile::tempdir().unwrap();
    let with = |preset: &str| {
        let mut harness = exporting(Desk {
            root: Some(dir.path().join("rice")),
            ..Desk::sample()
        });
        harness.get_by_label(preset).click();
        harness.run_steps(2);
        written(&mut harness)
    };
    let path = |name: &str| Some(dir.path().join("rice-export").join(name));
    let traits = with("Plant traits");
    assert_eq!((traits.traits, traits.cloud), (path("traits.csv"), None));
    let masks = with("COCO masks");
    assert_eq!((masks.masks, masks.cloud), (path("masks"), None));
    assert_eq!(masks.mask_format.as_deref(), Some("coco"));
    let cloud = with("Labelled cloud for CloudCompare");
    assert_eq!((cloud.cloud, cloud.twin), (path("cloud.ply"), true));
    assert_eq!((cloud.masks, cloud.traits), (None, None));
    let all = with("Everything");
    assert!(all.cloud.is_some() && all.masks.is_some() && all.traits.is_some());
    assert!(all.cameras.is_some() && all.undistorted.is_some());
}

#[test]
fn export_hides_options_of_what_is_not_ticked_and_fits_a_small_window() {
    let mut harness = exporting(Desk::sample());
    harness.set_size(egui::vec2(800.0, 600.0));
    harness.run_steps(4);
    assert!(
        harness.query_by_label("Cloud format").is_none(),
        "options are closed"
    );
    harness.get_by_label("Advanced options").click();
    harness.run_steps(30);
    harness.get_by_label("Cloud format");
    for hidden in [
        "Mesh format",
        "Voxel format",
        "Mask format",
        "Ground",
        "binary",
    ] {
        assert!(harness.query_by_label(hidden).is_none(), "{hidden}");
    }
    harness.get_by_label("Everything").click();
    harness.run_steps(4);
    for shown in ["Mask format", "Ground", "binary"] {
        harness.get_by_label(shown);
    }
    let window = egui::Rect::from_min_size(egui::Pos2::ZERO, egui::vec2(800.0, 600.0));
    for button in ["Write files", "Cancel", "Plant traits"] {
        let rect = harness.get_by_label(button).rect();
        assert!(window.contains_rect(rect), "{button} at {rect}");
    }
    let empty = exporting(Desk {
        cloud: None,
        ..Desk::sample()
    });
    let traits = empty.get_by_label("Plant traits");
    assert!(traits.accesskit_node().is_disabled(), "there is no cloud");
}

#[test]
fn written_files_are_listed_and_their_folder_is_shown() {
    let mut desk = Desk::sample();
    let item = |path: &str, files, bytes| ExportedItem {
        path: path.into(),
        files,
        bytes,
    };
    desk.shell.view.exported = vec![
        item("/out/cloud.ply", None, 12_300_000),
        item("/out/masks", Some(16), 45_000),
    ];
    desk.shell.view.dialog = Some(Dialog::Exported);
    let mut harness = desk.shown();
    let masks = format!("masks{}, 16 files", std::path::MAIN_SEPARATOR);
    for text in ["cloud.ply", "12.3 MB", &masks, "45.0 kB"] {
        harness.get_by_label(text);
    }
    harness.get_by_label("Show in folder").click();
    harness.run_steps(2);
    let view = &harness.state().shell.view;
    assert_eq!(view.folder_to_show, Some("/out".into()));
    harness.get_by_label("Close list of files").click();
    harness.run_steps(2);
    assert_eq!(harness.state().shell.view.dialog, None);
}

const DIALOGS: [Dialog; 7] = [
    Dialog::NewProject,
    Dialog::AddFrames,
    Dialog::Export,
    Dialog::Exported,
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
