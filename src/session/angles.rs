use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};

use super::Session;
use super::jobs::{Kind, Landing};
use super::measuring::{Subject, under};
use ostra_cloud::SceneError;
use ostra_cloud::measure::{MeasureOptions, TraitRow, measure_angles};
use ostra_core::job::JobId;
use ostra_masks::LabelId;

/// By the two labels, the angles between their pieces, or why there is none.
pub type Angles = BTreeMap<[LabelId; 2], Result<Vec<TraitRow>, String>>;

/// Angles between labels that somebody asked for, and of which cloud they are.
#[derive(Default)]
pub(super) struct AngleMeasuring {
    wanted: RefCell<BTreeSet<[LabelId; 2]>>,
    of: Option<Subject>,
    found: Angles,
    /// What jobs were started for.
    begun: BTreeSet<[LabelId; 2]>,
    jobs: Vec<JobId>,
}

impl AngleMeasuring {
    fn is_of(&self, subject: &Subject) -> bool {
        self.of.as_ref().is_some_and(|of| of.is(subject))
    }
}

impl Session {
    /// Angles between labels of the cloud, and those asked for before. A job measures a pair when it is first asked for and
    /// when the cloud or the tree of labels is another: it is not there until then.
    #[must_use]
    pub fn angles(&self, pairs: impl IntoIterator<Item = [LabelId; 2]>) -> &Angles {
        self.angle_measuring.wanted.borrow_mut().extend(pairs);
        &self.angle_measuring.found
    }

    /// Starts to measure the angles that were asked for and are not known.
    pub(super) fn measure_wanted_angles(&mut self) {
        let wanted = self.angle_measuring.wanted.take();
        if wanted.is_empty() {
            return;
        }
        let Some((cloud, tree, subject)) = self.measurable() else {
            return;
        };
        if !self.angle_measuring.is_of(&subject) {
            let former = std::mem::take(&mut self.angle_measuring);
            former.jobs.into_iter().for_each(|job| self.stop(job));
            self.angle_measuring.of = Some(subject.clone());
        }
        let new: Vec<[LabelId; 2]> = wanted
            .difference(&self.angle_measuring.begun)
            .copied()
            .collect();
        if new.is_empty() {
            return;
        }
        self.angle_measuring.begun.extend(&new);
        let job = self.start("Measure angles", Kind::Short, move |link| {
            let cloud = under(&cloud, tree);
            let measured = |pair| match measure_angles(
                &cloud,
                &[pair],
                &MeasureOptions::default(),
                &link.progress,
            ) {
                Err(SceneError::Stopped(stopped)) => Err(stopped),
                told => Ok((pair, told.map_err(|error| error.to_string()))),
            };
            let found: Vec<_> = new.into_iter().map(measured).collect::<Result<_, _>>()?;
            Ok(Box::new(move |session: &mut Self| {
                if session.angle_measuring.is_of(&subject) {
                    session.angle_measuring.found.extend(found);
                }
                Ok(())
            }) as Landing)
        });
        self.angle_measuring.jobs.push(job);
    }
}
