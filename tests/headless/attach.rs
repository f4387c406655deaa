//! Attaches a loose fragment of the cloud to the label it touches, by the command line.
//!
//! The accuracy tests do the same with a leaf of the synthetic plant.

use std::ops::ControlFlow;
use std::path::Path;

use glam::DVec2;
use ostra_cloud::select::{Eye, SeenRegion, SelectStep};
use ostra_masks::LabelId;
use ostra_session::{CloudChange, CloudCorrection, Command, Session};

use super::recording::Recording;
use crate::program::{done, refused};
use crate::session::perform;

fn opened(root: &str) -> Session {
    let mut session = Session::new();
    perform(&mut session, Command::Open(Path::new(root).into())).unwrap();
    // The first request starts to load the cloud.
    let _ = session.cloud();
    session.settle(|_| ControlFlow::Continue(()));
    session
}

fn count(session: &Session, label: LabelId) -> usize {
    let labels = &session.cloud().unwrap().labels;
    labels.iter().filter(|id| **id == label).count()
}

#[test]
fn corner_without_a_mask_is_attached_to_its_label() {
    let recording = Recording::new();
    let root = recording.project();
    done(&["label", &root, "thing"]);
    done(&[
        "prompt", &root, "--frame", "1", "--label", "thing", "--click", "20,24",
    ]);
    done(&["track", &root, "--tracker", "geometry"]);
    done(&["fuse", &root, "--voxel", "0.004"]);
    let mut session = opened(&root);
    let thing = session
        .project()
        .unwrap()
        .labels
        .by_name("thing")
        .unwrap()
        .id;
    let whole = count(&session, thing);
    let corner = SeenRegion {
        eye: Eye::Frame(1),
        points_px: vec![DVec2::new(12.0, 33.0)],
        radius_px: 5.0,
        remove: false,
        hidden: Vec::new(),
        isolated: None,
        uncertain_below: None,
        cube_from_world: None,
    };
    let correction = CloudCorrection {
        select: vec![SelectStep::Seen(corner), SelectStep::Only(thing)],
        change: CloudChange::Clear,
        as_keyframes: false,
    };
    perform(&mut session, Command::CorrectCloud(correction)).unwrap();
    let (before, cut) = (session.project().unwrap().clone(), count(&session, thing));
    assert!(cut < whole, "{cut} points of {whole}: a corner is gone");
    session.save().unwrap();
    drop(session);

    assert!(refused(&["attach", &root, "--radius", "0.5"]).contains("radius"));
    done(&["attach", &root]);
    let mut session = opened(&root);
    let healed = count(&session, thing);
    assert!(
        healed - cut >= (whole - cut) * 9 / 10,
        "{cut}, {healed} of {whole}"
    );
    perform(&mut session, Command::Undo).unwrap();
    assert!(
        **session.project().unwrap() == *before,
        "one undo takes all of it back"
    );
}
