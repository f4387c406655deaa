use std::collections::BTreeMap;
use std::fmt::Write as _;

use anyhow::{Context, Result};
use serde::Serialize;

use super::user::DemoDriver;
use crate::cloud_score::{CloudScoreOptions, score_cloud};
use crate::synthetic::Scene;
use ostra_cloud::LabelledCloud;
use ostra_cloud::instances::InstanceOptions;
use ostra_cloud::points::Neighbours;
use ostra_core::job::Progress;
use ostra_masks::{LabelId, LabelTree};
use ostra_session::{Command, InstancesRequest};

/// Content of `report.json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DemoReport {
    /// The labelled cloud compared with the exact one.
    pub cloud: CloudReport,
    /// The masks compared with the exact ones, over all frames.
    pub masks: MaskReport,
    /// Scores per class, instance and part, for scenes with ground truth for all three.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub levels: Option<LevelsReport>,
    /// Number of clicks over the whole sequence, per clicked label.
    pub clicks: BTreeMap<String, usize>,
    /// Wall time of each stage, in seconds.
    pub seconds: BTreeMap<String, f64>,
    /// Description of the scene, from which it can be built again.
    pub scene: String,
}

/// Score of a cloud.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CloudReport {
    /// IoU per class over all ground truth points.
    pub iou: BTreeMap<String, f64>,
    /// Share of the points of each kind of part (e.g. sheaths) that have the label of the class.
    pub parts: BTreeMap<String, f64>,
    /// Share of the labelled ground truth points with the right class.
    pub accuracy: f64,
    /// Median distance from a labelled ground truth point to the result, in millimetres.
    pub median_distance_mm: f64,
    /// Number of points in the result.
    pub points: usize,
}

/// IoU of the labels of a cloud over all ground truth points, by level of the label tree.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LevelsReport {
    /// Per class.
    pub class: BTreeMap<String, f64>,
    /// Per instance, by the name of the matched ground truth instance.
    pub instance: BTreeMap<String, f64>,
    /// Per part.
    pub part: BTreeMap<String, f64>,
    /// Number of instances found for each class that was labelled as one.
    pub instances: BTreeMap<String, usize>,
}

/// Score of the masks.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MaskReport {
    /// Mean IoU over the frames, per clicked label.
    pub iou: BTreeMap<String, f64>,
}

impl DemoReport {
    /// Returns the report as a table.
    #[must_use]
    pub fn table(&self) -> String {
        let mut text = format!(
            "{}\n\n{:<20} {:>9} {:>9} {:>7}\n",
            self.scene, "label", "mask IoU", "3-D IoU", "clicks"
        );
        match &self.levels {
            None => self
                .cloud
                .iou
                .iter()
                .for_each(|(label, &iou)| self.row(&mut text, label, iou)),
            Some(levels) => {
                for (title, ious) in [
                    ("class", &levels.class),
                    ("instance", &levels.instance),
                    ("part", &levels.part),
                ] {
                    let _ = writeln!(text, "{title}");
                    ious.iter()
                        .for_each(|(label, &iou)| self.row(&mut text, label, iou));
                }
                for (class, count) in &levels.instances {
                    let _ = writeln!(text, "instances of {class} found: {count}");
                }
            }
        }
        for (part, share) in &self.cloud.parts {
            let _ = writeln!(
                text,
                "{:<20} {:>9} {share:>9.4}  (share labelled right)",
                format!("  {part}"),
                ""
            );
        }
        let cloud = &self.cloud;
        let _ = writeln!(
            text,
            "\naccuracy over labelled truth points  {:.4}",
            cloud.accuracy
        );
        let _ = writeln!(
            text,
            "median distance to truth             {:.2} mm",
            cloud.median_distance_mm
        );
        let _ = writeln!(
            text,
            "points                               {}\n",
            cloud.points
        );
        for (stage, seconds) in &self.seconds {
            let _ = writeln!(text, "{stage:<14} {seconds:>8.1} s");
        }
        text
    }

    /// Appends a row; mask IoU and clicks are empty for labels that were not clicked.
    fn row(&self, text: &mut String, label: &str, iou: f64) {
        let mask = self
            .masks
            .iou
            .get(label)
            .map_or_else(String::new, |iou| format!("{iou:.4}"));
        let clicks = self
            .clicks
            .get(label)
            .map_or_else(String::new, usize::to_string);
        let _ = writeln!(text, "{label:<20} {mask:>9} {iou:>9.4} {clicks:>7}");
    }
}

/// Depth of instances in the label tree of a scene.
const INSTANCE_LEVEL: usize = Scene::CLASS_LEVEL + 1;

/// Splits classes that were labelled as one into instances.
pub(super) fn separate_instances(
    studio: &mut DemoDriver<'_, '_>,
    classes: &[String],
) -> Result<()> {
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

/// Scores a cloud at the level of classes, instances and parts.
///
/// Instances from segmentation have arbitrary ids. Each is matched to the ground truth instance
/// with the most shared points, and each ground truth instance is used once.
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

/// Matches found instances to ground truth instances, by decreasing number of shared points.
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

/// Renames found instances after their matches; the others get names that no truth has.
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
