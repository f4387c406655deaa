use std::sync::Arc;

use rayon::prelude::*;

use super::fused::{FuseReport, Fused, finish, labelled};
use super::majority::{Histograms, LabelHistograms};
use super::pairs::{CHUNK, Pair, PairReader, PairWriter};
use super::views::{Views, check_size};
use super::votes::{FramePairs, Votes, joined};
use crate::{LabelledCloud, SceneError};
use ostra_core::job::Progress;
use ostra_masks::{LabelMask, LabelTree};

/// Memory limit for decoded masks held at once while all frames vote again.
const HELD_BYTES: usize = 256 << 20;

/// A frame whose mask has changed since the vote.
#[derive(Debug, Clone)]
pub struct ChangedMask {
    /// Frame number.
    pub frame: usize,
    /// The current mask; `None` removes the frame's votes.
    pub mask: Option<Arc<LabelMask>>,
}

/// Repeats the vote for the changed frames only, in the pixels known to see each point.
///
/// No depth, image or camera is read. Positions, normals and colours are kept. Points that an
/// earlier fusion left out do not come back.
///
/// # Errors
///
/// Returns [`SceneError::Request`] if the votes do not belong to the cloud or the pairs were not
/// kept. The same error is returned if a changed frame did not take part because it had no camera,
/// or if its size has changed. In these cases the cloud has to be fused again. Returns
/// [`SceneError::Stopped`] if the job is stopped.
pub fn relabel(
    cloud: &LabelledCloud,
    votes: &Votes,
    changed: &[ChangedMask],
    tree: &LabelTree,
    progress: &Progress,
) -> Result<(LabelledCloud, Votes), SceneError> {
    check(cloud, votes, changed)?;
    let votes = recounted(votes, changed, progress)?;
    Ok((labelled(cloud.clone(), &votes, tree), votes))
}

/// Repeats the vote with the current masks of all frames that see the points.
///
/// The result is the same as that of a new vote on the same points. Only masks are read, one after
/// the other.
///
/// # Errors
///
/// Returns the errors of [`relabel`].
pub fn vote_again(
    cloud: &LabelledCloud,
    votes: &Votes,
    views: &dyn Views,
    tree: &LabelTree,
    progress: &Progress,
) -> Result<Fused, SceneError> {
    progress.stage("vote")?;
    check(cloud, votes, &[])?;
    let (mut votes, mut changed, mut held) = (votes.clone(), Vec::new(), 0);
    let mut report = FuseReport::default();
    for at in 0..votes.frames.len() {
        progress.step(at, votes.frames.len())?;
        let frame = votes.frames[at].frame as usize;
        let change = ChangedMask {
            frame,
            mask: views.mask(frame),
        };
        if let Some(mask) = &change.mask {
            check_size(&views.frames()[frame], "mask", mask.width, mask.height)?;
        }
        report.frames_voted += usize::from(change.mask.is_some());
        if votes.frames[at].votes_otherwise(&change) {
            held += change
                .mask
                .as_ref()
                .map_or(0, |mask| size_of_val(&mask.ids[..]));
            changed.push(change);
        }
        if held > HELD_BYTES {
            votes = recounted(&votes, &std::mem::take(&mut changed), progress)?;
            held = 0;
        }
    }
    if !changed.is_empty() {
        votes = recounted(&votes, &changed, progress)?;
    }
    Ok(finish(
        labelled(cloud.clone(), &votes, tree),
        votes,
        false,
        report,
    ))
}

impl FramePairs {
    /// Returns whether any pixel that sees a point would now vote differently.
    fn votes_otherwise(&self, change: &ChangedMask) -> bool {
        let now = |pair: &Pair| change.mask.as_ref().map(|mask| mask.at(pair.x, pair.y));
        let differs =
            |chunk| PairReader::new(self.chunk(chunk)).any(|pair| now(&pair) != pair.vote);
        (0..self.starts.len().saturating_sub(1))
            .into_par_iter()
            .any(differs)
    }
}

