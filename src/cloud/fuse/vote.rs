//! The vote on every point by every frame that sees it.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;

use super::majority::{Histograms, LabelHistograms};
use super::pairs::{CHUNK, Pair, PairWriter};
use super::views::{Views, check_size};
use super::visibility::{posed_view, project_inside, seen_at, splat_depth};
use super::votes::{FramePairs, Votes, joined};
use crate::SceneError;
use ostra_core::job::Progress;
use ostra_frames::DepthMap;
use ostra_geometry::{DepthTolerance, PosedCamera};
use ostra_masks::LabelMask;

/// A pixel that is known to see a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SeenPoint {
    /// Index of the point.
    pub point: u32,
    /// Column in the frame's image.
    pub x: u32,
    /// Row in the frame's image.
    pub y: u32,
}

/// Points that each frame is known to see, by frame number; sorted by index without duplicates.
pub type SeenPoints = BTreeMap<usize, Vec<SeenPoint>>;

/// Depth change between adjacent pixels, in pixel footprints, that still counts as one surface.
const SLANT_PX: f64 = 1.5;

/// Options of the vote besides points and frames.
#[derive(Debug, Clone, Copy)]
pub(super) struct VoteOptions {
    /// Tolerance between the depths of frames and points.
    pub(super) tolerance: DepthTolerance,
    /// Radius of a point, in world units, for occlusion in frames without depth.
    pub(super) radius: f64,
    pub(super) min_confidence: f32,
    pub(super) pair_budget_bytes: usize,
}

/// One frame that is loaded and ready to vote.
struct Voting<'a> {
    index: usize,
    size: (u32, u32),
    mask: Option<Arc<LabelMask>>,
    visibility: Visibility<'a>,
}

/// How the points that a frame sees are determined.
enum Visibility<'a> {
    /// Points are projected and compared with the frame's depth.
    Depth {
        view: Box<PosedCamera>,
        depth: Arc<DepthMap>,
        tolerance: DepthTolerance,
    },
    /// The visible points are known; they are sorted by index.
    Known(&'a [SeenPoint]),
}

/// A chunk of points with its bounding sphere and its votes so far.
struct Chunk<'a> {
    points: &'a [Vec3],
    first: u32,
    centre: glam::DVec3,
    radius: f64,
    ballots: LabelHistograms,
}

/// The votes, and the number of frames with a mask that voted.
pub(super) struct Voted {
    pub(super) votes: Votes,
    pub(super) frames: usize,
}

/// Counts the votes of every frame on every point that it sees.
///
/// Frames with a camera and a mask vote. Frames with a camera but without a mask are recorded as
/// seeing, so that a later mask needs no geometry. A frame listed in `seen` votes on the points
/// listed there. Any other frame votes on the points that its depth shows to be visible; without
/// depth, the points drawn as discs take its place. Votes are sums of integers, so the order of
/// frames does not matter.
///
/// A point of a stereo cloud is listed in `seen` with the pixels that it was made from, so those
/// exact pixels vote on it. A comparison of depths would only find them again within a tolerance.
pub(super) fn vote(
    points: &[Vec3],
    seen: &SeenPoints,
    views: &dyn Views,
    options: &VoteOptions,
    progress: &Progress,
) -> Result<Voted, SceneError> {
    let mut chunks: Vec<Chunk<'_>> = points
        .par_chunks(CHUNK)
        .enumerate()
        .map(|(number, chunk)| Chunk::new(chunk, number))
        .collect();
    let load = |&index: &usize| Voting::load(points, seen, views, index, options);
    let voters: Vec<usize> = voters(views);
    let mut frames: Vec<Arc<FramePairs>> = Vec::new();
    let (mut has_pairs, mut bytes, mut voted) = (true, 0, 0);
    progress.stage("vote")?;
    let mut next = voters.first().map(load).transpose()?;
    for done in 0..voters.len() {
        progress.step(done, voters.len())?;
        let Some(voting) = next.take() else { break };
        voted += usize::from(voting.mask.is_some());
        let following = voters.get(done + 1);
        let (counted, loaded) = rayon::join(
            || count_votes(&mut chunks, &voting, has_pairs, progress),
            || following.map(load).transpose(),
        );
        (next, bytes) = (
            loaded?,
            bytes + counted.as_ref().map_or(0, |pairs| pairs.bytes.len()),
        );
        has_pairs &= bytes <= options.pair_budget_bytes;
        if has_pairs {
            frames.push(Arc::new(counted?));
        } else {
            counted?;
            frames.clear();
        }
    }
    let counted: Vec<Histograms> = chunks
        .par_iter()
        .map(|chunk| chunk.ballots.finish())
        .collect();
    let (offsets, entries) = joined(&counted);
    let votes = Votes {
        offsets,
        entries,
        frames,
        has_pairs,
        min_confidence: options.min_confidence,
    };
    Ok(Voted {
        votes,
        frames: voted,
    })
}

