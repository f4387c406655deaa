//! Tests of the live vote.
//!
//! After a correction, the points vote again in memory without a new fusion.

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;

use ostra_cloud::LabelledCloud;
use ostra_cloud::ply::read_ply;
use ostra_masks::{LabelId, MaskFormat, RunMask, encode_palette_png};
use ostra_project::{ExportRequest, FuseRequest, ResultKind};
use ostra_session::Event;
use ostra_session::{Command, Session, SurfaceKind};

use super::correct::{JOKES, TISSUES, truth, wrongly_labelled};
use crate::data::data_dir;
use crate::session::perform;

/// Imports the ground-truth masks of some frames.
fn put_right(session: &mut Session, data: &Path, folder: &Path, frames: std::ops::Range<usize>) {
    let masks = folder.join(format!("right-{}", frames.start));
    std::fs::create_dir(&masks).unwrap();
    for frame in frames {
        let png = encode_palette_png(
            &RunMask::encode(&truth(data, frame)),
            &session.project().unwrap().labels,
        )
        .unwrap();
        std::fs::write(masks.join(format!("{frame:06}.png")), png).unwrap();
    }
    perform(
        session,
        Command::ImportMasks {
            dir: masks,
            format: MaskFormat::Davis,
        },
    )
    .unwrap();
}

/// Starts the live vote and returns the cloud after it.
fn followed(session: &mut Session) -> Arc<LabelledCloud> {
    session.follow_masks();
    let events = session.settle(|_| ControlFlow::Continue(()));
    assert!(
        !events
            .iter()
            .any(|event| matches!(event, Event::Failed { .. } | Event::Warning(_))),
        "{events:?}"
    );
    Arc::clone(session.cloud().unwrap())
}

fn count(cloud: &LabelledCloud, label: LabelId) -> usize {
    cloud.labels.iter().filter(|&&id| id == label).count()
}

fn conflicts(session: &mut Session) -> BTreeMap<usize, f32> {
    let _ = session.conflicts();
    session.settle(|_| ControlFlow::Continue(()));
    session
        .conflicts()
        .iter()
        .map(|(&frame, conflict)| (frame, conflict.share()))
        .collect()
}

fn fuse() -> Command {
    Command::Fuse(FuseRequest {
        voxel: Some(0.004),
        ..FuseRequest::default()
    })
}

fn labels_after_a_live_vote_equal_those_of_a_new_fusion() {
    let data = data_dir();
    let folder = tempfile::tempdir().unwrap();
    let mut session = wrongly_labelled(&data, folder.path());
    let file = session.root().unwrap().join("cloud.ply");
    let (wrong, written) = (
        Arc::clone(session.cloud().unwrap()),
        std::fs::read(&file).unwrap(),
    );
    assert!(
        Arc::ptr_eq(&followed(&mut session), &wrong),
        "nothing changed since the points voted"
    );
    assert!(
        conflicts(&mut session)
            .values()
            .all(|&conflict| conflict < 0.1)
    );
    // One corrected frame is outvoted and only changes the confidence. Ten of the fifteen win.
    put_right(&mut session, &data, folder.path(), 7..8);
    let one = followed(&mut session);
    assert!(one.labels != wrong.labels || one.confidence != wrong.confidence);
    assert!(
        count(&one, TISSUES) < count(&one, JOKES) / 10,
        "{} points",
        count(&one, TISSUES)
    );
    put_right(&mut session, &data, folder.path(), 0..10);
    let ten = followed(&mut session);
    assert!(
        count(&ten, TISSUES) > 1000,
        "{} points",
        count(&ten, TISSUES)
    );
    let conflicts = conflicts(&mut session);
    assert!(
        conflicts[&14] > 0.1 && conflicts[&3] < 0.1,
        "the five that are still wrong are doubtful now: {conflicts:?}"
    );
    for surface in [SurfaceKind::Voxels, SurfaceKind::Mesh] {
        let _ = session.surface(surface);
        session.settle(|_| ControlFlow::Continue(()));
        assert!(
            session
                .surface(surface)
                .unwrap()
                .vertices
                .labels
                .contains(&TISSUES),
            "{surface:?}"
        );
    }
    assert!(session.project().unwrap().results[&ResultKind::Cloud].stale);
    assert!(
        std::fs::read(&file).unwrap() == written,
        "files are made again by a fusion only"
    );
    exported(&mut session, folder.path(), &ten);
    opened_again(&mut session, &ten);
    let votes = Arc::clone(session.votes().unwrap());
    perform(&mut session, fuse()).unwrap();
    let fused = session.cloud().unwrap();
    assert!(
        fused.labels == ten.labels
            && fused.confidence == ten.confidence
            && **session.votes().unwrap() == *votes
    );
    // Undo the fusion, then the correction of ten masks: the reloaded cloud votes again, too.
    for _ in 0..2 {
        perform(&mut session, Command::Undo).unwrap();
        let _ = session.cloud();
        session.settle(|_| ControlFlow::Continue(()));
    }
    assert_eq!(followed(&mut session).labels, one.labels);
    perform(&mut session, Command::Undo).unwrap();
    assert_eq!(followed(&mut session).labels, wrong.labels);
}

