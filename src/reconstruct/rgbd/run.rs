use std::collections::{BTreeMap, BTreeSet};

use super::account::{account, why_no_start};
use super::between::place_between;
use super::chain::{Chain, OnPose};
use super::graph::Graph;
use super::join::join;
use super::link::{FrameLink, LinkKind};
use super::odometry::{Tried, densify, loops, odometry};
use super::overlap::overlapping;
use super::scan::{Scan, scans};
use super::{RgbdError, RgbdOptions};
use crate::sfm::retrieval::{Vocabulary, most_alike};
use crate::sfm::{FeatureExtractor, FeatureMatcher, Features, Outcome};
use ostra_core::job::Progress;
use ostra_frames::{Frame, FrameCamera, FrameStore};
use ostra_geometry::Pose;

/// What registration is to do.
pub struct RgbdRequest<'a> {
    /// All frames of the project.
    pub frames: &'a [Frame],
    /// Numbers of those that are registered with each other, ascending.
    pub chosen: &'a [usize],
    /// Numbers of those that are then placed beside them, ascending.
    pub between: &'a [usize],
    /// Pairs of frames that are compared besides those that look alike.
    pub pairs: &'a [[usize; 2]],
    /// Finds features.
    pub extractor: &'a dyn FeatureExtractor,
    /// Matches them.
    pub matcher: &'a dyn FeatureMatcher,
    /// Looks on.
    pub on_pose: &'a OnPose<'a>,
    /// How.
    pub options: RgbdOptions,
}

/// What registration made of a recording.
#[derive(Debug, Clone)]
pub struct RgbdResult {
    /// By frame number, its camera; the world is that of the first of them.
    pub cameras: BTreeMap<usize, FrameCamera>,
    /// By frame number, what became of it.
    pub outcomes: BTreeMap<usize, Outcome>,
    /// Links between frames, those too that the others contradict, by rising numbers.
    pub links: Vec<FrameLink>,
    /// Whether it was stopped and is a part of what it could be.
    pub stopped: bool,
}

/// Frames on up to which overlap shows by the poses alone: no likeness is needed to find it.
const NEAR: usize = 10;
/// Rounds in which more links are made where poses show overlap.
const ROUNDS: usize = 2;

/// Cameras of an RGB-D recording from its depth and pictures.
///
/// # Errors
/// [`RgbdError::NoStart`] with the reason where no two frames agree; where features fail; when stopped before any two were
/// linked.
pub fn register_rgbd(
    request: &RgbdRequest<'_>,
    store: &FrameStore,
    progress: &Progress,
) -> Result<RgbdResult, RgbdError> {
    progress.stage("read frames")?;
    let read = scans(
        request.frames,
        request.chosen,
        store,
        request.extractor,
        progress,
    )?;
    let mut outcomes = BTreeMap::new();
    let mut scans = Vec::with_capacity(read.len());
    for (number, scan) in read {
        match scan {
            Ok(scan) => scans.push(scan),
            Err(why) => drop(outcomes.insert(number, why)),
        }
    }
    let tried = links(&scans, request, progress)?;
    let mut graph = Graph::new(&scans, &tried);
    graph.tell(&scans, request.on_pose);
    // Stopped, what links tie together by then is kept.
    join(&scans, &mut graph, &request.options, progress).or_else(|error| {
        if progress.check().is_err() {
            Ok(())
        } else {
            Err(error)
        }
    })?;
    for _ in 0..ROUNDS {
        let pairs = overlapping(&scans, &graph.poses, graph.tried());
        graph.add(densify(
            &scans,
            &graph.poses,
            (&pairs, LinkKind::Overlap),
            progress,
        ));
        graph.solve();
        graph.tell(&scans, request.on_pose);
    }
    account(&scans, &tried, &graph, &mut outcomes);
    if graph.poses.iter().flatten().count() < 2 {
        progress.check()?;
        return Err(RgbdError::NoStart(why_no_start(&outcomes)));
    }
    let mut poses: Vec<(usize, Option<Pose>)> = scans
        .iter()
        .zip(&graph.poses)
        .map(|(scan, pose)| (scan.frame, *pose))
        .collect();
    for (number, outcome, pose) in place_between(request, (&scans, &graph.poses), store, progress)?
    {
        outcomes.insert(number, outcome);
        poses.push((number, pose));
    }
    let cameras = cameras(request.frames, poses);
    for (number, camera) in request
        .between
        .iter()
        .filter_map(|number| Some((number, cameras.get(number)?)))
    {
        camera
            .camera_from_world
            .iter()
            .for_each(|pose| (request.on_pose)(*number, pose));
    }
    Ok(RgbdResult {
        cameras,
        outcomes,
        links: graph.frame_links(&scans),
        stopped: progress.check().is_err(),
    })
}

/// The cameras of frames by number, in the world of the first that has a pose.
fn cameras(
    frames: &[Frame],
    mut poses: Vec<(usize, Option<Pose>)>,
) -> BTreeMap<usize, FrameCamera> {
    poses.sort_by_key(|(number, _)| *number);
    let world_from_first = poses
        .iter()
        .find_map(|(_, pose)| *pose)
        .unwrap_or_default()
        .inverse();
    let camera = |(number, pose): (usize, Option<Pose>)| {
        let known = frames[number].camera?;
        Some((
            number,
            FrameCamera {
                camera_from_world: Some(pose?.compose(&world_from_first)),
                ..known
            },
        ))
    };
    poses.into_iter().filter_map(camera).collect()
}

/// Links between neighbours, and between scans that look alike.
fn links(
    scans: &[Scan],
    request: &RgbdRequest<'_>,
    progress: &Progress,
) -> Result<Vec<Tried>, RgbdError> {
    progress.stage("odometry")?;
    let features: Vec<&Features> = scans.iter().map(|scan| &scan.features).collect();
    let matches = request.matcher.of_set(&features)?;
    let seed = request.options.seed;
    let mut tried = odometry(
        scans,
        &matches,
        (seed, &Chain::new(scans, request.on_pose)),
        progress,
    )?;
    if progress.stage("loops").is_ok() {
        let near = (0..scans.len())
            .flat_map(|a| (a + 1..=a + NEAR).map(move |b| (a, b)))
            .collect();
        let pooled = Vocabulary::learn(&features, seed).pool_all(&features);
        let pairs = most_alike(&pooled, request.options.alike, &near);
        let place = |number: usize| scans.binary_search_by_key(&number, |scan| scan.frame).ok();
        let given = request
            .pairs
            .iter()
            .filter_map(|&[a, b]| Some((place(a)?, place(b)?)));
        let pairs = pairs.into_iter().chain(given).filter(|(a, b)| a != b);
        let known: BTreeSet<[usize; 2]> = tried.iter().map(|(pair, _)| *pair).collect();
        let ordered = pairs.into_iter().map(|(a, b)| [a.min(b), a.max(b)]);
        let pairs: BTreeSet<[usize; 2]> = ordered.filter(|pair| !known.contains(pair)).collect();
        let pairs: Vec<[usize; 2]> = pairs.into_iter().collect();
        tried.extend(loops(scans, &pairs, &matches, seed, progress)?);
    }
    Ok(tried)
}
