use serde::{Deserialize, Serialize};

use crate::FuseRequest;
use ostra_cloud::measure::LengthUnit;

/// The results that a project can hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ResultKind {
    /// Masks carried through the sequence.
    Tracking,
    /// Camera poses.
    Cameras,
    /// Depth maps.
    Depths,
    /// The labelled cloud and its votes.
    Cloud,
}

/// How a result was made (provenance), and whether it still fits what it was made from.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ResultRecord {
    /// What made it, e.g. `geometry`, `given`, `fuse`.
    pub engine: String,
    /// Number of frames that took part.
    pub frames: usize,
    /// Wall time it took.
    pub seconds: f64,
    /// Made from something that has changed since.
    #[serde(default)]
    pub stale: bool,
    /// Options it was made with, for people to read.
    #[serde(default)]
    pub settings: String,
    /// Names the files that hold the result under `versions/`, so that undo brings the earlier one back; 0 = the
    /// result has no files of its own.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub version: u64,
    /// Edge of the voxels that the surface was made with, world units; `None` = the result has no surface.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub voxel: Option<f64>,
    /// A cloud's: a digest of all that its points were made of. While it stays, changed masks only vote again.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub geometry: Option<String>,
    /// What its lengths were multiplied by since it was made, by setting the scale; `None` = by nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scaled: Option<f64>,
    /// Of cameras and clouds: what their positions are measured in; `None` in records of older versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub coordinates: Option<Coordinates>,
    /// A cloud's: what was asked for, with lengths in the unit that it has now.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub request: Option<FuseRequest>,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands a reference")]
fn is_zero(version: &u64) -> bool {
    *version == 0
}

/// What the positions of a result are measured in: results with equal coordinates fit each other.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Coordinates {
    /// Version of the result that the axes were chosen with; [`Self::OF_GIVEN_CAMERAS`] where they were given.
    pub world: u64,
    /// What lengths were multiplied by since the axes were chosen, by setting the scale.
    pub scale: f64,
    /// Unit of lengths.
    pub unit: LengthUnit,
}

impl Coordinates {
    /// The world that given cameras stand in.
    pub const OF_GIVEN_CAMERAS: u64 = 0;

    /// Coordinates that were chosen with a result, in metres or in an unknown unit.
    pub fn chosen_with(version: u64, is_metric: bool) -> Self {
        Self {
            world: version,
            scale: 1.0,
            unit: if is_metric {
                LengthUnit::Metre
            } else {
                LengthUnit::World
            },
        }
    }

    /// The same axes after lengths were multiplied to be metres.
    pub fn scaled_by(self, factor: f64) -> Self {
        Self {
            scale: self.scale * factor,
            unit: LengthUnit::Metre,
            ..self
        }
    }
}
