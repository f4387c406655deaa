//! Tests of 3-D label corrections that are written back into the masks, by session and by recipe.

use std::collections::BTreeSet;
use std::path::Path;

use glam::DVec2;
use ostra_cloud::instances::InstanceOptions;
use ostra_cloud::select::{Eye, SeenRegion, SelectStep};
use ostra_masks::{LabelId, read_palette_png};
use ostra_project::{FuseRequest, ResultKind};
use ostra_session::{
    CloudChange, CloudCorrection, Command, InstancesRequest, Session, SurfaceKind,
};

use super::recording::Recording;
use crate::program::{done, ostra, refused};
use crate::session::{perform, shown_bytes};

fn square() -> String {
    r#"{"seen":{"eye":{"frame":0},"points_px":[[10,12],[30,12],[30,36],[10,36]]}},{"only":1}"#
        .into()
}

/// Returns a fused project of the recording, with the square labelled `thing` on all frames.
fn labelled(recording: &Recording) -> String {
    let project = recording.project();
    for label in ["thing", "other"] {
        done(&["label", &project, label]);
    }
    done(&[
        "prompt", &project, "--frame", "0", "--label", "thing", "--click", "20,24",
    ]);
    done(&["track", &project, "--tracker", "geometry"]);
    done(&["fuse", &project, "--voxel", "0.01"]);
    project
}

fn recipe(recording: &Recording, project: &str, commands: &str) -> String {
    let path = recording.path("recipe.json");
    let text = format!(
        r#"{{"format":1,"commands":[{{"open":{}}},{commands}]}}"#,
        serde_json::json!(project)
    );
    std::fs::write(&path, text).unwrap();
    path
}

fn pixels(project: &str, frame: usize, label: u16) -> usize {
    let mask = read_palette_png(&Path::new(project).join(format!("masks/{frame}.png"))).unwrap();
    mask.ids.iter().filter(|&&id| id == LabelId(label)).count()
}

