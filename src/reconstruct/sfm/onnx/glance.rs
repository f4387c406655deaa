use crate::sfm::{FeatureError, Features};

/// Matches at a first look below which two pictures do not overlap.
const OVERLAPPING: usize = 10;

/// Matches of the first `most` keypoints of both pictures; where there are many more than `first_look`, only if so many
/// match already: a network's time grows with the square of their number, and most pairs of a set do not overlap.
pub fn look_twice(
    both: [&Features; 2],
    (first_look, most): (usize, usize),
    matched: impl Fn(usize) -> Result<Vec<(u32, u32)>, FeatureError>,
) -> Result<Vec<(u32, u32)>, FeatureError> {
    let fewer = both
        .iter()
        .map(|features| features.keypoints.len().min(most))
        .min()
        .unwrap_or(0);
    if fewer > first_look {
        let glanced = matched(first_look)?;
        if glanced.len() < OVERLAPPING {
            return Ok(glanced);
        }
    }
    matched(most)
}
