//! Second search for cameras with the matches of a network, where those of nearest neighbours are
//! too few.

use anyhow::Result;

use crate::engines::SecondMatcher;
use ostra_core::statistics::upper_median;
use ostra_reconstruct::sfm::{
    CONTRADICTORY, FeatureMatcher, ModelStart, RegistrationStatus, SfmError, SfmResult,
};

/// Cameras from the better one of two searches.
#[derive(Debug)]
pub(super) struct BestMatched {
    pub result: SfmResult,
    /// Why matches of a network were tried, and what came of it; `None` if they were not.
    pub report: Option<String>,
    /// Advice for the user, if a network that is not installed may help.
    pub advice: Option<String>,
}

/// Why the cameras found with nearest neighbours may be improved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Weakness {
    /// No model could be started.
    NoStart,
    /// Some frames with features have no camera.
    LeftOut { frames: usize, of: usize },
    /// The matches contradict the cameras.
    Contradicted,
    /// Half of the frames see at most so many points.
    FewPoints(usize),
}

/// A map is weak if half of its frames see fewer points than this.
///
/// In three real sets of which every frame is placed (Fountain-P11, Sceaux, a banana) the medians are
/// 2086–5381, and the frame that sees fewest points sees 91.
const FEW_POINTS: usize = 60;

impl Weakness {
    /// Returns the main weakness of a finished search, if it has any.
    fn of(found: &Result<SfmResult, SfmError>) -> Option<Self> {
        let result = match found {
            Ok(result) if !result.stopped => result,
            Err(SfmError::NoStart(_)) => return Some(Self::NoStart),
            Ok(_) | Err(_) => return None,
        };
        let frames = result.outcomes.values().filter(|one| lacks_matches(one));
        let (frames, of) = (frames.count(), result.outcomes.len());
        let points = median_points(result);
        if frames > 0 {
            Some(Self::LeftOut { frames, of })
        } else if result.contradiction > CONTRADICTORY {
            Some(Self::Contradicted)
        } else if points < FEW_POINTS {
            Some(Self::FewPoints(points))
        } else {
            None
        }
    }

    fn text(self) -> String {
        match self {
            Self::NoStart => "nearest neighbours gave no pair of images to start from".to_owned(),
            Self::LeftOut { frames, of } => {
                format!("nearest neighbours left out {frames} of {of} frames")
            }
            Self::Contradicted => "matches by nearest neighbours contradict the cameras".to_owned(),
            Self::FewPoints(points) => {
                format!("half of the frames see at most {points} points by nearest neighbours")
            }
        }
    }
}

/// Returns whether other matches could give a frame a camera.
fn lacks_matches(outcome: &RegistrationStatus) -> bool {
    matches!(
        outcome,
        RegistrationStatus::NoPair { .. }
            | RegistrationStatus::FewPoints { .. }
            | RegistrationStatus::NoPose { .. }
            | RegistrationStatus::OtherModel { .. }
    )
}

/// Returns the median number of points that a placed frame sees.
fn median_points(result: &SfmResult) -> usize {
    let points = result.outcomes.values().filter_map(|one| match one {
        RegistrationStatus::Placed { points, .. } => Some(*points as f64),
        _ => None,
    });
    let mut points: Vec<f64> = points.collect();
    upper_median(&mut points).unwrap_or(0.0) as usize
}

