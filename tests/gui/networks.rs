//! Tests of networks: the dialog with variants, licences, results of tests and removal, and the
//! offers of a network where it would help.

use std::time::Duration;

use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use glam::DVec2;
use ostra_app::Dialog;
use ostra_compute::nn::{Installed, ModelStatus, TestResult};
use ostra_core::job::{JobId, Overview, ProgressReport};
use ostra_masks::{Click, LabelId, Prompt};
use ostra_project::SegmenterId;
use ostra_project::workflow::WorkflowStep;
use ostra_session::{
    Command, EngineKind, InstallRequest, JobTask, JobView, ModelRequest, ModelTask,
};

use crate::desk::{Desk, on_screen, open_step};

/// Shows the dialog with changed rows.
fn shown(change: impl Fn(&mut ModelStatus)) -> Harness<'static, Desk> {
    let mut desk = Desk::empty();
    for row in &mut desk.models {
        row.installed = None;
        row.tested = None;
        change(row);
    }
    desk.shell.view.dialog = Some(Dialog::Models);
    desk.shown()
}

fn press_button(harness: &mut Harness<'_, Desk>, name: &str) {
    harness.get_by_label(name).click();
    harness.run_steps(4);
}

fn request(name: &str, task: ModelTask) -> Command {
    Command::Model(ModelRequest {
        name: name.into(),
        task,
    })
}

#[test]
fn variant_is_chosen_before_the_download() {
    let mut harness = shown(|_| {});
    assert!(
        harness.query_by_label("Variant of yolox").is_none(),
        "there is only one"
    );
    press_button(&mut harness, "Variant of sam-vit-b");
    press_button(&mut harness, "int8");
    press_button(&mut harness, "Install sam-vit-b");
    press_button(&mut harness, "Install grounding-dino");
    let expected = [("sam-vit-b", "int8"), ("grounding-dino", "half")].map(|(name, variant)| {
        let wanted = InstallRequest {
            variant: Some(variant.into()),
            accept_licence: false,
        };
        request(name, ModelTask::Install(wanted))
    });
    assert_eq!(harness.state().requested, expected);
}

#[test]
fn licence_is_accepted_before_the_download() {
    let mut harness = shown(|row| {
        if row.name == "mobile-sam" {
            row.licence_to_accept = Some("https://licence.example".into());
        }
    });
    press_button(&mut harness, "Install mobile-sam");
    assert!(harness.state().requested.is_empty(), "nothing yet");
    assert!(harness.query_by_label("https://licence.example").is_some());
    press_button(&mut harness, "Cancel");
    assert!(harness.query_by_label("Accept and install").is_none());
    press_button(&mut harness, "Install mobile-sam");
    press_button(&mut harness, "Accept and install");
    let wanted = InstallRequest {
        variant: Some("full".into()),
        accept_licence: true,
    };
    assert_eq!(
        harness.state().requested,
        [request("mobile-sam", ModelTask::Install(wanted))]
    );
}

#[test]
fn result_of_the_test_is_shown_and_a_network_can_be_removed() {
    let mut harness = shown(|row| {
        let result = match row.name.as_str() {
            "mobile-sam" => TestResult::Failed("IoU 0.1".into()),
            "xfeat" => TestResult::Passed,
            _ => return,
        };
        row.tested = Some(result);
        row.installed = Some(Installed {
            paths: vec!["/networks/a.onnx".into()],
            bytes: 2_700_000,
        });
    });
    assert!(harness.query_by_label("test failed, not used").is_some());
    assert!(harness.query_by_label("test passed").is_some());
    assert!(harness.query_by_label("Install mobile-sam").is_none());
    press_button(&mut harness, "Remove mobile-sam");
    assert_eq!(
        harness.state().requested,
        [request("mobile-sam", ModelTask::Remove)]
    );
    let superpoint = harness.get_by_label("Install superpoint");
    assert!(superpoint.accesskit_node().is_disabled(), "no address");
}

