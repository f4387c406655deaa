use std::sync::{Arc, Weak};

use anyhow::Result;

use crate::query::QueryKey;
use ostra_cloud::select::{SelectStep, Selection, Selector};
use ostra_cloud::{LabelledCloud, SceneError};
use ostra_core::job::Progress;
use ostra_project::Project;

/// The steps that select points of a cloud, from which the background computes the points.
///
/// Commands contain the steps too, so that a recipe makes the same selection in another cloud.
#[derive(Clone)]
pub(crate) struct SelectionKey {
    cloud: Weak<LabelledCloud>,
    pub(crate) steps: Vec<SelectStep>,
}

impl SelectionKey {
    pub(crate) fn new(cloud: &Arc<LabelledCloud>, steps: &[SelectStep]) -> Self {
        Self {
            cloud: Arc::downgrade(cloud),
            steps: steps.to_vec(),
        }
    }

    /// Returns whether points of this cloud are selected.
    pub(crate) fn is_in(&self, cloud: &Arc<LabelledCloud>) -> bool {
        std::ptr::eq(self.cloud.as_ptr(), Arc::as_ptr(cloud))
    }
}

impl PartialEq for SelectionKey {
    fn eq(&self, other: &Self) -> bool {
        Weak::ptr_eq(&self.cloud, &other.cloud) && self.steps == other.steps
    }
}

impl QueryKey for SelectionKey {
    const TITLE: &'static str = "Select points";

    /// Work on other steps continues, because it prepares the cloud for all steps.
    fn is_obsolete(&self, wanted: &Self) -> bool {
        !Weak::ptr_eq(&self.cloud, &wanted.cloud)
    }
}

/// A prepared cloud, and the points that the steps select in it.
pub(crate) struct ChosenPoints {
    pub(crate) selector: Option<Arc<Selector>>,
    /// The selection, or why it failed.
    pub(crate) selection: Result<Arc<Selection>, String>,
}

/// Selects points of a cloud, with its prepared `selector` if there is one.
///
/// # Errors
///
/// Returns an error if the progress is stopped.
pub(crate) fn choose_points(
    cloud: &Arc<LabelledCloud>,
    selector: Option<Arc<Selector>>,
    project: &Project,
    steps: &[SelectStep],
    progress: &Progress,
) -> Result<ChosenPoints> {
    let made = match selector {
        Some(selector) => Ok(selector),
        None => Selector::new(Arc::clone(cloud)).map(Arc::new),
    };
    let selector = match made {
        Ok(selector) => selector,
        Err(error) => {
            return Ok(ChosenPoints {
                selector: None,
                selection: Err(error.to_string()),
            });
        }
    };
    let selection = match selector.select(&project.frames, &project.labels, steps, progress) {
        Err(SceneError::Stopped(stopped)) => return Err(stopped.into()),
        chosen => chosen.map(Arc::new).map_err(|error| error.to_string()),
    };
    Ok(ChosenPoints {
        selector: Some(selector),
        selection,
    })
}
