use serde::{Deserialize, Serialize};

use crate::{EngineName, FuseRequest, TrackerId};
use ostra_cloud::measure::LengthUnit;
use ostra_core::job::Progress;

/// Kind of a result that a project can hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ResultKind {
    /// Masks propagated through the sequence.
    Tracking,
    /// Camera poses.
    Cameras,
    /// Depth maps.
    Depths,
    /// The labelled cloud and its votes.
    Cloud,
}

/// Engine that made a result; stored by name.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "String", from = "String")]
pub enum ResultEngine {
    /// A sensor or files given by the user.
    #[default]
    Given,
    /// Structure from motion.
    Sfm,
    /// Registration of RGB-D fragments.
    Rgbd,
    /// Multi-view stereo.
    Stereo,
    /// Fusion of depth maps.
    Fuse,
    /// Vote on the points of a given cloud.
    Onto,
    /// A tracker.
    Tracker(TrackerId),
    /// An engine that this version does not know; its name is kept.
    Other(String),
}

impl ResultEngine {
    /// The engines other than trackers, with their names in files.
    const NAMED: [(Self, &'static str); 6] = [
        (Self::Given, "given"),
        (Self::Sfm, "sfm"),
        (Self::Rgbd, "rgbd"),
        (Self::Stereo, "stereo"),
        (Self::Fuse, "fuse"),
        (Self::Onto, "onto"),
    ];

    /// Returns the name in files and tables.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Tracker(tracker) => tracker.name(),
            Self::Other(name) => name,
            engine => Self::NAMED
                .iter()
                .find(|(known, _)| known == engine)
                .map_or("", |&(_, name)| name),
        }
    }
}

impl From<&str> for ResultEngine {
    fn from(name: &str) -> Self {
        let named = Self::NAMED.into_iter().find(|&(_, known)| known == name);
        named.map_or_else(
            || {
                TrackerId::from_name(name)
                    .map_or_else(|| Self::Other(name.to_owned()), Self::Tracker)
            },
            |(engine, _)| engine,
        )
    }
}

impl From<String> for ResultEngine {
    fn from(name: String) -> Self {
        Self::from(name.as_str())
    }
}

impl From<ResultEngine> for String {
    fn from(engine: ResultEngine) -> Self {
        engine.name().to_owned()
    }
}

/// Provenance of a result, and whether its inputs have changed since.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ResultRecord {
    /// Engine that made it.
    pub engine: ResultEngine,
    /// Number of frames that were used.
    pub frames: usize,
    /// Wall time in seconds.
    pub seconds: f64,
    /// Wall time of each step; empty in records of older versions and of results without steps.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub steps: Vec<StepSeconds>,
    /// Whether an input has changed since.
    #[serde(default)]
    pub stale: bool,
    /// Options that it was made with, as text for people.
    #[serde(default)]
    pub settings: String,
    /// Number of the result's files under `versions/`; 0 if the result has no files of its own.
    ///
    /// Undo restores the earlier version.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub version: u64,
    /// Voxel size of the surface in world units; `None` if the result has no surface.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub voxel: Option<f64>,
    /// Digest of all inputs of a cloud's points.
    ///
    /// While the digest is unchanged, changed masks only require a new vote.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub geometry: Option<String>,
    /// Factor by which setting the scale has multiplied its lengths; `None` if it was never scaled.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scaled: Option<f64>,
    /// Coordinates of cameras and clouds; `None` in records of older versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub coordinates: Option<Coordinates>,
    /// The models that the images of cameras fall into; empty if there is only one.
    ///
    /// The record describes the one whose version it has.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub models: Vec<SparseModelRecord>,
    /// Settings of a cloud, with lengths in its current unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub request: Option<FuseRequest>,
}

/// One of several models that the images fall into. Nothing connects them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SparseModelRecord {
    /// Number of its files under `versions/`.
    pub version: u64,
    /// Number of frames that have a camera in it.
    pub frames: usize,
    /// Number of its points.
    pub points: usize,
    /// Options that it was made with, as text for people.
    #[serde(default)]
    pub settings: String,
    /// Its coordinates; those of the other models have nothing to do with them.
    pub coordinates: Coordinates,
    /// As in [`ResultRecord::scaled`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scaled: Option<f64>,
}

impl ResultRecord {
    /// Returns the index of the model that the record describes; `None` if there is only one.
    #[must_use]
    pub fn model_in_use(&self) -> Option<usize> {
        self.models
            .iter()
            .position(|model| model.version == self.version)
    }

    /// Returns the record of another one of its models.
    #[must_use]
    pub fn with_model(&self, model: &SparseModelRecord) -> Self {
        Self {
            version: model.version,
            frames: model.frames,
            settings: model.settings.clone(),
            coordinates: Some(model.coordinates),
            scaled: model.scaled,
            ..self.clone()
        }
    }

    /// Returns the record of cameras whose model got another version and other coordinates.
    #[must_use]
    pub fn with_coordinates(&self, version_before: u64, coordinates: Coordinates) -> Self {
        let mut record = Self {
            coordinates: Some(coordinates),
            ..self.clone()
        };
        for model in &mut record.models {
            if model.version == version_before {
                model.version = self.version;
                model.settings.clone_from(&self.settings);
                (model.coordinates, model.scaled) = (coordinates, self.scaled);
            }
        }
        record
    }
}

/// Wall time of a step of a job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StepSeconds {
    /// Step as people see it, such as `Match images`.
    pub step: String,
    /// Wall time in seconds.
    pub seconds: f64,
}

impl StepSeconds {
    /// Returns the steps of a job so far, without its first `left_out` stages.
    pub fn of(progress: &Progress, left_out: usize) -> Vec<Self> {
        let times = progress.step_times(left_out).into_iter();
        times
            .map(|time| Self {
                step: time.title,
                seconds: time.took.as_secs_f64(),
            })
            .collect()
    }
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands a reference")]
fn is_zero(version: &u64) -> bool {
    *version == 0
}

/// Coordinate system of a result; results with equal coordinates fit each other.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Coordinates {
    /// Version of the result that chose the axes, or [`Self::OF_GIVEN_CAMERAS`] if they were given.
    pub world: u64,
    /// Factor by which setting the scale has multiplied lengths since the axes were chosen.
    pub scale: f64,
    /// Unit of lengths.
    pub unit: LengthUnit,
}

impl Coordinates {
    /// World of given cameras.
    pub const OF_GIVEN_CAMERAS: u64 = 0;

    /// Creates the coordinates chosen with a result, in metres or in an unknown unit.
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

    /// Returns the same axes after lengths were multiplied by `factor` to be in metres.
    pub fn scaled_by(self, factor: f64) -> Self {
        Self {
            scale: self.scale * factor,
            unit: LengthUnit::Metre,
            ..self
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn engines_of_results_keep_their_names_in_files() {
        let names = [
            "given",
            "sfm",
            "rgbd",
            "stereo",
            "fuse",
            "onto",
            "xmem",
            "deaot",
            "geometry",
            "flow",
            "of a later version",
        ];
        for name in names {
            let json = format!("\"{name}\"");
            let engine: ResultEngine = serde_json::from_str(&json).unwrap();
            assert_eq!(engine.name(), name);
            assert_eq!(serde_json::to_string(&engine).unwrap(), json);
            let is_known = !matches!(engine, ResultEngine::Other(_));
            assert_eq!(is_known, name != "of a later version");
        }
    }
}