/// Returns the cameras of a search, or those of a second one if these are better.
///
/// The second search is only made if the first one was weak. Its result is taken if more frames have
/// a camera, or if as many have one and it lacks the weakness.
///
/// # Errors
/// The error of the first search, if the second one gives no result either.
pub(super) fn with_better_matches(
    first: Result<SfmResult, SfmError>,
    second_matcher: impl FnOnce() -> Result<SecondMatcher>,
    search: impl FnOnce(&dyn FeatureMatcher) -> Result<SfmResult, SfmError>,
) -> Result<BestMatched> {
    let weakness = Weakness::of(&first);
    let plain = |first: Result<SfmResult, SfmError>, report, advice| {
        Ok(BestMatched {
            result: first.map_err(|error| anyhow::anyhow!(error))?,
            report,
            advice,
        })
    };
    let Some(weakness) = weakness else {
        return plain(first, None, None);
    };
    let matcher = match second_matcher()? {
        SecondMatcher::None => return plain(first, None, None),
        SecondMatcher::Missing(network) => {
            let advice = format!(
                "{}; the network {network} may place more: get it with 'ostra models install {network}' and reconstruct again",
                weakness.text()
            );
            return plain(first, None, Some(advice));
        }
        SecondMatcher::Ready(matcher) => matcher,
    };
    let (name, why) = (matcher.name(), weakness.text());
    let second = match search(matcher.as_ref()) {
        Ok(second) if second.stopped && first.is_ok() => return plain(first, None, None),
        Ok(second) => second,
        Err(SfmError::Stopped(_)) => return plain(first, None, None),
        Err(error) => {
            let report = format!("matched again by {name}, because {why}: {error}");
            return plain(first, Some(report), None);
        }
    };
    let before = first.as_ref().map_or(0, |first| first.cameras.len());
    let after = second.cameras.len();
    let is_taken = match &first {
        Ok(first) => is_better(&second, first, weakness),
        Err(_) => true,
    };
    if is_taken {
        let report = format!(
            "matched again by {name}, because {why}: {after} instead of {before} frames have a camera"
        );
        return plain(Ok(second), Some(report), None);
    }
    let outcome = if second.contradiction > CONTRADICTORY {
        format!("the matches contradict the cameras of {after} frames")
    } else {
        format!("no gain with {after} frames")
    };
    let report =
        format!("matched again by {name}, because {why}: {outcome}, so the first cameras stay");
    plain(first, Some(report), None)
}

