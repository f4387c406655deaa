//! Tests of the dialogs.

use std::sync::Arc;

use egui::{Key, Modifiers};
use egui_kittest::kittest::{NodeT, Queryable};
use ostra_app::{Dialog, HelpPage, NewProjectForm};
use ostra_cloud::measure::GroundChoice;
use ostra_compute::nn::Installed;
use ostra_frames::FrameFolder;
use ostra_frames::cameras::ModelEncoding;
use ostra_masks::MaskFormat;
use ostra_project::ExportRequest;
use ostra_session::{
    Command, ExportedItem, FoundCameras, FoundDepth, InstallRequest, ModelRequest, ModelTask,
    NewProject, RecentProject, Survey,
};

use crate::desk::{Desk, press};

fn type_into(harness: &mut egui_kittest::Harness<'_, Desk>, name: &str, text: &str) {
    // A label with the same text may stand before the field.
    harness.get_all_by_label(name).last().unwrap().focus();
    harness.run_steps(2);
    harness.event(egui::Event::Text(text.into()));
    harness.run_steps(2);
}

/// Returns what is found in the files of the form: three frames with depth and cameras.
fn found(desk: &Desk) -> Survey {
    let request = desk.shell.view.new_project.survey_request().unwrap();
    Survey {
        sources: vec![FrameFolder {
            frames: request.paths[0].clone(),
            depth: Some("/photos/depth".into()),
        }],
        request,
        frames: Arc::clone(&Desk::sample().project.frames),
        depth: Some(FoundDepth {
            frames: 12,
            folder: "/photos/depth".into(),
        }),
        cameras: Some(FoundCameras {
            path: "/photos/sparse".into(),
            frames: 11,
        }),
        intrinsics: None,
        root: Some("/photos-ostra".into()),
        warnings: vec!["the unit may be wrong; give the depth unit (--depth-unit)".into()],
        error: None,
    }
}

fn requested_project(harness: &egui_kittest::Harness<'_, Desk>) -> NewProject {
    match &harness.state().requested[..] {
        [Command::New(new)] => new.clone(),
        other => panic!("{other:?}"),
    }
}

#[test]
fn new_project_uses_what_was_found_and_ticked() {
    let mut harness = Desk::empty().shown();
    harness.get_by_label("Photos of an object").click();
    harness.run_steps(3);
    harness.get_by_label("New project from photos");
    assert!(
        harness
            .get_by_label("Create")
            .accesskit_node()
            .is_disabled()
    );
    // The first field has the keyboard.
    harness.event(egui::Event::Text("/photos/color".into()));
    harness.run_steps(2);
    harness.state_mut().survey = Some(Arc::new(found(harness.state())));
    harness.run_steps(5);
    harness.get_by_label("12 images · 64 × 48 pixels");
    harness.get_by_label_contains("the unit may be wrong; give the depth unit");
    assert!(harness.query_by_label_contains("--").is_none());
    harness
        .get_by_label("Cameras of 11 of 12 frames, from photos/sparse")
        .click();
    harness.run_steps(2);
    press(&mut harness, Modifiers::NONE, Key::Enter);
    let new = requested_project(&harness);
    assert_eq!(new.root, std::path::Path::new("/photos-ostra"));
    assert_eq!(
        new.open.sources[0].depth.as_deref(),
        Some(std::path::Path::new("/photos/depth"))
    );
    assert_eq!(new.cameras, None, "not ticked");
    assert_eq!((new.open.every, new.open.depth_unit), (1, 0.001));
    assert_eq!(
        harness.state().shell.view.dialog,
        Some(Dialog::NewProject),
        "open until the project is created"
    );
}

#[test]
fn typed_places_take_precedence_and_enter_waits_for_the_files() {
    let mut harness = Desk::empty().shown();
    harness.state_mut().shell.view.dialog = Some(Dialog::NewProject);
    harness.run_steps(3);
    harness.get_by_label("Advanced").click();
    harness.run_steps(12);
    type_into(&mut harness, "Cameras", "/other/sparse");
    type_into(&mut harness, "Project folder", "/projects/rice");
    type_into(&mut harness, "Frames", "/photos/color");
    press(&mut harness, Modifiers::NONE, Key::Enter);
    assert!(
        harness.state().requested.is_empty(),
        "the files are not read"
    );
    harness.state_mut().survey = Some(Arc::new(found(harness.state())));
    harness.run_steps(3);
    let new = requested_project(&harness);
    assert_eq!(new.root, std::path::Path::new("/projects/rice"));
    assert_eq!(new.cameras, Some("/other/sparse".into()));
}

