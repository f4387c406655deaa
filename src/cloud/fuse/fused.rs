//! The result of a fusion: the cloud, the votes and a report.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::majority::Majority;
use super::votes::Votes;
use crate::LabelledCloud;
use crate::labelled_cloud::name_unknown_labels;
use ostra_masks::{LabelId, LabelTree};

/// The result of a fusion.
#[derive(Debug, Clone, PartialEq)]
pub struct Fused {
    /// Labelled points.
    pub cloud: LabelledCloud,
    /// Votes on the points.
    pub votes: Votes,
    /// Summary of the fusion.
    pub report: FuseReport,
}

/// Counts the points for the report and drops unlabelled ones if requested.
pub(super) fn finish(
    cloud: LabelledCloud,
    votes: Votes,
    drop_unlabelled: bool,
    mut report: FuseReport,
) -> Fused {
    for (point, &label) in cloud.labels.iter().enumerate() {
        let seen = !votes.histogram(point).is_empty();
        let confidence = cloud.confidence[point] >= votes.min_confidence;
        report.unseen += usize::from(!seen);
        report.unsure += usize::from(seen && !confidence && label == LabelId::NONE);
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

/// Returns the cloud with the labels and confidences that the votes give under `tree`.
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

/// Numbers of points (or pixels) that fusion left out, by reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Dropped {
    /// Flying pixels: blends between two surfaces.
    pub flying_pixels: usize,
    /// Pixels too far away for the voxel size.
    pub far_pixels: usize,
    /// Points measured by too few frames.
    pub few_views: usize,
    /// Voxels that were another layer of a surface and were merged into a neighbour.
    #[serde(default)]
    pub layers: usize,
    /// Statistical outliers: points far from all others.
    pub outliers: usize,
    /// Background: points that no view labels. Counted only if unlabelled points are dropped.
    pub background: usize,
    /// Contour noise: points that some views label but the vote does not.
    ///
    /// Counted only if unlabelled points are dropped.
    pub contour: usize,
}

/// What a default voxel size was chosen from.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ChosenVoxel {
    /// Width of a pixel at the median depth, in world units.
    pub footprint: f64,
    /// Average number of frames that see the same place on a surface.
    pub views: f64,
}

/// Summary of a fusion, for display.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct FuseReport {
    /// Voxel edge length in world units; 0 if an existing cloud was labelled.
    pub voxel: f64,
    /// The basis of the voxel size if it was chosen automatically.
    #[serde(default)]
    pub chosen: Option<ChosenVoxel>,
    /// Maximum depth difference between a frame and a point that it sees.
    ///
    /// It is a share of the depth.
    pub depth_tolerance: f64,
    /// Number of frames that contributed points.
    pub frames_fused: usize,
    /// Number of frames that voted.
    pub frames_voted: usize,
    /// Number of pixels with a depth.
    pub pixels: usize,
    /// Number of points in the cloud.
    pub points: usize,
    /// Number of points per label; 0 is unlabelled.
    pub labels: BTreeMap<LabelId, usize>,
    /// Points and pixels that were left out.
    pub dropped: Dropped,
    /// Number of points that no frame with a mask sees.
    pub unseen: usize,
    /// Number of points left unlabelled because the winning share of the votes was too small.
    pub unsure: usize,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

/// Returns a line that names up to five of the given frames.
///
/// `one` is what is said of a single frame, and `many` of several. Returns `None` if there are none.
#[must_use]
pub fn naming([one, many]: [&str; 2], names: &[&str]) -> Option<String> {
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
        1 => Some(format!("1 frame {one}: {first}")),
        2..=SHOWN => Some(format!("{more} frames {many}: {first}")),
        _ => Some(format!(
            "{more} frames {many}: {first} and {} more",
            more - SHOWN
        )),
    }
}
