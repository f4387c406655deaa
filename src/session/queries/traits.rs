use crate::job_task::JobTask;
use std::sync::{Arc, Weak};

use anyhow::Result;

use crate::jobs::JobKind;
use crate::query::QueryKey;
use ostra_cloud::LabelledCloud;
use ostra_cloud::measure::{GroundChoice, MeasureOptions, TraitRow, measure};
use ostra_core::job::Progress;
use ostra_masks::{LabelId, LabelTree};

/// Settings for measuring the labels of the cloud.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MeasureSettings {
    /// Level of the label tree to measure (1 = top); `None` measures all labels.
    pub level: Option<usize>,
    /// Ground plane from which heights are measured.
    pub ground: GroundChoice,
}

/// The inputs of traits, which do not include names and colours of labels.
///
/// It does not hold the cloud itself, so that a replaced cloud is freed even if it is never
/// measured again.
#[derive(Clone)]
pub(crate) struct MeasuredCloud {
    cloud: Weak<LabelledCloud>,
    parents: Vec<(LabelId, Option<LabelId>)>,
}

impl MeasuredCloud {
    pub(crate) fn new(cloud: &Arc<LabelledCloud>, tree: &LabelTree) -> Self {
        Self {
            cloud: Arc::downgrade(cloud),
            parents: tree.iter().map(|label| (label.id, label.parent)).collect(),
        }
    }
}

impl PartialEq for MeasuredCloud {
    fn eq(&self, other: &Self) -> bool {
        Weak::ptr_eq(&self.cloud, &other.cloud) && self.parents == other.parents
    }
}

/// The cloud and the settings of a measurement of traits.
#[derive(Clone, PartialEq)]
pub(crate) struct TraitsKey {
    pub(crate) of: MeasuredCloud,
    pub(crate) settings: MeasureSettings,
}

impl QueryKey for TraitsKey {
    const TITLE: &'static str = "Measure";
    const TASK: Option<JobTask> = Some(JobTask::MeasureTraits);

    fn kind(&self) -> JobKind {
        JobKind::Short
    }
}

/// Measures the labels of a cloud.
///
/// # Errors
///
/// Returns the errors of [`measure`].
pub(crate) fn measure_traits(
    cloud: &LabelledCloud,
    key: &TraitsKey,
    progress: &Progress,
) -> Result<Vec<TraitRow>> {
    let options = MeasureOptions {
        level: key.settings.level,
        ground: key.settings.ground,
        ..MeasureOptions::default()
    };
    Ok(measure(cloud, &options, progress)?)
}

/// Returns the cloud with another label tree; it is copied only if the trees differ.
pub(crate) fn under(cloud: Arc<LabelledCloud>, tree: LabelTree) -> Arc<LabelledCloud> {
    if cloud.tree == tree {
        cloud
    } else {
        Arc::new(LabelledCloud {
            tree,
            ..LabelledCloud::clone(&cloud)
        })
    }
}
