//! Odometry along the recording, loops, and the poses known so far.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

use super::align::Aligned;
use super::link::{Link, LinkKind, PoseGuess, ViewAgreement, align_and_check, pose_from_features};
use super::pyramid::Pyramid;
use super::scan::Scan;
use crate::sfm::{FeatureError, PairMatches};
use ostra_core::job::Progress;
use ostra_geometry::Pose;

/// Callback for poses as they become known, by frame number, in the world of the first frame.
///
/// It is called while odometry runs, and again with better poses afterwards. The calls come from
/// worker threads.
pub type OnPose<'a> = dyn Fn(usize, &Pose) + Sync + 'a;

/// Poses from one scan to the next while odometry works on many at once: for display, not for the result.
pub struct Chain<'a> {
    scans: &'a [Scan],
    on_pose: &'a OnPose<'a>,
    known: Mutex<Known>,
}

#[derive(Default)]
struct Known {
    /// Poses of the first scans, in order; `None` after a break.
    poses: Vec<Option<Pose>>,
    /// Links of later scans that are known already.
    beyond: BTreeMap<usize, Option<Link>>,
}

impl<'a> Chain<'a> {
    /// Creates a chain that begins at the first scan.
    #[must_use]
    pub fn new(scans: &'a [Scan], on_pose: &'a OnPose<'a>) -> Self {
        Self {
            scans,
            on_pose,
            known: Mutex::default(),
        }
    }

    /// Adds the link of a scan to an earlier one, and reports the poses that become known.
    pub fn take(&self, scan: usize, link: Option<&Link>) {
        for (scan, pose) in self
            .known
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .extend(scan, link)
        {
            (self.on_pose)(self.scans[scan].frame, &pose);
        }
    }
}

impl Known {
    /// Returns the poses that become known by a link.
    fn extend(&mut self, scan: usize, link: Option<&Link>) -> Vec<(usize, Pose)> {
        self.beyond.insert(scan, link.copied());
        let mut news = Vec::new();
        if self.poses.is_empty() {
            self.poses.push(Some(Pose::IDENTITY));
            news.push((0, Pose::IDENTITY));
        }
        while let Some(link) = self.beyond.remove(&self.poses.len()) {
            let pose = link.and_then(|link| {
                let source = self.poses[link.scans[0]]?;
                Some(link.aligned.target_from_source.compose(&source))
            });
            news.extend(pose.map(|pose| (self.poses.len(), pose)));
            self.poses.push(pose);
        }
        news
    }
}

/// Number of earlier frames that one is compared with if the nearer ones do not fit, so that a
/// damaged frame does not break the recording.
const BACK: usize = 4;

/// Result of comparing two scans: a link, or the best agreement found.
pub type Tried = ([usize; 2], Result<Link, Option<ViewAgreement>>);

/// Links each scan with the one before; if that fails, with an earlier one. Results are reported to `chain`.
///
/// When stopped, it returns what it has by then.
///
/// # Errors
/// If the matcher fails.
pub fn odometry(
    scans: &[Scan],
    matches: &PairMatches<'_>,
    seed: u64,
    chain: &Chain<'_>,
    progress: &Progress,
) -> Result<Vec<Tried>, FeatureError> {
    let done = AtomicUsize::new(0);
    let of_scan = |target: usize| {
        let mut tried: Vec<Tried> = Vec::new();
        for back in 1..=BACK.min(target) {
            if progress
                .step(done.load(Ordering::Relaxed), scans.len())
                .is_err()
            {
                break;
            }
            let pair = [target - back, target];
            let found = matches(pair[0], pair[1])?;
            let result = compare(pair.map(|at| &scans[at]), &found, seed_of(pair, seed), true);
            let is_linked = result.is_ok();
            tried.push(linked(pair, LinkKind::Odometry, result));
            if is_linked {
                break;
            }
        }
        done.fetch_add(1, Ordering::Relaxed);
        chain.take(
            target,
            tried.last().and_then(|(_, result)| result.as_ref().ok()),
        );
        Ok(tried)
    };
    let tried: Vec<Vec<Tried>> = (1..scans.len())
        .into_par_iter()
        .map(of_scan)
        .collect::<Result<_, FeatureError>>()?;
    Ok(tried.into_iter().flatten().collect())
}

/// Links scans that are distant in time if their features agree on a pose.
///
/// When stopped, it returns what it has by then.
///
/// # Errors
/// If the matcher fails.
pub fn loops(
    scans: &[Scan],
    pairs: &[[usize; 2]],
    matches: &PairMatches<'_>,
    seed: u64,
    progress: &Progress,
) -> Result<Vec<Tried>, FeatureError> {
    let done = AtomicUsize::new(0);
    let of_pair = |&pair: &[usize; 2]| {
        progress
            .step(done.fetch_add(1, Ordering::Relaxed), pairs.len())
            .ok()?;
        let compared = |found: Vec<(u32, u32)>| {
            compare(
                pair.map(|at| &scans[at]),
                &found,
                seed_of(pair, seed),
                false,
            )
        };
        Some(matches(pair[0], pair[1]).map(|found| linked(pair, LinkKind::Loop, compared(found))))
    };
    pairs.par_iter().filter_map(of_pair).collect()
}

/// Aligns two scans from the pose of their features.
///
/// If that fails and `close` is set, the identity is tried as well.
pub fn compare(
    scans: [&Scan; 2],
    matches: &[(u32, u32)],
    seed: u64,
    close: bool,
) -> Result<(Aligned, ViewAgreement), Option<ViewAgreement>> {
    let by_features =
        pose_from_features(scans[0], scans[1], matches, seed).map(|pose| (pose, PoseGuess::Near));
    let guesses: Vec<(Pose, PoseGuess)> = by_features
        .into_iter()
        .chain(close.then_some((Pose::IDENTITY, PoseGuess::Far)))
        .collect();
    if guesses.is_empty() {
        return Err(None);
    }
    let [source, target] = scans.map(|scan| Pyramid::new(&scan.view));
    align_and_check([&source, &target], &guesses)
}

fn linked(
    pair: [usize; 2],
    kind: LinkKind,
    result: Result<(Aligned, ViewAgreement), Option<ViewAgreement>>,
) -> Tried {
    (
        pair,
        result.map(|(aligned, agreement)| Link {
            scans: pair,
            kind,
            aligned,
            agreement,
        }),
    )
}

/// Returns a separate seed for each pair.
fn seed_of([a, b]: [usize; 2], seed: u64) -> u64 {
    seed ^ ((a as u64) << 32 | b as u64)
}

/// Links scans that see the same according to the poses known so far.
///
/// When stopped, it returns what it has by then.
#[must_use]
pub fn densify(
    scans: &[Scan],
    poses: &[Option<Pose>],
    pairs: &[[usize; 2]],
    kind: LinkKind,
    progress: &Progress,
) -> Vec<Tried> {
    let done = AtomicUsize::new(0);
    let of_pair = |&pair: &[usize; 2]| {
        progress
            .step(done.fetch_add(1, Ordering::Relaxed), pairs.len())
            .ok()?;
        let guess = poses[pair[1]]?.compose(&poses[pair[0]]?.inverse());
        let [source, target] = pair.map(|at| Pyramid::new(&scans[at].view));
        Some(linked(
            pair,
            kind,
            align_and_check([&source, &target], &[(guess, PoseGuess::Near)]),
        ))
    };
    pairs.par_iter().filter_map(of_pair).collect()
}