fn is_better(second: &SfmResult, first: &SfmResult, weakness: Weakness) -> bool {
    let loses_given = first.start == ModelStart::Given && second.start != ModelStart::Given;
    let is_contradicted = |result: &SfmResult| result.contradiction > CONTRADICTORY;
    if loses_given || (is_contradicted(second) && !is_contradicted(first)) {
        return false;
    }
    let (after, before) = (second.cameras.len(), first.cameras.len());
    if after != before {
        return after > before;
    }
    match weakness {
        Weakness::NoStart | Weakness::LeftOut { .. } => false,
        Weakness::Contradicted => !is_contradicted(second),
        Weakness::FewPoints(points) => median_points(second) > points,
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use ostra_core::job::Stopped;
    use ostra_frames::cameras::SparsePoints;
    use ostra_reconstruct::sfm::matching::NearestMatcher;

    const PLACED: RegistrationStatus = RegistrationStatus::Placed {
        points: 500,
        error_px: 0.5,
    };
    const LEFT_OUT: RegistrationStatus = RegistrationStatus::NoPair { nearest: None };

    fn result(placed: usize, left_out: usize) -> SfmResult {
        let outcome = |frame| if frame < placed { PLACED } else { LEFT_OUT };
        let frames = 0..placed + left_out;
        let camera = ostra_project::testing::camera(0.0);
        SfmResult {
            cameras: (0..placed).map(|frame| (frame, camera)).collect(),
            sparse: SparsePoints::default(),
            outcomes: frames.map(|frame| (frame, outcome(frame))).collect(),
            start: ModelStart::Given,
            others: Vec::new(),
            scale: None,
            contradiction: 0.01,
            warnings: Vec::new(),
            methods: ["sift", "nearest"],
            stopped: false,
        }
    }

    fn ready() -> Result<SecondMatcher> {
        let matcher = NearestMatcher::for_bytes();
        Ok(SecondMatcher::Ready(Box::new(matcher)))
    }

    fn best(first: SfmResult, second: SfmResult) -> BestMatched {
        with_better_matches(Ok(first), ready, |_| Ok(second)).unwrap()
    }

    #[test]
    fn good_cameras_are_not_searched_again() {
        let load = || panic!("no network is loaded");
        let found = with_better_matches(Ok(result(5, 0)), load, |_| panic!("no search"));
        assert_eq!(found.unwrap().report, None);
        // No matcher helps images without features.
        let mut bare = result(5, 0);
        let few = RegistrationStatus::FewFeatures { found: 3 };
        bare.outcomes.insert(5, few);
        let found = with_better_matches(Ok(bare), load, |_| panic!("no search"));
        assert_eq!(found.unwrap().report, None);
    }

    #[test]
    fn more_frames_are_taken_and_the_reason_is_reported() {
        let found = best(result(3, 2), result(5, 0));
        assert_eq!(found.result.cameras.len(), 5);
        let report = found.report.unwrap();
        assert!(
            report.contains("left out 2 of 5 frames") && report.contains("5 instead of 3 frames"),
            "{report}"
        );
    }

    #[test]
    fn no_more_frames_leave_the_first_cameras() {
        for placed in [2, 3] {
            let mut second = result(placed, 5 - placed);
            second.methods[1] = "sift-lightglue";
            let found = best(result(3, 2), second);
            assert_eq!(found.result.methods[1], "nearest");
            assert!(found.report.unwrap().contains("the first cameras stay"));
        }
    }

    #[test]
    fn more_frames_that_are_contradicted_are_not_taken() {
        let mut second = result(5, 0);
        second.contradiction = 0.3;
        let found = best(result(3, 2), second);
        assert_eq!(found.result.cameras.len(), 3);
        let report = found.report.unwrap();
        assert!(
            report.contains("contradict the cameras of 5 frames"),
            "{report}"
        );
    }

    #[test]
    fn as_many_frames_are_taken_without_the_weakness() {
        let mut contradicted = result(5, 0);
        contradicted.contradiction = 0.3;
        assert!(
            best(contradicted.clone(), result(5, 0))
                .result
                .contradiction
                < 0.1
        );
        assert!(
            best(contradicted.clone(), contradicted)
                .result
                .contradiction
                > 0.1
        );
        let with_points = |points| SfmResult {
            outcomes: BTreeMap::from([(
                0,
                RegistrationStatus::Placed {
                    points,
                    error_px: 1.0,
                },
            )]),
            ..result(1, 0)
        };
        let median = |first, second| {
            let found = best(with_points(first), with_points(second));
            median_points(&found.result)
        };
        assert_eq!(median(20, 40), 40);
        assert_eq!(median(20, 10), 20);
    }

    #[test]
    fn failed_or_stopped_second_search_leaves_the_first_cameras() {
        let stopped = |_: &dyn FeatureMatcher| Err(SfmError::Stopped(Stopped));
        let found = with_better_matches(Ok(result(3, 2)), ready, stopped).unwrap();
        assert_eq!((found.result.cameras.len(), found.report), (3, None));
        let mut partial = result(4, 1);
        partial.stopped = true;
        let found = with_better_matches(Ok(result(3, 2)), ready, |_| Ok(partial)).unwrap();
        assert_eq!((found.result.cameras.len(), found.report), (3, None));
        let failed = |_: &dyn FeatureMatcher| Err(SfmError::NoStart("out of memory".into()));
        let found = with_better_matches(Ok(result(3, 2)), ready, failed).unwrap();
        assert_eq!(found.result.cameras.len(), 3);
        assert!(found.report.unwrap().contains("out of memory"));
    }

    #[test]
    fn without_a_start_the_second_search_is_taken_or_the_first_error_given() {
        let none = || Err(SfmError::NoStart("first".into()));
        let found = with_better_matches(none(), ready, |_| Ok(result(4, 0))).unwrap();
        assert_eq!(found.result.cameras.len(), 4);
        let error = with_better_matches(none(), ready, |_| Err(SfmError::NoStart("second".into())));
        assert_eq!(error.unwrap_err().to_string(), "first");
    }

    #[test]
    fn missing_network_is_advised() {
        let missing = || Ok(SecondMatcher::Missing("sift-lightglue"));
        let search = |_: &dyn FeatureMatcher| panic!("no search");
        let found = with_better_matches(Ok(result(3, 2)), missing, search).unwrap();
        assert_eq!(found.result.cameras.len(), 3);
        let advice = found.advice.unwrap();
        assert!(
            advice.contains("ostra models install sift-lightglue"),
            "{advice}"
        );
    }
}
