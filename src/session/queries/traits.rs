use crate::job_task::JobTask;
use std::sync::{Arc, Weak};

use anyhow::Result;

use crate::jobs::JobKind;
use crate::query::QueryKey;
use ostra_cloud::LabelledCloud;
use ostra_cloud::measure::{GroundChoice, MeasureOptions, TraitRow, measure};
use ostra_core::job::Progress;
use ostra_masks::{LabelId, LabelTree};

/// How the labels of the cloud shall be measured.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MeasureSettings {
    /// Only labels at this depth of the tree (1 = top); `None` = all.
    pub level: Option<usize>,
    /// The plane above which heights are measured.
    pub ground: GroundChoice,
}

/// What traits depend on: names and colours of labels do not change them. It does not keep the cloud, so that a cloud that
/// was replaced leaves the memory although nobody measures again.
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

/// The traits of a cloud's labels.
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
/// As [`measure`].
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

/// The cloud under a tree; copied only where it is another than its own.
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
