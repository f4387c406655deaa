use std::sync::Arc;

use anyhow::Result;

use super::Session;
use super::jobs::{Kind, Landing};
use ostra_cloud::select::{SelectStep, Selection, Selector};
use ostra_cloud::{LabelledCloud, SceneError};
use ostra_core::job::JobId;
use ostra_core::job::Progress;
use ostra_project::Project;

/// The points that somebody chooses and did not correct yet.
#[derive(Default)]
pub(super) struct Selected {
    wanted: Vec<SelectStep>,
    choosing: Option<JobId>,
    /// The cloud made ready, kept from wish to wish.
    selector: Option<Arc<Selector>>,
    answer: Option<Answer>,
}

struct Answer {
    steps: Vec<SelectStep>,
    cloud: Arc<LabelledCloud>,
    selection: Result<Arc<Selection>, String>,
}

impl Session {
    /// Asks for the points that some steps choose in the project's cloud, or, with none, for nothing any more. They are found
    /// in the background: one wish at a time, the newest next. Asked anew, it finds them anew in a cloud that changed.
    pub fn select(&mut self, wanted: &[SelectStep]) {
        if wanted.is_empty() {
            self.selected = Selected {
                choosing: self.selected.choosing,
                ..Selected::default()
            };
            return;
        }
        if self.selected.wanted != wanted {
            self.selected.wanted = wanted.to_vec();
        }
        let is_choosing = |id| self.jobs.iter().any(|job| job.id == id && !job.has_ended());
        if self.selected.choosing.is_some_and(is_choosing) {
            return;
        }
        let Some(cloud) = self.cloud().cloned() else {
            return;
        };
        let known = self.selected.answer.as_ref();
        if known.is_some_and(|known| known.steps == wanted && Arc::ptr_eq(&known.cloud, &cloud)) {
            return;
        }
        let Ok(project) = self.snapshot() else { return };
        let (steps, selector) = (wanted.to_vec(), self.selector_of(&cloud));
        self.selected.choosing = Some(self.start("Choose points", Kind::Background, move |link| {
            let (selector, selection) = choose(selector, &cloud, &project, &steps, &link.progress)?;
            Ok(Box::new(move |session: &mut Self| {
                if !session.selected.wanted.is_empty() {
                    session.selected.selector = selector;
                    session.selected.answer = Some(Answer {
                        steps,
                        cloud,
                        selection,
                    });
                }
                Ok(())
            }) as Landing)
        }));
    }

    /// The points that the newest wish of [`Self::select`] chooses, where they are found; else why there are none.
    #[must_use]
    pub fn selected(&self) -> Option<Result<&Arc<Selection>, &str>> {
        let selected = &self.selected;
        let answer = selected
            .answer
            .as_ref()
            .filter(|answer| answer.steps == selected.wanted)?;
        let is_of = self
            .cloud()
            .is_some_and(|cloud| Arc::ptr_eq(cloud, &answer.cloud));
        is_of.then(|| answer.selection.as_ref().map_err(String::as_str))
    }

    /// What was made ready for a cloud, where it was.
    pub(super) fn selector_of(&self, cloud: &Arc<LabelledCloud>) -> Option<Arc<Selector>> {
        self.selected
            .selector
            .clone()
            .filter(|selector| Arc::ptr_eq(selector.cloud(), cloud))
    }
}

/// A cloud made ready, and what the steps choose in it or why they cannot.
type Chosen = (Option<Arc<Selector>>, Result<Arc<Selection>, String>);

fn choose(
    selector: Option<Arc<Selector>>,
    cloud: &Arc<LabelledCloud>,
    project: &Project,
    steps: &[SelectStep],
    progress: &Progress,
) -> Result<Chosen> {
    let selector = match selector.map_or_else(|| Selector::new(Arc::clone(cloud)).map(Arc::new), Ok)
    {
        Ok(selector) => selector,
        Err(error) => return Ok((None, Err(error.to_string()))),
    };
    let selection = match selector.select(&project.frames, &project.labels, steps, progress) {
        Err(SceneError::Stopped(stopped)) => return Err(stopped.into()),
        chosen => chosen.map(Arc::new).map_err(|error| error.to_string()),
    };
    Ok((Some(selector), selection))
}
