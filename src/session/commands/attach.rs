use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use anyhow::{Context, Result};

use super::correct::{Corrected, Correcting, Notice};
use crate::{AttachRequest, Session};
use ostra_cloud::LabelledCloud;
use ostra_cloud::correct::SeeingPixels;
use ostra_cloud::instances::{AttachedFragment, attached_fragments, split_mask};
use ostra_cloud::select::Selection;
use ostra_core::job::JobId;
use ostra_core::job::Progress;
use ostra_frames::FrameSet;
use ostra_masks::{LabelId, LabelMask, LabelTree, Region};
use ostra_project::Project;
use ostra_project::voted_cloud::VotedCloud;

impl Session {
    /// Assigns unlabelled pieces that are attached to one labelled object to its label.
    ///
    /// The pixels that see them in all masks and are unlabelled change, together with the points of
    /// the cloud, in one step. Frames without a mask do not get one. If there is no such piece,
    /// nothing happens.
    ///
    /// This is a separate command and not part of `fuse`, because it changes masks: the change is
    /// visible, and one undo reverts it. The demo runs it before the last fusion.
    pub(crate) fn attach(&mut self, request: AttachRequest) -> Result<JobId> {
        self.correct("Attach loose fragments", move |correcting, progress| {
            correcting.attached(request, progress)
        })
    }
}

impl Correcting {
    fn attached(&self, request: AttachRequest, progress: &Progress) -> Result<Corrected> {
        let VotedCloud { cloud, votes } = self.cloud_with_hidden(progress)?;
        let hidden = self.hidden();
        let mut pieces = attached_fragments(&cloud, request.radius, progress)?;
        pieces.retain(|piece| !hidden.contains(&piece.label));
        if pieces.is_empty() {
            let notice: Notice =
                Box::new(|_| "no unlabelled fragment touches exactly one labelled object".into());
            return Ok(Corrected {
                notice: Some(notice),
                ..Corrected::default()
            });
        }
        let selector = self.selector_for(Arc::clone(&cloud))?;
        let seeing = SeeingPixels::new(&selector, &votes, &all_points(&pieces))?;
        let choice = choice(&pieces, cloud.len());
        let to_free = |frame: usize, mask: &LabelMask, mut region: Region| {
            region
                .inside
                .iter_mut()
                .zip(&mask.ids)
                .for_each(|(inside, &id)| *inside &= id == LabelId::NONE);
            split_mask(&votes, &choice, frame, mask, region)
        };
        let frames: Vec<usize> = votes
            .frames()
            .filter(|frame| self.project.masks.contains_key(frame))
            .collect();
        let corrected = self.given_back(&seeing, &frames, false, to_free, progress)?;
        let tree = self.project.labels.clone();
        let notice: Notice = Box::new(move |voted| reported(&tree, &pieces, voted));
        Ok(Corrected {
            notice: Some(notice),
            ..corrected
        })
    }

    /// Returns the cloud as the current masks vote, including hidden labels.
    ///
    /// Otherwise points with a hidden label would count as unlabelled.
    fn cloud_with_hidden(&self, progress: &Progress) -> Result<VotedCloud> {
        if self.hidden().is_empty() {
            return self.cloud_of_now(progress);
        }
        let mut shown = Project::clone(&self.project);
        shown
            .marks
            .values_mut()
            .for_each(|marks| marks.hidden = FrameSet::default());
        let fused = self
            .voted(&shown, progress)?
            .context("the voters are not known; fuse again")?;
        Ok(VotedCloud {
            cloud: Arc::new(fused.cloud),
            votes: Arc::new(fused.votes),
        })
    }

    /// Returns the labels that are hidden on some frame.
    fn hidden(&self) -> BTreeSet<LabelId> {
        let marks = self.project.marks.iter();
        marks
            .filter(|(_, marks)| !marks.hidden.is_empty())
            .map(|(&label, _)| label)
            .collect()
    }
}

fn all_points(pieces: &[AttachedFragment]) -> Selection {
    let mut points: Vec<u32> = pieces
        .iter()
        .flat_map(|piece| piece.points.iter().copied())
        .collect();
    points.sort_unstable();
    Selection {
        points,
        pieces: pieces.len(),
    }
}

/// Returns for each point of the cloud the label that its piece gets.
fn choice(pieces: &[AttachedFragment], points: usize) -> Vec<Option<LabelId>> {
    let mut choice = vec![None; points];
    for piece in pieces {
        piece
            .points
            .iter()
            .for_each(|&point| choice[point as usize] = Some(piece.label));
    }
    choice
}

/// Describes the points that each label gained by the vote of the changed masks.
fn reported(
    tree: &LabelTree,
    pieces: &[AttachedFragment],
    voted: Option<&LabelledCloud>,
) -> String {
    let mut gains: BTreeMap<LabelId, Gain> = BTreeMap::new();
    for (piece, cloud) in pieces.iter().filter_map(|piece| Some((piece, voted?))) {
        let got = piece
            .points
            .iter()
            .filter(|&&point| cloud.labels[point as usize] == piece.label)
            .count();
        if got > 0 {
            let gain = gains.entry(piece.label).or_default();
            gain.pieces += 1;
            gain.points += got;
        }
    }
    let gains: Vec<String> = gains
        .iter()
        .map(|(&label, &gain)| gained(tree, label, gain))
        .collect();
    match gains.is_empty() {
        true => "the loose fragments are not visible in any mask that may change".into(),
        false => format!("attached: {}", gains.join(", ")),
    }
}

/// Pieces and points that a label gained.
#[derive(Clone, Copy, Default)]
struct Gain {
    pieces: usize,
    points: usize,
}

fn gained(tree: &LabelTree, label: LabelId, gain: Gain) -> String {
    let Gain { pieces, points } = gain;
    let name = tree.get(label).map_or("", |label| &label.name);
    format!(
        "{name} {pieces} {} of {points} points",
        if pieces == 1 { "piece" } else { "pieces" }
    )
}
