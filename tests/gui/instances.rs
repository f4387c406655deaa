//! Tests of the label tree, which is changed by dragging, and of the preview of instances.

use std::sync::Arc;

use egui_kittest::kittest::{NodeT, Queryable};
use ostra_cloud::instances::InstanceOptions;
use ostra_masks::{Label, LabelId};
use ostra_session::{Command, InstancesRequest, ProposedInstances};

use crate::desk::{Desk, labels};

type Harness = egui_kittest::Harness<'static, Desk>;

fn drag(harness: &mut Harness, from: &str, to: &str) {
    let place = |harness: &Harness, name: &str| {
        let row = harness.get_by_role_and_label(egui::Role::Button, name);
        row.rect().left_center() + egui::vec2(30.0, 0.0)
    };
    let (from, to) = (place(harness, from), place(harness, to));
    harness.drag_at(from);
    harness.run_steps(2);
    for share in [0.3, 0.7, 1.0] {
        harness.hover_at(from.lerp(to, share));
        harness.run_steps(2);
    }
    harness.drop_at(to);
    harness.run_steps(2);
}

#[test]
fn label_is_dragged_under_another_but_never_below_itself() {
    let mut harness = Desk::sample().shown();
    let pot = harness
        .state()
        .project
        .labels
        .by_name("pot")
        .unwrap()
        .clone();
    let plant = harness.state().project.labels.by_name("plant").unwrap().id;
    drag(&mut harness, "pot", "plant");
    assert_eq!(
        harness.state().requested,
        [Command::EditLabel(Label {
            parent: Some(plant),
            ..pot
        })]
    );
    harness.state_mut().requested.clear();
    drag(&mut harness, "plant", "leaf");
    assert_eq!(
        harness.state().requested,
        [],
        "a leaf is a part of the plant"
    );
}

#[test]
fn instances_are_previewed_before_they_are_created() {
    let mut harness = Desk::sample().shown();
    harness.get_by_label("More for leaf").click();
    harness.run_steps(3);
    harness.get_by_label("Find instances").click();
    harness.run_steps(3);
    let label = harness.state().project.labels.by_name("leaf").unwrap().id;
    let request = InstancesRequest {
        label,
        options: InstanceOptions::default(),
    };
    assert_eq!(harness.state().shell.view.instances, Some(request));
    assert!(
        harness
            .get_by_label("Create instances")
            .accesskit_node()
            .is_disabled(),
        "nothing is found yet"
    );
    let leaf = |n: u16| Label {
        id: LabelId(10 + n),
        name: format!("leaf {n}"),
        color: [n as u8; 3],
        parent: Some(label),
    };
    let cloud = Arc::clone(harness.state().cloud.as_ref().unwrap());
    let found = vec![(leaf(1), 1200), (leaf(2), 70)];
    harness.state_mut().proposed = Some(Arc::new(ProposedInstances {
        labels: found,
        cloud,
    }));
    harness.run_steps(3);
    assert!(
        harness.query_by_label("2 found, shown in 3-D").is_some(),
        "{:?}",
        labels(&harness)
    );
    assert!(harness.query_by_label("leaf 2").is_some());
    harness.get_by_label("Create instances").click();
    harness.run_steps(2);
    assert_eq!(harness.state().requested, [Command::Instances(request)]);
    assert_eq!(harness.state().shell.view.instances, None);
}

#[test]
fn instance_preview_can_be_cancelled() {
    let mut harness = Desk::sample().shown();
    let request = InstancesRequest {
        label: LabelId(2),
        options: InstanceOptions::default(),
    };
    harness.state_mut().shell.view.instances = Some(request);
    harness.run_steps(3);
    harness.get_by_label("Cancel").click();
    harness.run_steps(2);
    assert_eq!(
        (
            harness.state().shell.view.instances,
            harness.state().requested.len()
        ),
        (None, 0)
    );
}

#[test]
fn label_menu_merges_and_moves_labels() {
    let mut harness = Desk::sample().shown();
    for (menu, item) in [("Merge into", "plant"), ("Move under", "leaf")] {
        harness.get_by_label("More for pot").click();
        harness.run_steps(3);
        harness.get_by_label(menu).click();
        harness.run_steps(3);
        harness.get_all_by_label(item).last().unwrap().click();
        harness.run_steps(3);
        crate::desk::press(&mut harness, egui::Modifiers::NONE, egui::Key::Escape);
    }
    let labels = &harness.state().project.labels;
    let [plant, leaf, pot] =
        ["plant", "leaf", "pot"].map(|name| labels.by_name(name).unwrap().clone());
    let requested = &harness.state().requested;
    let moved = Command::EditLabel(Label {
        parent: Some(leaf.id),
        ..pot.clone()
    });
    assert_eq!(
        requested[..],
        [
            Command::MergeLabels {
                label: pot.id,
                into: plant.id
            },
            moved
        ]
    );
}
