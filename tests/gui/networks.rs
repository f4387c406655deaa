//! Tests of the dialog *Networks*: variants, licences, results of tests, removal.

use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use ostra_app::Dialog;
use ostra_compute::nn::{Installed, ModelStatus, TestResult};
use ostra_session::{Command, InstallRequest, ModelRequest, ModelTask};

use crate::desk::Desk;

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
