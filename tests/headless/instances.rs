//! Tests of instances of a label, by the command line.
//!
//! The accuracy tests do the same with the scene of voxel blocks.

use std::ops::ControlFlow;

use ostra_project::ResultKind;
use ostra_session::{Command, Session};

use super::recording::Recording;
use crate::program::{done, refused};
use crate::session::perform;

#[test]
fn label_gets_an_instance_in_masks_and_cloud() {
    let recording = Recording::new();
    let project = recording.project();
    done(&["label", &project, "thing"]);
    done(&[
        "prompt", &project, "--frame", "1", "--label", "thing", "--click", "20,24",
    ]);
    done(&["track", &project, "--tracker", "geometry"]);
    done(&["fuse", &project, "--voxel", "0.02"]);
    let instances = ["instances", &project, "--label"];
    assert!(refused(&[&instances[..], &["missing"]].concat()).contains("missing"));
    let no_radius = refused(&[&instances[..], &["thing", "--radius", "0"]].concat());
    assert!(no_radius.contains("radius"), "{no_radius}");
    let listed = done(&[&instances[..], &["thing", "--min-points", "20"]].concat());
    assert!(listed.starts_with("thing 1 "), "{listed}");
    let mut session = Session::new();
    perform(&mut session, Command::Open(project.into())).unwrap();
    let _ = session.cloud();
    session.settle(|_| ControlFlow::Continue(()));
    let labels = &session.project().unwrap().labels;
    let [thing, instance] = ["thing", "thing 1"].map(|name| labels.by_name(name).unwrap().id);
    let cloud = &session.cloud().unwrap().labels;
    assert!(cloud.contains(&instance) && !cloud.contains(&thing));
    let project = session.project().unwrap();
    assert!(!project.results[&ResultKind::Cloud].stale);
    let shows = |id| {
        let masks = project.masks.values();
        masks
            .filter(|mask| mask.runs.extents().contains_key(&id))
            .count()
    };
    assert_eq!((shows(instance), shows(thing)), (4, 0));
}