/// Returns the frames with a camera, or none if no such frame has a mask.
fn voters(views: &dyn Views) -> Vec<usize> {
    let posed = |index: &usize| views.frames()[*index].posed_camera().is_some();
    let voters: Vec<usize> = (0..views.frames().len()).filter(posed).collect();
    let any_mask = voters.iter().any(|&index| views.mask(index).is_some());
    if any_mask { voters } else { Vec::new() }
}

impl<'a> Voting<'a> {
    fn load(
        points: &[Vec3],
        seen: &'a SeenPoints,
        views: &dyn Views,
        index: usize,
        options: &VoteOptions,
    ) -> Result<Self, SceneError> {
        let frame = &views.frames()[index];
        let mask = views.mask(index);
        if let Some(mask) = &mask {
            check_size(frame, "mask", mask.width, mask.height)?;
        }
        let visibility = match seen.get(&index) {
            Some(known) => Visibility::Known(known),
            None => Visibility::by_depth(points, views, index, options)?,
        };
        Ok(Self {
            index,
            size: (frame.width, frame.height),
            mask,
            visibility,
        })
    }
}

impl Visibility<'_> {
    fn by_depth(
        points: &[Vec3],
        views: &dyn Views,
        index: usize,
        options: &VoteOptions,
    ) -> Result<Self, SceneError> {
        let frame = &views.frames()[index];
        let view = posed_view(frame)?.ok_or_else(|| {
            SceneError::Request(format!("frame '{}' has no camera; give it one", frame.name))
        })?;
        if let Some(depth) = views.depth(index)? {
            check_size(frame, "depth", depth.width, depth.height)?;
            return Ok(Self::Depth {
                view: Box::new(view),
                depth,
                tolerance: options.tolerance,
            });
        }
        let splat = splat_depth(points, &view, options.radius);
        // On a slanted surface, the depth changes between adjacent pixels by about a pixel
        // footprint.
        let slope = SLANT_PX / view.camera.focal_px.max_element();
        let tolerance = DepthTolerance {
            absolute: 2.0 * options.radius,
            relative: slope,
        };
        Ok(Self::Depth {
            view: Box::new(view),
            depth: Arc::new(splat),
            tolerance,
        })
    }
}

impl<'a> Chunk<'a> {
    fn new(points: &'a [Vec3], number: usize) -> Self {
        let (mut min, mut max) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for &point in points {
            (min, max) = (min.min(point), max.max(point));
        }
        let (min, max) = (min.as_dvec3(), max.as_dvec3());
        Self {
            points,
            first: (number * CHUNK) as u32,
            centre: (min + max) / 2.0,
            radius: (max - min).length() / 2.0,
            ballots: LabelHistograms::new(points.len()),
        }
    }

    /// Counts the votes of one frame on the chunk and returns the pairs that voted.
    fn count(&mut self, voting: &Voting<'_>) -> PairWriter {
        let mut pairs = PairWriter::default();
        let mut see = |ballots: &mut LabelHistograms, point: u32, (x, y): (u32, u32)| {
            let vote = voting.mask.as_ref().map(|mask| mask.at(x, y));
            if let Some(id) = vote {
                ballots.add(point, id);
            }
            pairs.push(Pair { point, x, y, vote });
        };
        match &voting.visibility {
            Visibility::Known(known) => {
                let begin = known.partition_point(|seen| seen.point < self.first);
                let last = self.first + self.points.len() as u32;
                for seen in known[begin..].iter().take_while(|seen| seen.point < last) {
                    see(&mut self.ballots, seen.point - self.first, (seen.x, seen.y));
                }
            }
            Visibility::Depth {
                view,
                depth,
                tolerance,
            } if view.may_see(self.centre, self.radius) => {
                for (point, &position) in (0..).zip(self.points) {
                    let Some(at) = project_inside(view, position) else {
                        continue;
                    };
                    let Some(pixel) = seen_at(depth, &at, *tolerance) else {
                        continue;
                    };
                    see(&mut self.ballots, point, pixel);
                }
            }
            Visibility::Depth { .. } => {}
        }
        pairs
    }
}

fn count_votes(
    chunks: &mut [Chunk<'_>],
    voting: &Voting<'_>,
    keep_pairs: bool,
    progress: &Progress,
) -> Result<FramePairs, SceneError> {
    let counted: Vec<PairWriter> = chunks
        .par_iter_mut()
        .map(|chunk| {
            progress.check()?;
            let pairs = chunk.count(voting);
            Ok(if keep_pairs {
                pairs
            } else {
                PairWriter::default()
            })
        })
        .collect::<Result<_, SceneError>>()?;
    let (frame, (width, height)) = (voting.index as u32, voting.size);
    let template = FramePairs {
        frame,
        width,
        height,
        ..FramePairs::default()
    };
    Ok(FramePairs::from_chunks(
        &template,
        counted.iter().map(|pairs| &pairs.bytes[..]),
    ))
}
