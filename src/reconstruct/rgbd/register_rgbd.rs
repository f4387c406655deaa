//! Cameras of an RGB-D recording: all steps, the frames between, and the outcome of each frame.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use super::graph::{Graph, ScanComponents};
use super::join::{join, overlapping};
use super::link::{FrameLink, LinkKind};
use super::odometry::{Chain, OnPose, Tried, compare, densify, loops, odometry};
use super::scan::{Scan, scan, scans};
use super::{RgbdError, RgbdOptions};
use crate::sfm::retrieval::{Vocabulary, most_alike};
use crate::sfm::{FeatureExtractor, FeatureMatcher, Features, RegistrationStatus};
use ostra_core::job::{PlannedStage, Progress};
use ostra_core::statistics::upper_median;
use ostra_frames::{Frame, FrameCamera, FrameStore};
use ostra_geometry::Pose;

/// Input of registration.
pub struct RgbdRequest<'a> {
    /// All frames of the project.
    pub frames: &'a [Frame],
    /// Numbers of the frames that are registered with each other, ascending.
    pub chosen: &'a [usize],
    /// Numbers of the frames that are then placed between these, ascending.
    pub between: &'a [usize],
    /// Pairs of frames that are compared besides those of similar appearance.
    pub pairs: &'a [[usize; 2]],
    /// Extracts features.
    pub extractor: &'a dyn FeatureExtractor,
    /// Matches features.
    pub matcher: &'a dyn FeatureMatcher,
    /// Called with poses as they become known.
    pub on_pose: &'a OnPose<'a>,
    /// Options.
    pub options: RgbdOptions,
}

/// Result of registration.
#[derive(Debug, Clone)]
pub struct RgbdResult {
    /// Cameras by frame number; the world is that of the first of them.
    pub cameras: BTreeMap<usize, FrameCamera>,
    /// Outcomes by frame number.
    pub outcomes: BTreeMap<usize, RegistrationStatus>,
    /// Links between frames, including those that the others contradict, by ascending numbers.
    pub links: Vec<FrameLink>,
    /// Whether the run was stopped, so that the result is incomplete.
    pub stopped: bool,
}

/// Up to this many frames on, overlap is found by the poses alone, without comparing appearance.
const NEAR: usize = 10;
/// Rounds in which more links are made where poses show overlap.
const ROUNDS: usize = 2;

/// Returns the stages of calibration and [`register_rgbd`] for so many chosen frames and frames between.
///
/// Weights are rough seconds on a desktop processor, as in [`crate::sfm::planned_stages`].
#[must_use]
pub fn planned_stages(chosen: usize, between: usize) -> Vec<PlannedStage> {
    let (chosen, between) = (chosen as f64, between as f64);
    let stage = PlannedStage::new;
    let mut stages = vec![
        stage(
            "compare images with depth maps",
            "Compare images with depth",
            4.0,
        ),
        stage("read frames", "Read frames", 0.3 * chosen),
        stage("odometry", "Follow the camera", 0.4 * chosen),
        stage("loops", "Find places seen again", 0.4 * chosen),
        stage("join fragments", "Join the parts", 0.3 * chosen),
    ];
    if between > 0.0 {
        stages.push(stage(
            "place the frames between",
            "Place the frames between",
            0.5 * between,
        ));
    }
    stages
}

