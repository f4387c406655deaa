use std::collections::BTreeMap;

use anyhow::{Context, Result};

use super::report::LevelsReport;
use super::studio::Studio;
use crate::cloud_score::{CloudScoreOptions, score_cloud};
use crate::synthetic::Scene;
use ostra_cloud::LabelledCloud;
use ostra_cloud::instances::InstanceOptions;
use ostra_cloud::points::Neighbours;
use ostra_core::job::Progress;
use ostra_masks::{LabelId, LabelTree};
use ostra_session::{Command, InstancesRequest};

/// Depth of instances in the label tree of a scene.
const INSTANCE_LEVEL: usize = Scene::CLASS_LEVEL + 1;

/// Tells the instances of classes apart that were labelled as one.
pub(super) fn tell_apart(studio: &mut Studio<'_, '_>, classes: &[String]) -> Result<()> {
    for class in classes {
        let project = studio.session.project().context("no project is open")?;
        let label = project
            .labels
            .by_name(class)
            .context("the label was not made")?
            .id;
        studio.act(Command::Instances(InstancesRequest {
            label,
            options: InstanceOptions::default(),
        }))?;
    }
    Ok(())
}

/// Scores a cloud at the level of classes, instances and parts. Instances that were told apart have numbers of their own:
/// each stands for the true one with which it shares most points, each true one once.
pub(super) fn score_levels(
    truth: &LabelledCloud,
    result: &LabelledCloud,
    classes: &[String],
    within_m: f64,
) -> Result<LevelsReport> {
    let mut result = result.clone();
    let mut instances = BTreeMap::new();
    for class in classes {
        let found = below(&result.tree, class);
        instances.insert(class.clone(), found.len());
        let pairs = paired(truth, &result, &below(&truth.tree, class), &found);
        rename(&mut result.tree, &found, &truth.tree, &pairs)?;
    }
    let at = |level: Option<usize>, depth: usize| -> Result<BTreeMap<String, f64>> {
        let options = CloudScoreOptions {
            within: vec![within_m],
            level,
            ..CloudScoreOptions::default()
        };
        let labels = score_cloud(truth, &result, &options, &Progress::default())?.labels;
        let of_depth = labels
            .iou
            .into_iter()
            .filter(|label| truth.tree.depth(label.id) == depth);
        Ok(of_depth.map(|label| (label.name, label.iou)).collect())
    };
    Ok(LevelsReport {
        class: at(Some(Scene::CLASS_LEVEL), Scene::CLASS_LEVEL)?,
        instance: at(Some(INSTANCE_LEVEL), INSTANCE_LEVEL)?,
        part: at(None, Scene::PART_LEVEL)?,
        instances,
    })
}

fn below(tree: &LabelTree, class: &str) -> Vec<LabelId> {
    tree.by_name(class).map_or_else(Vec::new, |class| {
        tree.children(Some(class.id))
            .map(|label| label.id)
            .collect()
    })
}

/// Which true instance each found one stands for, those that share most points first.
fn paired(
    truth: &LabelledCloud,
    result: &LabelledCloud,
    true_ids: &[LabelId],
    found: &[LabelId],
) -> BTreeMap<LabelId, LabelId> {
    let Some(points) = Neighbours::new(&result.positions) else {
        return BTreeMap::new();
    };
    let mut shared: BTreeMap<(LabelId, LabelId), usize> = BTreeMap::new();
    for (&id, &x) in truth
        .labels
        .iter()
        .zip(&truth.positions)
        .filter(|(id, _)| true_ids.contains(id))
    {
        *shared
            .entry((result.labels[points.nearest(x).0], id))
            .or_default() += 1;
    }
    let mut shared: Vec<_> = shared
        .into_iter()
        .filter(|((of, _), _)| found.contains(of))
        .collect();
    shared.sort_by_key(|&(pair, count)| (std::cmp::Reverse(count), pair));
    let mut pairs: BTreeMap<LabelId, LabelId> = BTreeMap::new();
    for ((of, id), _) in shared {
        if !pairs.contains_key(&of) && !pairs.values().any(|&taken| taken == id) {
            pairs.insert(of, id);
        }
    }
    pairs
}

/// Gives the instances found the names of the true ones; those that stand for none get names that no truth has.
fn rename(
    tree: &mut LabelTree,
    found: &[LabelId],
    truth: &LabelTree,
    pairs: &BTreeMap<LabelId, LabelId>,
) -> Result<()> {
    for id in found {
        tree.rename(*id, &format!("found {}", id.0))?;
    }
    for (&id, &of) in pairs {
        tree.rename(id, &truth.get(of).context("the truth lacks a label")?.name)?;
    }
    Ok(())
}