/// Returns the votes with those of the changed frames counted again.
fn recounted(
    votes: &Votes,
    changed: &[ChangedMask],
    progress: &Progress,
) -> Result<Votes, SceneError> {
    let chunks = votes.len().div_ceil(CHUNK);
    let recounted: Vec<Recounted> = (0..chunks)
        .into_par_iter()
        .map(|chunk| {
            progress.check()?;
            Ok(recount(votes, changed, chunk))
        })
        .collect::<Result<_, SceneError>>()?;
    let (counted, pairs): (Vec<Histograms>, Vec<Vec<Vec<u8>>>) = recounted.into_iter().unzip();
    let mut votes = votes.clone();
    (votes.offsets, votes.entries) = joined(&counted);
    for (place, change) in changed.iter().enumerate() {
        if let Ok(frame) = position(&votes, change.frame) {
            let bytes = pairs.iter().map(|chunk| &chunk[place][..]);
            votes.frames[frame] = Arc::new(FramePairs::from_chunks(&votes.frames[frame], bytes));
        }
    }
    Ok(votes)
}

/// The votes of a chunk, and its pairs for each changed frame.
type Recounted = (Histograms, Vec<Vec<u8>>);

fn recount(votes: &Votes, changed: &[ChangedMask], chunk: usize) -> Recounted {
    let points = chunk * CHUNK..((chunk + 1) * CHUNK).min(votes.len());
    let pairs = |change: &ChangedMask| {
        position(votes, change.frame).map_or(&[][..], |at| votes.frames[at].chunk(chunk))
    };
    if changed.iter().all(|change| pairs(change).is_empty()) {
        return (votes.histograms(points), vec![Vec::new(); changed.len()]);
    }
    let mut ballots = LabelHistograms::from_histograms(points.map(|point| votes.histogram(point)));
    let mut revote = |change: &ChangedMask| {
        let mut writer = PairWriter::default();
        for pair in PairReader::new(pairs(change)) {
            writer.push(revoted(pair, change, &mut ballots));
        }
        writer.bytes
    };
    let bytes = changed.iter().map(&mut revote).collect();
    (ballots.finish(), bytes)
}

fn revoted(pair: Pair, change: &ChangedMask, ballots: &mut LabelHistograms) -> Pair {
    let vote = change.mask.as_ref().map(|mask| mask.at(pair.x, pair.y));
    if vote != pair.vote {
        if let Some(id) = pair.vote {
            ballots.remove(pair.point, id);
        }
        if let Some(id) = vote {
            ballots.add(pair.point, id);
        }
    }
    Pair { vote, ..pair }
}

fn position(votes: &Votes, frame: usize) -> Result<usize, usize> {
    votes
        .frames
        .binary_search_by_key(&frame, |pairs| pairs.frame as usize)
}

fn check(cloud: &LabelledCloud, votes: &Votes, changed: &[ChangedMask]) -> Result<(), SceneError> {
    let refuse = |why: String| Err(SceneError::Request(format!("{why}; fuse again")));
    if votes.len() != cloud.len() {
        return refuse(format!(
            "the votes are for {} points but the cloud has {}",
            votes.len(),
            cloud.len()
        ));
    }
    if !votes.has_pairs {
        return refuse(
            "the pixels that voted were not kept, as they would not fit into memory".into(),
        );
    }
    for (place, change) in changed.iter().enumerate() {
        let Ok(found) = position(votes, change.frame) else {
            return refuse(format!("frame {} took no part in the vote", change.frame));
        };
        if changed[..place]
            .iter()
            .any(|earlier| earlier.frame == change.frame)
        {
            return refuse(format!("frame {} is given twice", change.frame));
        }
        let pairs = &votes.frames[found];
        let size = change.mask.as_ref().map(|mask| (mask.width, mask.height));
        if size.is_some_and(|size| size != (pairs.width, pairs.height)) {
            return refuse(format!(
                "the mask of frame {} has another size than the frame had",
                change.frame
            ));
        }
    }
    Ok(())
}