/// Estimates the cameras of an RGB-D recording from its depth and images.
///
/// # Errors
/// [`RgbdError::NoStart`] with the reason if no two frames agree; other [`RgbdError`]s if features
/// fail, or the run is stopped before any two frames were linked.
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
    // When stopped, what links connect by then is kept.
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
            &pairs,
            LinkKind::Overlap,
            progress,
        ));
        graph.solve();
        graph.tell(&scans, request.on_pose);
    }
    add_statuses(&scans, &tried, &graph, &mut outcomes);
    if graph.poses.iter().flatten().count() < 2 {
        progress.check()?;
        return Err(RgbdError::NoStart(why_no_start(&outcomes)));
    }
    let mut poses: Vec<(usize, Option<Pose>)> = scans
        .iter()
        .zip(&graph.poses)
        .map(|(scan, pose)| (scan.frame, *pose))
        .collect();
    for (number, outcome, pose) in place_between(request, &scans, &graph.poses, store, progress)? {
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

/// Returns the cameras of frames by number, in the world of the first that has a pose.
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

/// Links neighbouring scans, and scans of similar appearance.
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
        seed,
        &Chain::new(scans, request.on_pose),
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

/// Outcome of a frame between, and its pose if it has one.
type Between = (usize, RegistrationStatus, Option<Pose>);

/// Places the frames between registered ones, by the ones before and after; `placed` holds the poses of the `scans`.
///
/// When stopped, it returns what it has by then.
///
/// # Errors
/// If features cannot be extracted or matched.
fn place_between(
    request: &RgbdRequest<'_>,
    scans: &[Scan],
    placed: &[Option<Pose>],
    store: &FrameStore,
    progress: &Progress,
) -> Result<Vec<Between>, RgbdError> {
    if request.between.is_empty() || progress.stage("place the frames between").is_err() {
        return Ok(request
            .between
            .iter()
            .map(|&number| (number, RegistrationStatus::NotReached, None))
            .collect());
    }
    let known: BTreeMap<usize, usize> = scans
        .iter()
        .enumerate()
        .filter(|(at, _)| placed[*at].is_some())
        .map(|(at, scan)| (scan.frame, at))
        .collect();
    let done = AtomicUsize::new(0);
    let place = |&number: &usize| {
        if progress
            .step(done.fetch_add(1, Ordering::Relaxed), request.between.len())
            .is_err()
        {
            return Ok((number, RegistrationStatus::NotReached, None));
        }
        let own = match scan(number, &request.frames[number], store, request.extractor)? {
            Ok(own) => own,
            Err(why) => return Ok((number, why, None)),
        };
        let adjacent = known
            .range(..number)
            .next_back()
            .into_iter()
            .chain(known.range(number..).next());
        let mut nearest = None;
        for (&frame, &at) in adjacent {
            let Some(pose) = placed[at] else { continue };
            let matches = request
                .matcher
                .matches(&scans[at].features, &own.features)?;
            match compare(
                [&scans[at], &own],
                &matches,
                request.options.seed ^ number as u64,
                true,
            ) {
                Ok((aligned, agreement)) => {
                    let outcome = RegistrationStatus::Registered {
                        neighbours: 1,
                        consistent: agreement.consistent,
                    };
                    return Ok((
                        number,
                        outcome,
                        Some(aligned.target_from_source.compose(&pose)),
                    ));
                }
                Err(best) => nearest = best.map(|best| (frame, best.consistent)).or(nearest),
            }
        }
        Ok((number, RegistrationStatus::Unlike { nearest }, None))
    };
    request.between.par_iter().map(place).collect()
}

/// Returns the outcome of each scan.
pub fn add_statuses(
    scans: &[Scan],
    tried: &[Tried],
    graph: &Graph,
    outcomes: &mut BTreeMap<usize, RegistrationStatus>,
) {
    let components = ScanComponents::new(scans.len(), graph.holding().map(|link| link.scans));
    let size = |scan: usize| {
        (0..scans.len())
            .filter(|&other| components.of(other) == components.of(scan))
            .count()
    };
    for (at, scan) in scans.iter().enumerate() {
        let outcome = if graph.poses[at].is_some() {
            registered(at, graph)
        } else {
            match size(at) {
                1 => unlike(at, scans, tried),
                frames => RegistrationStatus::Apart { frames },
            }
        };
        outcomes.insert(scan.frame, outcome);
    }
}

fn registered(at: usize, graph: &Graph) -> RegistrationStatus {
    let own = graph.holding().filter(|link| link.scans.contains(&at));
    let mut consistent: Vec<f64> = own.map(|link| link.agreement.consistent).collect();
    RegistrationStatus::Registered {
        neighbours: consistent.len(),
        consistent: upper_median(&mut consistent).unwrap_or(0.0),
    }
}

/// Returns the outcome of a frame that agrees with none, with the frame that agrees most.
fn unlike(at: usize, scans: &[Scan], tried: &[Tried]) -> RegistrationStatus {
    let other = |[a, b]: [usize; 2]| if a == at { b } else { a };
    let nearest = tried
        .iter()
        .filter(|(pair, _)| pair.contains(&at))
        .filter_map(|(pair, result)| {
            Some((
                scans[other(*pair)].frame,
                result.as_ref().err()?.as_ref()?.consistent,
            ))
        })
        .max_by(|a, b| a.1.total_cmp(&b.1));
    RegistrationStatus::Unlike { nearest }
}

/// Explains to the user why no two frames were joined.
#[must_use]
pub fn why_no_start(outcomes: &BTreeMap<usize, RegistrationStatus>) -> String {
    let count = |is: fn(&RegistrationStatus) -> bool| {
        outcomes.values().filter(|outcome| is(outcome)).count()
    };
    let (all, no_depth) = (
        outcomes.len(),
        count(|outcome| matches!(outcome, RegistrationStatus::NoDepth { .. })),
    );
    let no_camera = count(|outcome| matches!(outcome, RegistrationStatus::NoIntrinsics));
    if no_camera == all {
        return "the depth camera is not known; give --intrinsics FX,FY,CX,CY or --cameras, or --method sfm".into();
    }
    let unreadable: Vec<&String> = outcomes
        .values()
        .filter_map(|outcome| {
            if let RegistrationStatus::Unreadable { why } = outcome {
                Some(why)
            } else {
                None
            }
        })
        .collect();
    if let Some(why) = unreadable.first().filter(|_| unreadable.len() + 1 >= all) {
        return format!("{} of {all} frames cannot be read: {why}", unreadable.len());
    }
    format!(
        "no two of {all} frames agree in depth and image ({no_depth} with too little depth, {no_camera} without a known camera); \
         check the depth unit, the intrinsics and that each depth belongs to its image, or give --method sfm"
    )
}