#[test]
fn recipe_corrects_through_a_frames_camera() {
    let recording = Recording::new();
    let project = labelled(&recording);
    let things: Vec<usize> = (0..4).map(|frame| pixels(&project, frame, 1)).collect();
    let assign = format!(
        r#"{{"correct_cloud":{{"select":[{}],"change":{{"assign":2}}}}}}"#,
        square()
    );
    done(&["run", &recipe(&recording, &project, &assign)]);
    for (frame, &thing) in things.iter().enumerate() {
        let (left, moved) = (pixels(&project, frame, 1), pixels(&project, frame, 2));
        assert!(
            left == 0 && moved.abs_diff(thing) * 20 <= thing,
            "frame {frame}: {left} left, {moved} of {thing}"
        );
    }
    let info: serde_json::Value =
        serde_json::from_str(&done(&["info", &project, "--json"])).unwrap();
    let masks: Vec<&str> = (0..4)
        .map(|frame| info["frames"][frame]["mask"].as_str().unwrap())
        .collect();
    assert_eq!(
        masks,
        ["anchor", "tracked", "tracked", "tracked"],
        "each stays what it was"
    );
    assert_eq!(info["results"]["cloud"]["stale"], false);

    let clear = r#"{"correct_cloud":{"select":[{"label":2}],"change":"clear","as_anchors":true}}"#;
    done(&["run", &recipe(&recording, &project, clear)]);
    assert!((0..4).all(|frame| pixels(&project, frame, 2) == 0));
    let again = refused(&["run", &recipe(&recording, &project, clear)]);
    assert!(again.contains("no point"), "{again}");
    let nowhere = square().replace("\"frame\":0", "\"frame\":9");
    let wrong = format!(r#"{{"correct_cloud":{{"select":[{nowhere}],"change":"clear"}}}}"#);
    assert!(refused(&["run", &recipe(&recording, &project, &wrong)]).contains("frame 9"));
}

#[test]
fn correction_continues_without_an_unreadable_depth() {
    let recording = Recording::new();
    let project = labelled(&recording);
    let things: Vec<usize> = (0..4).map(|frame| pixels(&project, frame, 1)).collect();
    std::fs::write(recording.path("depth/2.png"), "").unwrap();
    let assign = format!(
        r#"{{"correct_cloud":{{"select":[{}],"change":{{"assign":2}}}}}}"#,
        square()
    );
    let output = ostra(&["run", &recipe(&recording, &project, &assign)]);
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{message}");
    assert!(
        message.contains("1 frame has a depth that cannot be read") && message.contains("2.png"),
        "{message}"
    );
    for (frame, &thing) in things.iter().enumerate() {
        let moved = pixels(&project, frame, 2);
        assert!(2 * moved > thing, "frame {frame}: {moved} of {thing}");
    }
}

#[test]
fn locked_labels_stay_and_deleted_ones_do_not_return() {
    let recording = Recording::new();
    let project = labelled(&recording);
    let things: Vec<usize> = (0..4).map(|frame| pixels(&project, frame, 1)).collect();
    let mark = |label: u16, frame: usize, change: &str| {
        format!(
            r#"{{"range":{{"labels":[{label}],"from":{frame},"to":{frame},"change":"{change}"}}}}"#
        )
    };
    let assign = format!(
        r#"{{"correct_cloud":{{"select":[{}],"change":{{"assign":2}}}}}}"#,
        square()
    );
    let commands = [mark(1, 1, "lock"), mark(2, 2, "delete"), assign].join(",");
    done(&["run", &recipe(&recording, &project, &commands)]);
    assert_eq!(
        (pixels(&project, 1, 1), pixels(&project, 1, 2)),
        (things[1], 0),
        "locked"
    );
    assert_eq!(
        (pixels(&project, 2, 1), pixels(&project, 2, 2)),
        (0, 0),
        "not there"
    );
    assert!(pixels(&project, 3, 2) > 0);
}

/// Checks that a correction equals the vote of the corrected masks, and that one undo reverts it.
#[test]
fn corrected_points_keep_their_label_after_another_fusion() {
    let recording = Recording::new();
    let project = labelled(&recording);
    let mut session = Session::new();
    perform(&mut session, Command::Open(project.into())).unwrap();
    for (from, to) in [(12.0, 20.0), (15.0, 28.0), (2.0, 40.0)] {
        let (before, bytes) = (
            session.project().unwrap().clone(),
            shown_bytes(&mut session),
        );
        let corners = [[from, 10.0], [to, 10.0], [to, 30.0], [from, 30.0]].map(DVec2::from_array);
        let seen = SeenRegion {
            eye: Eye::Frame(1),
            points_px: corners.to_vec(),
            radius_px: 0.0,
            remove: false,
            hidden: Vec::new(),
            isolated: None,
            uncertain_below: None,
            cube_from_world: None,
        };
        let steps = vec![SelectStep::Seen(seen)];
        assert!(
            session.cloud().is_some() || session.votes().is_none(),
            "loaded when asked for"
        );
        session.settle(|_| std::ops::ControlFlow::Continue(()));
        session.select(&steps);
        session.settle(|_| std::ops::ControlFlow::Continue(()));
        let chosen = session.selected().unwrap().unwrap().clone();
        assert!(!chosen.points.is_empty());
        let change = CloudChange::Assign(LabelId(2));
        let correction = CloudCorrection {
            select: steps,
            change,
            as_keyframes: false,
        };
        perform(&mut session, Command::CorrectCloud(correction)).unwrap();
        let labels = session.cloud().unwrap().labels.clone();
        let moved = chosen
            .points
            .iter()
            .filter(|&&point| labels[point as usize] == LabelId(2))
            .count();
        assert!(
            moved * 100 >= chosen.points.len() * 98,
            "{moved} of {}",
            chosen.points.len()
        );
        perform(
            &mut session,
            Command::Fuse(FuseRequest {
                voxel: Some(0.01),
                ..FuseRequest::default()
            }),
        )
        .unwrap();
        assert_eq!(session.cloud().unwrap().labels, labels, "fused again");
        perform(&mut session, Command::Undo).unwrap();
        perform(&mut session, Command::Undo).unwrap();
        assert_eq!(session.project().unwrap(), &before);
        assert!(shown_bytes(&mut session) == bytes);
    }
}

/// Returns the labels of the current mesh.
fn surface_labels(session: &mut Session) -> BTreeSet<LabelId> {
    assert!(
        session.mesh().is_some() || session.surface_voxel().is_some(),
        "the surface is gone"
    );
    session.settle(|_| std::ops::ControlFlow::Continue(()));
    let mesh = session.mesh().expect("a mesh");
    assert!(!mesh.triangles.is_empty());
    mesh.vertices.labels.iter().copied().collect()
}

/// Returns a correction that gives all points of the thing another label.
fn thing_to(label: LabelId) -> CloudCorrection {
    let select = vec![SelectStep::Label(LabelId(1))];
    CloudCorrection {
        select,
        change: CloudChange::Assign(label),
        as_keyframes: false,
    }
}

#[test]
fn surface_of_labelled_points_survives_label_changes() {
    let recording = Recording::new();
    let project = labelled(&recording);
    done(&["fuse", &project, "--voxel", "0.01", "--drop-unlabelled"]);
    let mut session = Session::new();
    perform(&mut session, Command::Open((&project).into())).unwrap();
    assert_eq!(surface_labels(&mut session), BTreeSet::from([LabelId(1)]));
    let options = InstanceOptions {
        min_points: 4,
        ..InstanceOptions::default()
    };
    let instances = Command::Instances(InstancesRequest {
        label: LabelId(1),
        options,
    });
    let merge = Command::MergeLabels {
        label: LabelId(1),
        into: LabelId(2),
    };
    for (command, after) in [
        (Command::CorrectCloud(thing_to(LabelId(2))), 2),
        (merge, 2),
        (instances, 3),
    ] {
        let title = format!("{command:?}");
        perform(&mut session, command).unwrap();
        assert_eq!(session.surface_voxel(), Some(0.01), "{title}");
        assert!(
            surface_labels(&mut session).contains(&LabelId(after)),
            "{title}"
        );
        assert!(
            session.surface(SurfaceKind::Voxels).is_none(),
            "made when first asked for"
        );
        session.settle(|_| std::ops::ControlFlow::Continue(()));
        let voxels = session.surface(SurfaceKind::Voxels).expect("voxels");
        assert!(voxels.vertices.labels.contains(&LabelId(after)), "{title}");
        assert!(
            !session.project().unwrap().results[&ResultKind::Cloud].stale,
            "{title}"
        );
        perform(&mut session, Command::Undo).unwrap();
        assert_eq!(
            surface_labels(&mut session),
            BTreeSet::from([LabelId(1)]),
            "{title}"
        );
    }
}

#[test]
fn mesh_without_known_voters_is_kept_and_stale() {
    let recording = Recording::new();
    let project = labelled(&recording);
    for entry in std::fs::read_dir(Path::new(&project).join("versions")).unwrap() {
        let path = entry.unwrap().path();
        if path.to_string_lossy().contains("surface-votes") {
            std::fs::remove_file(path).unwrap();
        }
    }
    let mut session = Session::new();
    perform(&mut session, Command::Open((&project).into())).unwrap();
    let before = surface_labels(&mut session);
    perform(&mut session, Command::CorrectCloud(thing_to(LabelId(2)))).unwrap();
    assert_eq!(surface_labels(&mut session), before);
    assert!(session.cloud().unwrap().labels.contains(&LabelId(2)));
    assert!(session.project().unwrap().results[&ResultKind::Cloud].stale);
}

#[test]
fn merge_replaces_the_label_in_masks_and_cloud_and_removes_it() {
    let recording = Recording::new();
    let project = labelled(&recording);
    let things: Vec<usize> = (0..4).map(|frame| pixels(&project, frame, 1)).collect();
    let mut session = Session::new();
    perform(&mut session, Command::Open((&project).into())).unwrap();
    let before = session.project().unwrap().clone();
    perform(
        &mut session,
        Command::MergeLabels {
            label: LabelId(1),
            into: LabelId(2),
        },
    )
    .unwrap();
    assert_eq!(session.undo_title(), Some("Merge thing into other"));
    let cloud = session.cloud().unwrap();
    assert!(cloud.labels.contains(&LabelId(2)) && !cloud.labels.contains(&LabelId(1)));
    let after = session.project().unwrap().clone();
    assert!(
        after.labels.get(LabelId(1)).is_none()
            && after.prompts.keys().all(|(_, label)| *label == LabelId(2))
    );
    let area = |frame: &usize| after.masks[frame].runs.region(LabelId(2)).area();
    assert_eq!((0..4).map(|frame| area(&frame)).collect::<Vec<_>>(), things);
    perform(&mut session, Command::Undo).unwrap();
    assert_eq!(session.project().unwrap(), &before);
    let error = perform(
        &mut session,
        Command::MergeLabels {
            label: LabelId(1),
            into: LabelId(1),
        },
    )
    .unwrap_err();
    assert!(error.to_string().contains("itself"), "{error}");
}
