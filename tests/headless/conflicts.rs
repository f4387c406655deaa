//! Tests of masks in conflict with the vote, through the command line.

use std::ops::ControlFlow;
use std::path::Path;

use ostra_masks::{LabelId, read_palette_png};
use ostra_session::{Command, Session};
use serde_json::Value;

use super::recording::Recording;
use crate::program::{done, ostra, refused};

fn ranked(project: &str) -> Vec<(u64, f64)> {
    let reported: Value = serde_json::from_str(&done(&["doubt", project, "--json"])).unwrap();
    let row = |row: &Value| {
        (
            row["frame"].as_u64().unwrap(),
            row["share"].as_f64().unwrap(),
        )
    };
    reported["frames"]
        .as_array()
        .unwrap()
        .iter()
        .map(row)
        .collect()
}

fn pixels(project: &str, frame: u32, label: u16) -> Vec<bool> {
    let mask = read_palette_png(&Path::new(project).join(format!("masks/{frame}.png"))).unwrap();
    mask.ids.iter().map(|&id| id == LabelId(label)).collect()
}

/// Returns the pixels of a frame that the window stripes as in conflict.
fn vote_mismatch(project: &str, frame: usize) -> Vec<bool> {
    let mut session = Session::new();
    session.act(Command::Open(project.into())).unwrap();
    // The project is opened, then the cloud is loaded, then the masks are compared, each on
    // request.
    for _ in 0..3 {
        session.settle(|_| ControlFlow::Continue(()));
        let _ = (session.cloud(), session.vote_mismatch(frame));
    }
    session.settle(|_| ControlFlow::Continue(()));
    session
        .vote_mismatch(frame)
        .expect("the vote mismatch was not computed")
        .inside
        .clone()
}

#[test]
fn wrong_mask_has_the_most_conflict_and_the_vote_corrects_it() {
    let recording = Recording::new();
    let project = recording.project();
    assert!(refused(&["doubt", &project]).contains("fuse"));
    for label in ["thing", "other"] {
        done(&["label", &project, label]);
    }
    done(&[
        "prompt", &project, "--frame", "0", "--label", "thing", "--click", "20,24",
    ]);
    done(&["track", &project, "--tracker", "geometry"]);
    let right = pixels(&project, 2, 1);
    // On frame 2 the thing gets the other label.
    done(&["prompt", &project, "--frame", "2", "--label", "thing"]);
    done(&[
        "prompt", &project, "--frame", "2", "--label", "other", "--click", "18,24",
    ]);
    done(&["fuse", &project, "--voxel", "0.01"]);
    let before = ranked(&project);
    assert_eq!((before[0].0, before.len()), (2, 4));
    assert!(before[0].1 > 0.8 && before[1].1 < 0.02, "{before:?}");
    assert!(
        done(&["doubt", &project])
            .lines()
            .nth(1)
            .unwrap()
            .ends_with("2 2.png")
    );

    let wrong: Vec<bool> = right
        .iter()
        .zip(pixels(&project, 2, 2))
        .map(|(right, other)| *right || other)
        .collect();
    let vote_mismatch = vote_mismatch(&project, 2);
    let missed = wrong
        .iter()
        .zip(&vote_mismatch)
        .filter(|(a, b)| a != b)
        .count();
    assert!(
        missed < 16,
        "{missed} of {} pixels",
        wrong.iter().filter(|inside| **inside).count()
    );
    assert!(refused(&["doubt", &project, "--accept", "2", "--label", "nobody"]).contains("nobody"));
    done(&["doubt", &project, "--accept", "2"]);
    let repaired = pixels(&project, 2, 1);
    let differ = repaired.iter().zip(&right).filter(|(a, b)| a != b).count();
    assert!(
        differ < 16,
        "{differ} of {} pixels differ",
        right.iter().filter(|inside| **inside).count()
    );
    assert!(!pixels(&project, 2, 2).contains(&true));
    let info: Value = serde_json::from_str(&done(&["info", &project, "--json"])).unwrap();
    assert_eq!(info["frames"][2]["mask"], "anchor");
    assert!(ranked(&project)[0].1 < 0.02, "{:?}", ranked(&project));
}

#[test]
fn votes_are_accepted_despite_an_unreadable_depth() {
    let recording = Recording::new();
    let project = recording.project();
    done(&["label", &project, "thing"]);
    done(&[
        "prompt", &project, "--frame", "0", "--label", "thing", "--click", "20,24",
    ]);
    done(&["track", &project, "--tracker", "geometry"]);
    done(&["fuse", &project, "--voxel", "0.01"]);
    std::fs::write(recording.path("depth/1.png"), "").unwrap();
    let output = ostra(&["doubt", &project, "--accept", "1", "--accept", "2"]);
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{message}");
    assert!(
        message.contains("1 frame has a depth that cannot be read") && message.contains("1.png"),
        "{message}"
    );
    let info: Value = serde_json::from_str(&done(&["info", &project, "--json"])).unwrap();
    for frame in [1, 2] {
        assert_eq!(info["frames"][frame]["mask"], "anchor");
        assert!(
            pixels(&project, frame as u32, 1).contains(&true),
            "frame {frame}"
        );
    }
}
