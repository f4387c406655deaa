use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use super::RgbdError;
use super::odometry::compare;
use super::run::RgbdRequest;
use super::scan::{Scan, scan};
use crate::sfm::Outcome;
use ostra_core::job::Progress;
use ostra_frames::FrameStore;
use ostra_geometry::Pose;

/// What became of a frame between, and its pose where it has one.
pub type Between = (usize, Outcome, Option<Pose>);

/// Places the frames between beside the registered ones before and after them; `placed` tells the poses of the `scans`.
///
/// Stopped, it gives what it has by then.
///
/// # Errors
/// Where features cannot be found or matched.
pub fn place_between(
    request: &RgbdRequest<'_>,
    (scans, placed): (&[Scan], &[Option<Pose>]),
    store: &FrameStore,
    progress: &Progress,
) -> Result<Vec<Between>, RgbdError> {
    if request.between.is_empty() || progress.stage("place the frames between").is_err() {
        return Ok(request
            .between
            .iter()
            .map(|&number| (number, Outcome::NotReached, None))
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
            return Ok((number, Outcome::NotReached, None));
        }
        let own = match scan(number, &request.frames[number], store, request.extractor)? {
            Ok(own) => own,
            Err(why) => return Ok((number, why, None)),
        };
        let beside = known
            .range(..number)
            .next_back()
            .into_iter()
            .chain(known.range(number..).next());
        let mut nearest = None;
        for (&frame, &at) in beside {
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
                    let outcome = Outcome::Registered {
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
        Ok((number, Outcome::Unlike { nearest }, None))
    };
    request.between.par_iter().map(place).collect()
}