#[test]
fn several_files_are_listed_and_can_be_cleared() {
    let mut desk = Desk::empty();
    let paths = ["/photos/1.jpg", "/photos/2.jpg"].map(std::path::PathBuf::from);
    desk.shell.view.new_project = NewProjectForm::with_paths(paths.to_vec());
    desk.shell.view.dialog = Some(Dialog::NewProject);
    let mut harness = desk.shown();
    harness.get_by_label("2 items in /photos");
    assert!(harness.query_by_label("Frames").is_none());
    harness.get_by_label("Clear selection").click();
    harness.run_steps(3);
    harness.get_by_label("Frames");
    assert_eq!(
        harness.state().shell.view.new_project.survey_request(),
        None
    );
}

#[test]
fn missing_file_chooser_is_reported_in_the_form() {
    let mut harness = Desk::empty().shown();
    harness.get_by_label("Video").click();
    harness.run_steps(3);
    harness.get_by_label("Choose files…").click();
    harness.run_steps(3);
    harness.get_by_label_contains("No file chooser on this system");
}

#[test]
fn first_page_opens_recent_projects_and_greys_missing_ones() {
    let mut desk = Desk::empty();
    desk.shell.view.has_example = true;
    let roots = ["/projects/rice", "/stick/maize"].map(std::path::PathBuf::from);
    desk.recent = roots.to_vec();
    desk.recent_projects.insert(
        roots[0].clone(),
        RecentProject::Available {
            frames: 3,
            thumbnail: Some(Arc::new(crate::desk::image(0))),
        },
    );
    let missing = RecentProject::Unavailable("the folder is missing".into());
    desk.recent_projects.insert(roots[1].clone(), missing);
    let mut harness = desk.shown();
    assert_eq!(harness.unnamed_widgets(), Vec::<String>::new());
    let gone = harness.get_by_label("maize: the folder is missing");
    assert!(gone.accesskit_node().is_disabled());
    harness.get_by_label("Open rice").click();
    harness.run_steps(2);
    assert_eq!(harness.state().requested, [Command::Open(roots[0].clone())]);
    harness.get_by_label("Try the example plant").click();
    harness.run_steps(2);
    assert!(harness.state().shell.view.wants_example);
}

#[test]
fn help_pages_open_from_the_menu() {
    let mut harness = Desk::empty().shown();
    for (entry, content) in [
        ("Guide…", "From photos of a plant to a table of traits"),
        ("What's new…", "Changelog"),
        ("Report a problem…", "Graphics adapter"),
        ("About OSTRA…", "ONNX Runtime"),
    ] {
        harness.get_all_by_label("Help").next().unwrap().click();
        harness.run_steps(3);
        // The shortcut is a part of an entry's name.
        harness.get_by_label_contains(entry).click();
        harness.run_steps(3);
        assert!(
            harness.query_all_by_label_contains(content).count() > 0,
            "{entry}"
        );
        press(&mut harness, Modifiers::NONE, Key::Escape);
        assert_eq!(harness.state().shell.view.dialog, None);
    }
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
    harness
        .get_by_role_and_label(egui::Role::CheckBox, "Cameras")
        .click();
    harness.get_by_label("Undistorted").click();
    harness.get_by_label("Traits").click();
    // A tick may add a row above the next control.
    harness.run_steps(4);
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
    assert_eq!(request.cameras, path("/out/sparse"));
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
    assert_eq!(masks.mask_format, Some(MaskFormat::Coco));
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

const DIALOGS: [Dialog; 9] = [
    Dialog::NewProject,
    Dialog::AddFrames,
    Dialog::Export,
    Dialog::Exported,
    Dialog::Models,
    Dialog::Shortcuts,
    Dialog::Palette,
    Dialog::Help(HelpPage::Guide),
    Dialog::Help(HelpPage::About),
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
            .get_by_label("Install superpoint")
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
        requested("onnxruntime", ModelTask::Install(InstallRequest::default())),
        requested("sam-vit-b", ModelTask::Add(vec!["/downloads/sam".into()])),
        requested("xfeat", ModelTask::Check),
    ];
    assert_eq!(harness.state().requested, expected);
}
