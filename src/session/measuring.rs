use std::cell::Cell;
use std::sync::{Arc, Weak};

use super::Session;
use super::jobs::{Kind, Landing};
use ostra_cloud::LabelledCloud;
use ostra_cloud::measure::{GroundChoice, LengthUnit, MeasureOptions, TraitRow, measure};
use ostra_core::job::JobId;
use ostra_masks::{LabelId, LabelTree};

/// How the labels of the cloud shall be measured.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MeasureWish {
    /// Only labels at this depth of the tree (1 = top); `None` = all.
    pub level: Option<usize>,
    /// The plane above which heights are measured.
    pub ground: GroundChoice,
}

impl MeasureWish {
    pub(super) fn options(&self) -> MeasureOptions {
        MeasureOptions {
            level: self.level,
            ground: self.ground,
            ..MeasureOptions::default()
        }
    }
}

/// The traits that were measured last, and of what.
#[derive(Default)]
pub(super) struct Measuring {
    wanted: Cell<Option<MeasureWish>>,
    of: Option<(Subject, MeasureWish)>,
    rows: Option<Arc<Vec<TraitRow>>>,
    job: Option<JobId>,
}

/// What traits depend on: names and colours of labels do not change them. It does not keep the cloud, so that a round that
/// another has replaced leaves the memory though nobody measures anew.
#[derive(Clone)]
pub(super) struct Subject {
    cloud: Weak<LabelledCloud>,
    parents: Vec<(LabelId, Option<LabelId>)>,
}

impl Subject {
    pub(super) fn is(&self, other: &Self) -> bool {
        Weak::ptr_eq(&self.cloud, &other.cloud) && self.parents == other.parents
    }
}

impl Measuring {
    fn is_of(&self, (subject, wish): &(Subject, MeasureWish)) -> bool {
        self.of
            .as_ref()
            .is_some_and(|of| of.0.is(subject) && of.1 == *wish)
    }
}

impl Session {
    /// The traits of the cloud's labels, in world units. They are measured by a job when they are first asked for and when
    /// the cloud, the tree of labels or the wish is another: `None` until then.
    #[must_use]
    pub fn traits(&self, wish: MeasureWish) -> Option<&Arc<Vec<TraitRow>>> {
        self.measuring.wanted.set(Some(wish));
        let same = self.measuring.of.as_ref().is_some_and(|of| of.1 == wish);
        self.measuring.rows.as_ref().filter(|_| same)
    }

    /// Unit of lengths in what the 3-D view shows: metres where depths, given cameras or a known length give the scale. A
    /// cloud that is older than the scale of the cameras has no unit.
    #[must_use]
    pub fn length_unit(&self) -> LengthUnit {
        let Some(project) = self.project() else {
            return LengthUnit::World;
        };
        if self.growing_cloud().is_some() {
            project.coordinates().unit
        } else {
            project.cloud_unit()
        }
    }

    /// The cloud to measure, the tree that its labels lie in, and what of both measures depend on.
    pub(super) fn measurable(&self) -> Option<(Arc<LabelledCloud>, LabelTree, Subject)> {
        let cloud = Arc::clone(self.cloud()?);
        let tree = self
            .project()
            .map_or_else(|| cloud.tree.clone(), |project| project.labels.clone());
        let parents = tree.iter().map(|label| (label.id, label.parent)).collect();
        let subject = Subject {
            cloud: Arc::downgrade(&cloud),
            parents,
        };
        Some((cloud, tree, subject))
    }

    /// Starts to measure what was asked for, in the place of what was asked for before.
    pub(super) fn measure_wanted(&mut self) {
        let Some(wish) = self.measuring.wanted.take() else {
            return;
        };
        let Some((cloud, tree, subject)) = self.measurable() else {
            return;
        };
        let measured = (subject, wish);
        if self.measuring.is_of(&measured) {
            return;
        }
        if let Some(job) = self.measuring.job.take() {
            self.stop(job);
        }
        self.measuring.rows = None;
        self.measuring.of = Some(measured.clone());
        self.measuring.job = Some(self.start("Measure", Kind::Short, move |link| {
            let rows = measure(&under(&cloud, tree), &wish.options(), &link.progress)?;
            Ok(Box::new(move |session: &mut Self| {
                if session.measuring.is_of(&measured) {
                    session.measuring.rows = Some(Arc::new(rows));
                }
                Ok(())
            }) as Landing)
        }));
    }
}

/// The cloud under a tree; copied only where it is another than its own.
pub(super) fn under(cloud: &Arc<LabelledCloud>, tree: LabelTree) -> Arc<LabelledCloud> {
    if cloud.tree == tree {
        Arc::clone(cloud)
    } else {
        Arc::new(LabelledCloud {
            tree,
            ..LabelledCloud::clone(cloud)
        })
    }
}
