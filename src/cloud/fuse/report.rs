use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use ostra_masks::LabelId;

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
