//! The result of a fusion: cloud, votes and the report of what was done.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::majority::Majority;
use super::votes::Votes;
use crate::LabelledCloud;
use crate::labelled_cloud::name_unknown_labels;
use ostra_masks::{LabelId, LabelTree};

/// What fusion makes.
#[derive(Debug, Clone, PartialEq)]
pub struct Fused {
    /// The labelled points.
    pub cloud: LabelledCloud,
    /// How they were voted on.
    pub votes: Votes,
    /// What was done.
    pub report: FuseReport,
}

/// Leaves out what is not wanted and counts the rest.
pub(super) fn finish(
    cloud: LabelledCloud,
    votes: Votes,
    drop_unlabelled: bool,
    mut report: FuseReport,
) -> Fused {
    for (point, &label) in cloud.labels.iter().enumerate() {
        let seen = !votes.histogram(point).is_empty();
        let sure = cloud.confidence[point] >= votes.min_confidence;
        report.unseen += usize::from(!seen);
        report.unsure += usize::from(seen && !sure && label == LabelId::NONE);
    }
    let (cloud, votes) = if drop_unlabelled {
        let kept: Vec<u32> = (0..cloud.len() as u32)
            .filter(|&p| cloud.labels[p as usize] != LabelId::NONE)
            .collect();
        let is_contour = |&point: &usize| {
            let voted = votes
                .histogram(point)
                .iter()
                .any(|&(label, _)| label != LabelId::NONE);
            voted && cloud.labels[point] == LabelId::NONE
        };
        report.dropped.contour = (0..cloud.len()).filter(is_contour).count();
        report.dropped.background = cloud.len() - kept.len() - report.dropped.contour;
        (cloud.select(&kept), votes.select(&kept))
    } else {
        (cloud, votes)
    };
    report.points = cloud.len();
    let mut labels = BTreeMap::new();
    cloud
        .labels
        .iter()
        .for_each(|&label| *labels.entry(label).or_default() += 1);
    report.labels = labels;
    if !votes.has_voters() {
        report.warnings.push(
            "the pixels that voted do not fit into memory and were not kept; a changed mask needs fusing again".into(),
        );
    }
    Fused {
        cloud,
        votes,
        report,
    }
}

/// The cloud with the labels and confidences that the votes give under `tree`.
pub(super) fn labelled(cloud: LabelledCloud, votes: &Votes, tree: &LabelTree) -> LabelledCloud {
    let verdicts = votes.decide(&Majority::new(tree));
    let mut tree = tree.clone();
    name_unknown_labels(&mut tree, votes.ids());
    LabelledCloud {
        labels: verdicts.iter().map(|verdict| verdict.label).collect(),
        confidence: verdicts.iter().map(|verdict| verdict.confidence).collect(),
        tree,
        ..cloud
    }
}

/// Points (or pixels) that fusion left out, by reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Dropped {
    /// Pixels that fly between two surfaces.
    pub flying_pixels: usize,
    /// Pixels too far away for the voxel size.
    pub far_pixels: usize,
    /// Points that too few frames measured.
    pub few_views: usize,
    /// Voxels that were another layer of a surface and became part of a neighbour.
    #[serde(default)]
    pub layers: usize,
    /// Points that lie apart from all others.
    pub outliers: usize,
    /// Points that no view gives a label, where these are not wanted: background.
    pub background: usize,
    /// Points that some views give a label and the vote does not, where these are not wanted: noise at contours.
    pub contour: usize,
}

/// What a default size of voxels was chosen from.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ChosenVoxel {
    /// What a pixel covers at the median depth, world units.
    pub footprint: f64,
    /// Frames that see the same place of a surface, on average.
    pub views: f64,
}

/// What fusion did, for people.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct FuseReport {
    /// Edge of a voxel in world units; 0 where a given cloud was labelled.
    pub voxel: f64,
    /// Why the voxels have that edge, where it was not given.
    #[serde(default)]
    pub chosen: Option<ChosenVoxel>,
    /// Share of the depth by which a frame's depth may differ from a point that it sees.
    pub depth_tolerance: f64,
    /// Frames that gave points.
    pub frames_fused: usize,
    /// Frames that voted.
    pub frames_voted: usize,
    /// Pixels with a depth.
    pub pixels: usize,
    /// Points of the cloud.
    pub points: usize,
    /// Points for each label, 0 = unlabelled.
    pub labels: BTreeMap<LabelId, usize>,
    /// What was left out.
    pub dropped: Dropped,
    /// Points that no frame with a mask sees.
    pub unseen: usize,
    /// Points that won a label with too small a share of the votes.
    pub unsure: usize,
    /// What the user should know.
    pub warnings: Vec<String>,
}

/// One line that names frames, the first few of many; `None` where there are none.
#[must_use]
pub fn naming(what: &str, names: &[&str]) -> Option<String> {
    const SHOWN: usize = 5;
    let (first, more) = (
        names
            .iter()
            .take(SHOWN)
            .copied()
            .collect::<Vec<_>>()
            .join(", "),
        names.len(),
    );
    match more {
        0 => None,
        1..=SHOWN => Some(format!("{more} frames {what}: {first}")),
        _ => Some(format!(
            "{more} frames {what}: {first} and {} more",
            more - SHOWN
        )),
    }
}