#[test]
fn network_that_cannot_be_downloaded_is_removed_after_a_question() {
    let mut harness = shown(|row| {
        if row.name == "superpoint" {
            row.installed = Some(installed());
        }
    });
    press_button(&mut harness, "Remove superpoint");
    assert!(harness.state().requested.is_empty(), "nothing yet");
    press_button(&mut harness, "Keep");
    assert!(harness.query_by_label("Delete files").is_none());
    press_button(&mut harness, "Remove superpoint");
    press_button(&mut harness, "Delete files");
    assert_eq!(
        harness.state().requested,
        [request("superpoint", ModelTask::Remove)]
    );
}

/// Returns a desk on whose first frame a click was answered without a network.
fn without_networks() -> Desk {
    let mut desk = Desk::sample();
    for row in &mut desk.models {
        row.installed = (row.name == "onnxruntime").then(installed);
        row.tested = None;
    }
    for engine in &mut desk.engines {
        engine.installed &= engine.name != "sam" && engine.kind != EngineKind::Grounder;
    }
    let click = Click {
        at_px: DVec2::new(10.5, 20.5),
        include: true,
    };
    let prompt = Prompt {
        clicks: vec![click],
        ..Prompt::default()
    };
    desk.project.prompts.insert((0, LabelId(1)), prompt);
    desk.last_prompt = Some((0, LabelId(1)));
    desk
}

fn installed() -> Installed {
    Installed {
        paths: vec!["/networks/a".into()],
        bytes: 45_000_000,
    }
}

fn installation(network: &str) -> JobView {
    JobView {
        id: JobId(3),
        title: format!("Install {network}"),
        task: Some(JobTask::Network(network.into())),
        report: ProgressReport {
            stage: "Download mobile-sam-encoder.onnx".into(),
            done: 9,
            total: 45,
        },
        overview: Overview::default(),
        elapsed: Duration::from_secs(5),
    }
}

fn install_request(name: &str, variant: Option<&str>) -> Command {
    let wanted = InstallRequest {
        variant: variant.map(Into::into),
        accept_licence: false,
    };
    request(name, ModelTask::Install(wanted))
}

/// Returns the requests but for the library, which a machine may have already.
fn networks_requested(desk: &Desk) -> Vec<Command> {
    let library = install_request("onnxruntime", None);
    let mut requested = desk.requested.clone();
    requested.retain(|command| *command != library);
    requested
}

/// Presses a button that begins an installation, whose jobs run from the next frame on.
fn begin(harness: &mut Harness<'_, Desk>, button: &str, network: &str) {
    harness.state_mut().jobs = ["onnxruntime", network].map(installation).into();
    press_button(harness, button);
}

/// Ends the installation that was begun.
fn finish(harness: &mut Harness<'_, Desk>, network: &str, engine: &str) {
    let desk = harness.state_mut();
    desk.jobs
        .retain(|job| job.task == Some(JobTask::Network(network.into())));
    harness.run_steps(2);
    let desk = harness.state_mut();
    desk.jobs.clear();
    for row in desk.models.iter_mut().filter(|row| row.name == network) {
        row.installed = Some(installed());
    }
    let engines = desk.engines.iter_mut();
    engines
        .filter(|other| other.name == engine)
        .for_each(|other| other.installed = true);
    harness.run_steps(2);
}

#[test]
fn network_for_clicks_is_offered_installed_and_asked_the_same_click() {
    let mut harness = without_networks().shown();
    assert!(
        harness
            .query_by_label_contains("MobileSAM (45 MB, Apache-2.0): better masks")
            .is_some()
    );
    begin(&mut harness, "Install", "mobile-sam");
    assert!(harness.query_by_label_contains("Installing").is_some());
    assert!(harness.query_by_label("Not now").is_none());
    finish(&mut harness, "mobile-sam", "sam");
    let requested = networks_requested(harness.state());
    assert_eq!(requested.len(), 2, "{requested:?}");
    assert_eq!(requested[0], install_request("mobile-sam", Some("full")));
    let Command::Prompt(again) = &requested[1] else {
        panic!("{requested:?}");
    };
    let prompt = &harness.state().project.prompts[&(0, LabelId(1))];
    assert_eq!((again.frame, again.label), (0, LabelId(1)));
    assert_eq!(&again.prompt.clicks, &prompt.clicks);
    assert!(harness.query_by_label_contains("MobileSAM").is_none());
    harness.run_steps(4);
    assert_eq!(networks_requested(harness.state()).len(), 2, "only once");
}

