use crate::job_task::JobTask;
use std::collections::{BTreeMap, BTreeSet};

use super::traits::MeasuredCloud;
use crate::jobs::JobKind;
use crate::query::QueryKey;
use ostra_cloud::measure::{MeasureOptions, TraitRow, measure_angles};
use ostra_cloud::{LabelledCloud, SceneError};
use ostra_core::job::{Progress, Stopped};
use ostra_masks::LabelId;

/// The angles between the pieces of two labels, or why there are none, by the pair of labels.
pub type Angles = BTreeMap<[LabelId; 2], Result<Vec<TraitRow>, String>>;

/// Pairs of labels of a cloud.
#[derive(Clone, PartialEq)]
pub(crate) struct AnglesKey {
    pub(crate) of: MeasuredCloud,
    pub(crate) pairs: BTreeSet<[LabelId; 2]>,
}

impl QueryKey for AnglesKey {
    const TITLE: &'static str = "Measure angles";
    const TASK: Option<JobTask> = Some(JobTask::MeasureAngles);

    fn kind(&self) -> JobKind {
        JobKind::Short
    }

    /// Known pairs are shown until the others are measured.
    fn serves(&self, wanted: &Self) -> bool {
        self.of == wanted.of
    }
}

/// Measures the angles between pairs of labels that are not known yet.
///
/// # Errors
///
/// Returns an error if the progress is stopped.
pub(crate) fn find_angles(
    cloud: &LabelledCloud,
    pairs: &BTreeSet<[LabelId; 2]>,
    known: Angles,
    progress: &Progress,
) -> Result<Angles, Stopped> {
    let mut found = known;
    for pair in pairs {
        if found.contains_key(pair) {
            continue;
        }
        let angles = match measure_angles(cloud, &[*pair], &MeasureOptions::default(), progress) {
            Err(SceneError::Stopped(stopped)) => return Err(stopped),
            angles => angles.map_err(|error| error.to_string()),
        };
        found.insert(*pair, angles);
    }
    Ok(found)
}