/// Checks that the exported cloud is the shown one, and that a warning names results that are not.
fn exported(session: &mut Session, folder: &Path, seen: &LabelledCloud) {
    let (cloud, mesh) = (folder.join("followed.ply"), folder.join("mesh.ply"));
    let warnings = |session: &mut Session, request: ExportRequest| -> Vec<String> {
        let events = perform(session, Command::Export(request)).unwrap();
        let warning = |event| {
            if let Event::Warning(text) = event {
                Some(text)
            } else {
                None
            }
        };
        events.into_iter().filter_map(warning).collect()
    };
    let of_cloud = ExportRequest {
        cloud: Some(cloud.clone()),
        ..ExportRequest::default()
    };
    let reported = warnings(session, of_cloud);
    assert!(
        reported.len() == 1
            && reported[0]
                .contains("labels are up to date, but the points are from the last fusion"),
        "{reported:?}"
    );
    assert_eq!(
        read_ply(&cloud, &Default::default()).unwrap().cloud.labels,
        seen.labels
    );
    let of_mesh = ExportRequest {
        mesh: Some(mesh),
        ..ExportRequest::default()
    };
    let reported = warnings(session, of_mesh);
    assert!(
        reported.len() == 1 && reported[0].contains("the mesh is written as it was fused"),
        "{reported:?}"
    );
}

/// Checks that another session loads the cloud as written and updates it by the live vote.
fn opened_again(session: &mut Session, before: &LabelledCloud) {
    let root = session.root().unwrap().to_owned();
    *session = Session::new();
    perform(session, Command::Open(root.clone())).unwrap();
    let _ = session.cloud();
    session.settle(|_| ControlFlow::Continue(()));
    assert!(session.cloud().unwrap().labels != before.labels);
    let of_cloud = ExportRequest {
        cloud: Some(root.with_extension("ply")),
        ..ExportRequest::default()
    };
    let events = perform(session, Command::Export(of_cloud)).unwrap();
    let tells = |event: &Event| matches!(event, Event::Warning(text) if text.contains("written as it was fused"));
    assert!(events.iter().any(tells), "{events:?}");
    // Accepting the vote gives the same result with and without the live vote.
    perform(
        session,
        Command::AcceptVote {
            frame: 14,
            labels: Vec::new(),
        },
    )
    .unwrap();
    let accepted = session.project().unwrap().masks[&14].runs.clone();
    perform(session, Command::Undo).unwrap();
    assert_eq!(followed(session).labels, before.labels);
    perform(
        session,
        Command::AcceptVote {
            frame: 14,
            labels: Vec::new(),
        },
    )
    .unwrap();
    assert_eq!(session.project().unwrap().masks[&14].runs, accepted);
    assert!(
        accepted.decode().ids.contains(&TISSUES),
        "by the ten that are right"
    );
    perform(session, Command::Undo).unwrap();
    assert_eq!(followed(session).labels, before.labels);
}

crate::registry::tests! {
    Data(&["apc_shelf_rgbd_labels"]) => labels_after_a_live_vote_equal_those_of_a_new_fusion;
}
