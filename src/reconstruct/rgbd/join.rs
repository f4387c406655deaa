use std::collections::BTreeSet;

use super::fragment::Fragment;
use super::graph::Graph;
use super::link::LinkKind;
use super::odometry::densify;
use super::overlap::overlapping;
use super::register::{
    DescribedCloud, GlobalOptions, GlobalRegistration, OrientedCloud, RefineOptions,
    refine_registration, register_globally,
};
use super::scan::Scan;
use super::{RgbdError, RgbdOptions};
use ostra_core::job::Progress;
use ostra_geometry::Pose;

/// Edge of the voxels that fragments are compared on, as a share of the typical depth.
const VOXEL: f64 = 0.025;
/// Pairs of frames that must bear witness to where a fragment is placed.
const WITNESSES: usize = 2;
/// Scans that a fragment needs to be placed by its shape.
const LEAST_SCANS: usize = 3;

/// Joins fragments that no link ties to the largest one: their clouds are laid onto it by their shape alone, and stay there
/// where frames of both then agree in depth and picture. What finds no witnesses stays apart.
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
    // Each that is joined makes the whole larger, so that others may find their place: until none does.
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
                joined = witnessed(scans, graph, &fragment, &whole_from_fragment, progress);
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

/// Poses by shape, refined, of each method that is to be tried.
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

/// Places a fragment where enough pairs of its frames and those of the whole agree.
fn witnessed(
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
    let tried = densify(scans, &poses, (&pairs, LinkKind::Shape), progress);
    if tried.iter().filter(|(_, result)| result.is_ok()).count() < WITNESSES {
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
