use std::collections::BTreeSet;

use glam::{Mat3, Vec3};
use rayon::prelude::*;

use super::scan::Scan;
use ostra_geometry::Pose;

/// Points of a view that are looked at.
const SAMPLES: usize = 200;
/// Share of the depth by which poses may still be off.
const TOLERANCE: f32 = 0.1;
/// Least share of the points that both see.
const LEAST: f64 = 0.3;
/// Distances in the recording, each double the one before, of which one partner is taken from each.
const SPANS: usize = 12;

/// Pairs of scans that poses show to see the same and that are not linked yet, ascending: for each scan the best partner at
/// each distance in the recording (2–3 frames on, 4–7, 8–15, …), so that long ways are tied as well as short ones.
#[must_use]
pub fn overlapping(
    scans: &[Scan],
    poses: &[Option<Pose>],
    linked: &BTreeSet<[usize; 2]>,
) -> Vec<[usize; 2]> {
    let samples: Vec<Vec<Vec3>> = scans.par_iter().map(samples).collect();
    let of_scan = |source: usize| {
        let mut best = [(LEAST, None); SPANS];
        for target in source + 2..scans.len() {
            let (Some(from), Some(to)) = (poses[source], poses[target]) else {
                continue;
            };
            if linked.contains(&[source, target]) {
                continue;
            }
            let shared = shared(
                &samples[source],
                &scans[target],
                &to.compose(&from.inverse()),
            );
            let span = ((target - source).ilog2() as usize - 1).min(SPANS - 1);
            if shared > best[span].0 {
                best[span] = (shared, Some(target));
            }
        }
        best.into_iter()
            .filter_map(move |(_, target)| Some([source, target?]))
    };
    (0..scans.len())
        .into_par_iter()
        .flat_map_iter(of_scan)
        .collect()
}

fn samples(scan: &Scan) -> Vec<Vec3> {
    let pixels = scan.view.grey.len();
    // A step that shares no factor with the width: no columns of pixels.
    let step = (pixels / SAMPLES).max(1) | 1;
    (0..pixels)
        .step_by(step)
        .filter_map(|pixel| scan.view.point(pixel))
        .collect()
}

/// Share of a scan's points that another sees at their depth.
fn shared(points: &[Vec3], target: &Scan, pose: &Pose) -> f64 {
    let (rotation, shift) = (
        Mat3::from_quat(pose.rotation.as_quat()),
        pose.translation.as_vec3(),
    );
    let camera = &target.view.camera;
    let (focal, principal) = (camera.focal_px.as_vec2(), camera.principal_px.as_vec2());
    let is_seen = |point: &&Vec3| {
        let point = rotation * **point + shift;
        if point.z <= 0.0 {
            return false;
        }
        let at = point.truncate() / point.z * focal + principal;
        if at.x < 0.0 || at.y < 0.0 || at.x >= camera.width as f32 || at.y >= camera.height as f32 {
            return false;
        }
        let depth = target
            .view
            .depth(at.y as usize * camera.width as usize + at.x as usize);
        depth > 0.0 && (depth - point.z).abs() < TOLERANCE * depth
    };
    points.iter().filter(is_seen).count() as f64 / points.len().max(1) as f64
}
