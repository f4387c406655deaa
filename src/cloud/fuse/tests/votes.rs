//! Votes files, and the pixels that vote.

use super::*;

#[test]
fn votes_survive_a_round_trip_and_damage_is_detected() {
    let votes = Scene::new(3)
        .fused(&FuseOptions {
            voxel: Some(0.2),
            min_confidence: 0.25,
            ..FuseOptions::default()
        })
        .votes;
    let mut bytes = Vec::new();
    write_votes(&mut bytes, &votes).unwrap();
    assert!(read_votes(&bytes[..]).unwrap() == votes);
    for cut in 0..bytes.len() {
        assert!(read_votes(&bytes[..cut]).is_err(), "cut at {cut}");
    }
    for at in (0..bytes.len()).step_by(7) {
        let mut damaged = bytes.clone();
        damaged[at] ^= 0x10;
        assert!(read_votes(&damaged[..]).is_err(), "changed at {at}");
    }
    assert!(
        read_votes(&b"PLY"[..])
            .unwrap_err()
            .to_string()
            .contains("fuse again")
    );
}

#[test]
fn cloud_occludes_itself_in_frames_without_depth() {
    let mut scene = Scene::new(7);
    let cloud = scene
        .fused(&FuseOptions {
            voxel: Some(0.02),
            ..FuseOptions::default()
        })
        .cloud;
    scene.depths.iter_mut().for_each(|depth| *depth = None);
    let bare = LabelledCloud {
        labels: vec![LabelId::NONE; cloud.len()],
        ..cloud.clone()
    };
    let fused = vote_onto(
        &bare,
        &MaskVote {
            views: &scene,
            tree: &tree(),
            options: &OntoOptions::default(),
        },
        &Progress::default(),
    )
    .unwrap();
    let right = (0..cloud.len())
        .filter(|&p| fused.cloud.labels[p] == if is_ball(&cloud, p) { BALL } else { WALL })
        .count();
    assert!(
        right as f64 > 0.985 * cloud.len() as f64,
        "{right} of {}",
        cloud.len()
    );
    assert_eq!(fused.cloud.positions, cloud.positions);
}

#[test]
fn frame_with_known_pixels_votes_only_in_them() {
    let mut scene = Scene::new(3);
    let cloud = scene
        .fused(&FuseOptions {
            voxel: Some(0.02),
            ..FuseOptions::default()
        })
        .cloud;
    scene.masks.iter_mut().skip(1).for_each(|mask| *mask = None);
    let ball = |seen: &SeenPoint| scene.masks[0].as_ref().unwrap().at(seen.x, seen.y) == BALL;
    // Every 50th point, each in a pixel of its own, over more than one chunk of points.
    let pixel = |point: usize| SeenPoint {
        point: point as u32,
        x: point as u32 % WIDTH,
        y: point as u32 / 50 % HEIGHT,
    };
    let known: Vec<SeenPoint> = (0..cloud.len()).step_by(50).map(pixel).collect();
    assert!(cloud.len() > super::pairs::CHUNK && known.iter().any(ball) && !known.iter().all(ball));
    let seen = SeenPoints::from([(0, known.clone())]);
    let fused = vote_seen(
        cloud.clone(),
        &seen,
        &MaskVote {
            views: &scene,
            tree: &tree(),
            options: &OntoOptions::default(),
        },
        &Progress::default(),
    )
    .unwrap();
    for (point, label) in fused.cloud.labels.iter().enumerate() {
        let expected = match known.iter().find(|seen| seen.point as usize == point) {
            Some(seen) if ball(seen) => BALL,
            Some(_) => WALL,
            None => LabelId::NONE,
        };
        assert_eq!(*label, expected, "point {point}");
    }
    let voter = fused.votes.voters(50)[0];
    assert_eq!((voter.frame, voter.x, voter.y), (0, known[1].x, known[1].y));
    assert_eq!(
        (fused.report.frames_fused, fused.report.frames_voted),
        (1, 1)
    );
}
