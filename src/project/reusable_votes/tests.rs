use super::*;
use crate::testing::{camera, frame, keyframe};
use ostra_cloud::fuse::{MaskVote, OntoOptions, SeenPoints, vote_seen};
use ostra_frames::FrameStore;

const POINTS: usize = 9;

/// Returns the votes of frames on points in front of [`camera`].
fn votes_of(frames: &[Frame]) -> Votes {
    let place = |k: usize| glam::Vec3::new((k % 3) as f32, (k / 3) as f32, 20.0) * 0.1;
    let cloud = LabelledCloud::from_positions((0..POINTS).map(place).collect());
    let views = ProjectViews {
        frames,
        store: &FrameStore::new(1 << 20),
        masks: &|_| Some(Arc::new(keyframe([1, 1, 1]).runs.decode())),
    };
    let options = OntoOptions {
        radius: Some(0.1),
        ..OntoOptions::default()
    };
    let (seen, tree) = (SeenPoints::new(), crate::testing::project().labels);
    let vote = MaskVote {
        views: &views,
        tree: &tree,
        options: &options,
    };
    vote_seen(cloud, &seen, &vote, &Progress::default())
        .unwrap()
        .votes
}

#[test]
fn points_that_no_frame_sees_cannot_be_relabelled() {
    let votes = votes_of(&[]);
    assert!(
        votes.has_voters() && votes.len() == POINTS,
        "nothing was left out for want of memory, and the votes fit the cloud"
    );
    assert!(!can_revote(POINTS, &votes));
}

#[test]
fn votes_fit_only_the_points_that_they_were_made_for() {
    let seeing = Frame {
        camera: Some(camera(0.0)),
        ..frame("a.png")
    };
    let votes = votes_of(&[seeing]);
    assert!(can_revote(POINTS, &votes));
    assert!(!can_revote(POINTS + 1, &votes), "votes on another cloud");
}
