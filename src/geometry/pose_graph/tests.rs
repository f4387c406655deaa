use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::*;

/// Returns nodes on a circle, two rounds, that look inwards.
///
/// Edges connect each node with the next one and with the one a round later.
struct Ring {
    truth: Vec<Pose>,
    edges: Vec<PoseEdge>,
}

fn random(rng: &mut Pcg64Mcg, size: f64) -> Pose {
    exp(&std::array::from_fn(|_| rng.random_range(-size..size)))
}

/// Returns the information of points spread by about 1 around a position 2 in front of the camera.
fn information() -> [[f64; 6]; 6] {
    let mut sum = [[0.0; 6]; 6];
    for x in [
        DVec3::new(1.0, 0.5, 2.0),
        DVec3::new(-1.0, 0.3, 2.5),
        DVec3::new(0.1, -0.8, 1.6),
    ] {
        for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
            let turn = x.cross(axis);
            let row = [turn.x, turn.y, turn.z, axis.x, axis.y, axis.z];
            for (i, column) in sum.iter_mut().enumerate() {
                for (j, value) in column.iter_mut().enumerate() {
                    *value += row[i] * row[j] / 3.0;
                }
            }
        }
    }
    sum
}

fn ring(rng: &mut Pcg64Mcg, noise: f64) -> Ring {
    const ROUND: usize = 20;
    let pose = |k: usize| {
        let angle = k as f64 * std::f64::consts::TAU / ROUND as f64;
        let rotation = DQuat::from_rotation_y(angle);
        Pose {
            rotation,
            translation: DVec3::new(0.0, 0.1 * (k as f64 * 0.7).sin(), 3.0),
        }
    };
    let truth: Vec<Pose> = (0..2 * ROUND).map(pose).collect();
    let mut edge = |source: usize, target: usize, switchable: bool| PoseEdge {
        source,
        target,
        target_from_source: random(rng, noise)
            .compose(&truth[target].compose(&truth[source].inverse())),
        information: information(),
        weight: 1.0,
        switchable,
    };
    let mut edges: Vec<PoseEdge> = (1..2 * ROUND).map(|k| edge(k - 1, k, false)).collect();
    edges.extend((ROUND..2 * ROUND).map(|k| edge(k, k - ROUND, true)));
    Ring { truth, edges }
}

/// Returns the poses from chaining the edges between neighbours.
fn chained(ring: &Ring) -> Vec<Pose> {
    let mut poses = vec![ring.truth[0]];
    for edge in &ring.edges[..ring.truth.len() - 1] {
        poses.push(edge.target_from_source.compose(&poses[edge.source]));
    }
    poses
}

fn fixed(count: usize) -> Vec<bool> {
    (0..count).map(|node| node == 0).collect()
}

fn largest_error(poses: &[Pose], truth: &[Pose]) -> f64 {
    poses
        .iter()
        .zip(truth)
        .map(|(a, b)| a.centre().distance(b.centre()))
        .fold(0.0, f64::max)
}

#[test]
fn exact_measurements_recover_the_ground_truth() {
    let rng = &mut Pcg64Mcg::seed_from_u64(1);
    let ring = ring(rng, 1e-12);
    let start: Vec<Pose> = ring
        .truth
        .iter()
        .map(|pose| random(rng, 0.2).compose(pose))
        .collect();
    let start = [&ring.truth[..1], &start[1..]].concat();
    let options = PoseGraphOptions {
        switch_distance: 10.0,
        ..PoseGraphOptions::default()
    };
    let solved = solve_pose_graph(&start, &fixed(start.len()), &ring.edges, &options);
    assert!(
        largest_error(&solved.node_from_world, &ring.truth) < 1e-6,
        "{}",
        solved.iterations
    );
    assert!(solved.displacements.iter().all(|&off| off < 1e-6));
}

#[test]
fn loop_closures_remove_the_drift() {
    for seed in 0..20 {
        let ring = ring(&mut Pcg64Mcg::seed_from_u64(seed), 0.01);
        let start = chained(&ring);
        let solved = solve_pose_graph(
            &start,
            &fixed(start.len()),
            &ring.edges,
            &PoseGraphOptions::default(),
        );
        let (before, after) = (
            largest_error(&start, &ring.truth),
            largest_error(&solved.node_from_world, &ring.truth),
        );
        assert!(after < before, "seed {seed}: {before} -> {after}");
    }
}

#[test]
fn wrong_loop_closure_is_switched_off() {
    let rng = &mut Pcg64Mcg::seed_from_u64(7);
    let mut ring = ring(rng, 0.002);
    let wrong = ring.edges.len() - 3;
    let measured = &mut ring.edges[wrong].target_from_source;
    *measured = exp(&[0.0, 0.9, 0.0, 0.8, 0.0, 0.4]).compose(measured);
    let start = chained(&ring);
    let solved = solve_pose_graph(
        &start,
        &fixed(start.len()),
        &ring.edges,
        &PoseGraphOptions::default(),
    );
    let off = largest_error(&solved.node_from_world, &ring.truth);
    assert!(off < 0.05, "{off}");
    assert!(solved.shares[wrong] < 0.01, "{}", solved.shares[wrong]);
    let others = solved
        .shares
        .iter()
        .enumerate()
        .filter(|&(at, _)| at != wrong)
        .map(|(_, share)| *share);
    assert!(others.fold(1.0, f64::min) > 0.5);
}

#[test]
fn unconnected_nodes_keep_their_poses_and_invalid_edges_are_ignored() {
    let ring = ring(&mut Pcg64Mcg::seed_from_u64(3), 1e-9);
    let mut poses = ring.truth[..4].to_vec();
    poses[2].translation += DVec3::new(0.1, 0.0, 0.0);
    let mut edges = ring.edges[..2].to_vec();
    edges.push(PoseEdge {
        source: 9,
        ..edges[0]
    });
    edges.push(PoseEdge {
        source: 1,
        target: 1,
        ..edges[0]
    });
    let solved = solve_pose_graph(&poses, &fixed(4), &edges, &PoseGraphOptions::default());
    assert_eq!(
        (solved.node_from_world[0], solved.node_from_world[3]),
        (poses[0], poses[3])
    );
    assert!(
        solved.node_from_world[2]
            .centre()
            .distance(ring.truth[2].centre())
            < 1e-6
    );
}
