//! Joins fragments without links by their shape, and finds frames that overlap.

use std::collections::BTreeSet;

use glam::Vec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::RgbdError;
use super::graph::{Fragment, Graph};
use super::link::LinkKind;
use super::odometry::densify;
use super::register::{
    DescribedCloud, GlobalOptions, GlobalRegistration, OrientedCloud, RefineOptions,
    refine_registration, register_globally,
};
use super::scan::Scan;
use ostra_core::job::Progress;
use ostra_geometry::{Isometry, Pinhole, Pose, is_same_depth};

/// Options of RGB-D registration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct RgbdOptions {
    /// Method that aligns fragments without links; `None` = one method after the other.
    pub registration: Option<GlobalRegistration>,
    /// Number of frames that each is compared with because their appearance is most similar.
    pub alike: usize,
    /// Seed of all samples.
    pub seed: u64,
}

impl Default for RgbdOptions {
    fn default() -> Self {
        Self {
            registration: None,
            alike: 6,
            seed: 0,
        }
    }
}

/// Edge of the voxels that fragments are compared on, as a share of the typical depth.
const VOXEL: f64 = 0.025;
/// Number of pairs of frames that must confirm the pose of a fragment.
const MIN_SUPPORT: usize = 2;
/// Minimum number of scans of a fragment that is placed by its shape.
const LEAST_SCANS: usize = 3;

/// Joins fragments that no link connects to the largest one.
///
/// Their clouds are aligned with it by their shape alone. The result is kept if frames of both then
/// agree in depth and image; otherwise the fragment stays separate.
///
/// # Errors
/// [`RgbdError::Stopped`].
pub fn join(
    scans: &[Scan],
    graph: &mut Graph,
    options: &RgbdOptions,
    progress: &Progress,
) -> Result<(), RgbdError> {
    let typical = graph.typical_depth;
    let mut fragments = graph.fragments();
    fragments.retain(|fragment| fragment.scans.len() >= LEAST_SCANS);
    if fragments.is_empty() {
        return Ok(());
    }
    progress.stage("join fragments")?;
    let describe =
        |cloud: &OrientedCloud| DescribedCloud::new(cloud, (VOXEL * typical) as f32, progress);
    let mut open = Vec::with_capacity(fragments.len());
    for fragment in fragments {
        let cloud = fragment.cloud(scans);
        open.push((describe(&cloud)?, cloud, fragment));
    }
    // Each joined fragment makes the whole larger, so that others may find their place; repeated
    // until none does.
    loop {
        let whole_cloud = graph.whole().cloud(scans);
        let described = describe(&whole_cloud)?;
        let before = open.len();
        let mut still = Vec::new();
        for (own, cloud, fragment) in open {
            progress.check()?;
            let clouds = [(&cloud, &own), (&whole_cloud, &described)];
            let mut joined = false;
            for whole_from_fragment in guesses(clouds, typical, options, progress)? {
                joined =
                    supported_by_overlap(scans, graph, &fragment, &whole_from_fragment, progress);
                if joined {
                    break;
                }
            }
            if !joined {
                still.push((own, cloud, fragment));
            }
        }
        if still.len() == before || still.is_empty() {
            return Ok(());
        }
        open = still;
    }
}

/// Returns the poses by shape, refined, of each method to try.
fn guesses(
    [source, target]: [(&OrientedCloud, &DescribedCloud); 2],
    typical: f64,
    options: &RgbdOptions,
    progress: &Progress,
) -> Result<Vec<Pose>, RgbdError> {
    let both = [GlobalRegistration::Fgr, GlobalRegistration::Ransac];
    let methods = options
        .registration
        .map_or(both.to_vec(), |method| vec![method]);
    let mut poses = Vec::new();
    for method in methods {
        let global = GlobalOptions {
            method,
            seed: options.seed,
            ..GlobalOptions::default()
        };
        let Some(found) = register_globally(source.1, target.1, &global, progress)? else {
            continue;
        };
        let refine = RefineOptions {
            voxel: (VOXEL * typical) as f32,
            ..RefineOptions::default()
        };
        let refined = refine_registration(
            source.0,
            target.0,
            &found.target_from_source,
            &refine,
            progress,
        )?;
        poses.push(refined.map_or(found.target_from_source, |refined| {
            refined.target_from_source
        }));
    }
    Ok(poses)
}

/// Places a fragment if enough pairs of its frames and those of the whole agree.
fn supported_by_overlap(
    scans: &[Scan],
    graph: &mut Graph,
    fragment: &Fragment,
    whole_from_fragment: &Pose,
    progress: &Progress,
) -> bool {
    let fragment_from_whole = whole_from_fragment.inverse();
    let mut poses = graph.poses.clone();
    for (&scan, pose) in fragment.scans.iter().zip(&fragment.poses) {
        poses[scan] = Some(pose.compose(&fragment_from_whole));
    }
    let own: BTreeSet<usize> = fragment.scans.iter().copied().collect();
    let mut pairs = overlapping(scans, &poses, &BTreeSet::new());
    pairs.retain(|pair| own.contains(&pair[0]) != own.contains(&pair[1]));
    let tried = densify(scans, &poses, &pairs, LinkKind::Shape, progress);
    if tried.iter().filter(|(_, result)| result.is_ok()).count() < MIN_SUPPORT {
        return false;
    }
    graph.place(fragment, &fragment_from_whole);
    graph.add(tried);
    graph.solve();
    fragment
        .scans
        .iter()
        .any(|&scan| graph.poses[scan].is_some())
}

/// Number of points sampled from a view.
const SAMPLES: usize = 200;
/// Maximum remaining error of poses, as a share of the depth.
const TOLERANCE: f32 = 0.1;
/// Minimum share of the points that both see.
const LEAST: f64 = 0.3;
/// Number of distance ranges in the recording, each twice the one before; one partner is taken from each.
const SPANS: usize = 12;

/// Returns pairs of scans that see the same according to their poses and are not linked yet, ascending.
///
/// Each scan gets the best partner at each distance in the recording (2–3 frames on, 4–7, 8–15, …),
/// so that distant frames are connected as well as near ones.
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
    // A step without a common factor with the width: no columns of pixels.
    let step = (pixels / SAMPLES).max(1) | 1;
    (0..pixels)
        .step_by(step)
        .filter_map(|pixel| scan.view.point(pixel))
        .collect()
}

/// Returns the share of a scan's points that another sees at their depth.
fn shared(points: &[Vec3], target: &Scan, pose: &Pose) -> f64 {
    let target_from_source = Isometry::from(pose);
    let camera = Pinhole::new(&target.view.camera);
    let is_seen = |point: &&Vec3| {
        let point = target_from_source.transform(**point);
        let Some(at) = camera.project_inside(point) else {
            return false;
        };
        let width = target.view.camera.width as usize;
        let depth = target.view.depth(at.y as usize * width + at.x as usize);
        depth > 0.0 && is_same_depth(point.z, depth, TOLERANCE)
    };
    points.iter().filter(is_seen).count() as f64 / points.len().max(1) as f64
}