#[test]
fn failed_installation_asks_nothing_and_can_be_tried_again() {
    let mut harness = without_networks().shown();
    begin(&mut harness, "Install", "mobile-sam");
    harness.state_mut().jobs.clear();
    harness.run_steps(2);
    let asked = |command: &Command| matches!(command, Command::Prompt(_));
    assert!(!harness.state().requested.iter().any(asked));
    assert!(harness.query_by_label("Install").is_some());
}

#[test]
fn offer_is_closed_until_the_next_start_or_for_ever() {
    let mut harness = without_networks().shown();
    press_button(&mut harness, "Not now");
    assert!(harness.query_by_label_contains("MobileSAM").is_none());
    assert!(harness.state().shell.view.prefs.offer_networks);
    let mut harness = without_networks().shown();
    press_button(&mut harness, "Never");
    assert!(harness.query_by_label_contains("MobileSAM").is_none());
    assert!(!harness.state().shell.view.prefs.offer_networks);
}

#[test]
fn offer_does_not_cover_the_clicked_place() {
    for (share, is_above) in [(0.1, false), (0.95, true)] {
        let mut desk = without_networks();
        // So low that the image fills its pane from top to bottom.
        desk.size = egui::vec2(1600.0, 560.0);
        let at_px = DVec2::new(10.5, f64::from(desk.project.frames[0].height) * share);
        let prompt = desk.project.prompts.get_mut(&(0, LabelId(1))).unwrap();
        prompt.clicks[0].at_px = at_px;
        let harness = desk.shown();
        let image = harness.get_by_label("Image 000.png").rect();
        let offer = harness.get_by_label("Install").rect();
        let clicked = on_screen(&harness, at_px.x as f32, at_px.y as f32);
        assert!(image.contains_rect(offer), "{offer} in {image}");
        assert!((clicked.y - offer.center().y).abs() > 50.0, "{share}");
        assert_eq!(offer.center().y < image.center().y, is_above, "{share}");
    }
}

#[test]
fn buttons_of_the_offer_stay_together() {
    for width in [1000.0, 1280.0, 1400.0, 1600.0, 2400.0] {
        let mut desk = without_networks();
        desk.size.x = width;
        let harness = desk.shown();
        let row = |name: &str| harness.get_by_label(name).rect().center().y;
        assert_eq!(row("Install"), row("Not now"), "{width}");
        assert_eq!(row("Install"), row("Never"), "{width}");
    }
}

#[test]
fn network_is_not_offered_where_it_would_not_be_used() {
    let is_offered = |change: fn(&mut Desk)| {
        let mut desk = without_networks();
        change(&mut desk);
        let harness = desk.shown();
        harness.query_by_label_contains("MobileSAM").is_some()
    };
    assert!(is_offered(|_| {}));
    assert!(!is_offered(|desk| desk.last_prompt = None));
    assert!(!is_offered(
        |desk| desk.shell.view.segmenter = SegmenterId::Builtin
    ));
    assert!(!is_offered(|desk| {
        let engines = desk.engines.iter_mut();
        engines
            .filter(|engine| engine.name == "sam")
            .for_each(|engine| engine.installed = true);
    }));
    assert!(!is_offered(|desk| {
        let rows = desk.models.iter_mut();
        rows.filter(|row| row.name == "mobile-sam")
            .for_each(|row| row.has_address = false);
    }));
}

#[test]
fn network_for_the_search_by_text_is_offered_and_then_asked() {
    let mut desk = without_networks();
    desk.last_prompt = None;
    let mut harness = desk.shown();
    open_step(&mut harness, WorkflowStep::Label);
    harness.get_by_label("Text to find").focus();
    harness.run_steps(2);
    harness.get_by_label("Text to find").type_text("panicle");
    harness.run_steps(2);
    begin(&mut harness, "Install Grounding DINO", "grounding-dino");
    finish(&mut harness, "grounding-dino", "grounding-dino");
    let requested = networks_requested(harness.state());
    assert_eq!(
        requested[0],
        install_request("grounding-dino", Some("half"))
    );
    let Some(Command::Ground(find)) = requested.get(1) else {
        panic!("{requested:?}");
    };
    assert_eq!(
        (find.frame, find.phrases.as_slice()),
        (0, &["panicle".to_owned()][..])
    );
}
