//! Attaches unlabelled fragments of the cloud to the label they touch, by the command line.
//!
//! The masks change, too.

use std::ops::ControlFlow;
use std::path::Path;
use std::process::Command as Process;

use glam::{DVec2, Vec3};
use ostra_cloud::LabelledCloud;
use ostra_cloud::select::{Eye, SeenRegion, SelectStep};
use ostra_masks::LabelId;
use ostra_project::FuseRequest;
use ostra_session::Event;
use ostra_session::{
    AttachRequest, CloudChange, CloudCorrection, Command, RangeChange, RangeRequest, Session,
};

use crate::program::{done, refused};
use crate::session::perform;

/// Returns the synthetic plant at a small image size, prompted, tracked and fused with all points.
fn plant(out: &Path) -> Session {
    let run = Process::new(env!("CARGO_BIN_EXE_ostra"))
        .args(["demo", "--headless", "--frames", "12", "--size", "300x400"])
        .arg(out)
        .output()
        .unwrap();
    assert!(
        run.status.success(),
        "{}",
        String::from_utf8_lossy(&run.stderr)
    );
    let mut session = opened(&out.join("project"));
    perform(&mut session, Command::Fuse(FuseRequest::default())).unwrap();
    perform(&mut session, Command::Attach(AttachRequest::default())).unwrap();
    session
}

fn opened(root: &Path) -> Session {
    let mut session = Session::new();
    perform(&mut session, Command::Open(root.into())).unwrap();
    // The first request starts to load the cloud.
    let _ = session.cloud();
    session.settle(|_| ControlFlow::Continue(()));
    session
}

fn of_label(cloud: &LabelledCloud, label: LabelId) -> Vec<Vec3> {
    let labelled = cloud
        .positions
        .iter()
        .zip(&cloud.labels)
        .filter(|(_, id)| **id == label);
    labelled.map(|(position, _)| *position).collect()
}

fn count(session: &Session, label: LabelId) -> usize {
    of_label(session.cloud().unwrap(), label).len()
}

/// Removes the label from a leaf's tip in all masks, as seen in one frame.
///
/// The tip is the point farthest from the middle of the stem.
fn clear_tip(session: &mut Session, leaf: LabelId, stem: LabelId) {
    let cloud = session.cloud().unwrap();
    let stem = of_label(cloud, stem);
    let middle = stem.iter().sum::<Vec3>() / stem.len() as f32;
    let far = |point: &Vec3| point.distance_squared(middle);
    let tip = of_label(cloud, leaf)
        .into_iter()
        .max_by(|a, b| far(a).total_cmp(&far(b)))
        .unwrap()
        .as_dvec3();
    let frames = session.project().unwrap().frames.clone();
    let seen_in = |frame: usize| -> Option<DVec2> {
        let (camera, pose) = frames[frame].posed_camera()?;
        camera
            .project(pose.transform(tip))
            .filter(|at_px| camera.contains(*at_px))
    };
    let cleared = (0..frames.len()).find(|&frame| {
        let Some(at_px) = seen_in(frame) else {
            return false;
        };
        let seen = SeenRegion {
            eye: Eye::Frame(frame),
            points_px: vec![at_px],
            radius_px: 12.0,
            remove: false,
            hidden: Vec::new(),
            isolated: None,
            uncertain_below: None,
            cube_from_world: None,
        };
        let select = vec![
            SelectStep::Seen(seen),
            SelectStep::Only(leaf),
            SelectStep::Piece(0),
        ];
        let correction = CloudCorrection {
            select,
            change: CloudChange::Clear,
            as_keyframes: false,
        };
        perform(session, Command::CorrectCloud(correction)).is_ok()
    });
    assert!(cleared.is_some(), "some frame sees the tip");
}

fn unlabelled_leaf_tip_is_attached_to_the_leaf() {
    let out = tempfile::tempdir().unwrap();
    let folder = out.path().join("demo");
    let mut session = plant(&folder);
    let labels = &session.project().unwrap().labels;
    let [leaf, stem] = ["leaf", "stem"].map(|name| labels.by_name(name).unwrap().id);
    let whole = count(&session, leaf);
    clear_tip(&mut session, leaf, stem);
    let bare = 5;
    perform(&mut session, Command::ClearMask { frame: bare }).unwrap();
    let (before, cut) = (session.project().unwrap().clone(), count(&session, leaf));
    assert!(cut + 20 < whole, "{cut} points of {whole}: a tip is gone");
    session.save().unwrap();
    drop(session);

    let root = folder.join("project");
    let project = root.to_str().unwrap();
    assert!(refused(&["adopt", project, "--radius", "0.5"]).contains("radius"));
    let output = done(&["adopt", project]);
    assert!(output.contains("attached: leaf 1 piece of "), "{output}");
    assert!(
        done(&["adopt", project]).contains("no unlabelled fragment touches"),
        "it is done"
    );

    let mut session = opened(&root);
    let healed = count(&session, leaf);
    assert!(
        healed - cut >= (whole - cut) * 9 / 10,
        "{cut}, {healed} of {whole}"
    );
    assert_eq!(session.undo_title(), Some("Attach loose fragments"));
    let has_mask = |session: &Session| session.project().unwrap().masks.contains_key(&bare);
    assert!(
        !has_mask(&session),
        "a frame without a mask gets none: it would vote for nothing but the tip"
    );
    perform(&mut session, Command::Undo).unwrap();
    assert!(
        **session.project().unwrap() == *before,
        "one undo takes all of it back"
    );

    let depths = before
        .frames
        .iter()
        .filter_map(|frame| frame.depth.as_ref()?.sensor_path());
    depths.for_each(|path| std::fs::write(path, "").unwrap());
    let events = perform(&mut session, Command::Attach(AttachRequest::default())).unwrap();
    let warnings = events.iter().filter_map(|event| {
        if let Event::Warning(text) = event {
            Some(text)
        } else {
            None
        }
    });
    assert_eq!(
        warnings
            .filter(|text| text.contains("depth that cannot be read"))
            .count(),
        1,
        "{events:?}"
    );
    assert!(
        **session.project().unwrap() != *before,
        "depths that cannot be read stop nothing"
    );
    perform(&mut session, Command::Undo).unwrap();

    let to = before.frames.len() - 1;
    let hide = RangeRequest {
        labels: vec![leaf],
        from: 0,
        to,
        change: RangeChange::Hide,
        replace: false,
    };
    perform(&mut session, Command::Range(hide)).unwrap();
    let hidden = session.project().unwrap().clone();
    perform(&mut session, Command::Attach(AttachRequest::default())).unwrap();
    assert!(
        **session.project().unwrap() == *hidden,
        "a leaf that is hidden gets nothing, nor does the stem get any of it"
    );
}

crate::registry::tests! {
    Nothing => unlabelled_leaf_tip_is_attached_to_the_leaf;
}
