use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use ostra_cloud::LabelledCloud;
use ostra_masks::{LabelId, LabelTree};

/// Labels of ground truth points compared with the labels of the result.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct CloudLabelScore {
    /// IoU of each label in the ground truth, sorted by id.
    pub iou: Vec<LabelIou>,
    /// Mean IoU over those labels; 0 if there are none.
    pub mean_iou: f64,
    /// Share of the labelled ground truth points with the right label in the result.
    pub accuracy: f64,
    /// Share of all ground truth points with a result point in range.
    pub matched: f64,
    /// Confusion matrix.
    pub confusion: Confusion,
}

/// Intersection over union of one label.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LabelIou {
    /// Id in the ground truth.
    pub id: LabelId,
    /// Name in the ground truth.
    pub name: String,
    /// Number of points with the label in both, divided by those with the label in either.
    pub iou: f64,
    /// Number of ground truth points with the label.
    pub points: usize,
}

/// Counts of ground truth points by label (rows) and label in the result (columns).
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Confusion {
    /// Name of each row; `-` means no label.
    pub truth: Vec<String>,
    /// Name of each column; `-` means no label or no result point in range.
    pub result: Vec<String>,
    /// The counts, row by row.
    pub counts: Vec<Vec<usize>>,
}

/// Scores the labels that the ground truth points take from the result.
///
/// `taken` is parallel to the points of `truth`. Its labels are already mapped to ids of the ground
/// truth by `paired`.
pub(super) fn score_labels(
    truth: &LabelledCloud,
    taken: impl Iterator<Item = Taken>,
    result_tree: &LabelTree,
    paired: &BTreeMap<LabelId, LabelId>,
) -> CloudLabelScore {
    let mut counts: BTreeMap<(LabelId, LabelId), usize> = BTreeMap::new();
    let mut matched = 0;
    for (&label, taken) in truth.labels.iter().zip(taken) {
        matched += usize::from(taken.is_some());
        *counts
            .entry((label, taken.unwrap_or_default()))
            .or_default() += 1;
    }
    let names = names(&truth.tree, result_tree, paired);
    let iou = ious(&counts, &names);
    let labelled: usize = sum(&counts, |row, _| row != LabelId::NONE);
    let right = sum(&counts, |row, column| row != LabelId::NONE && row == column);
    CloudLabelScore {
        mean_iou: iou.iter().map(|label| label.iou).sum::<f64>() / iou.len().max(1) as f64,
        accuracy: share(right, labelled),
        matched: share(matched, truth.len()),
        confusion: confusion(&counts, &names),
        iou,
    }
}

type LabelPairCounts = BTreeMap<(LabelId, LabelId), usize>;

fn sum(counts: &LabelPairCounts, of: impl Fn(LabelId, LabelId) -> bool) -> usize {
    counts
        .iter()
        .filter(|((row, column), _)| of(*row, *column))
        .map(|(_, count)| count)
        .sum()
}

fn share(part: usize, whole: usize) -> f64 {
    if whole == 0 {
        0.0
    } else {
        part as f64 / whole as f64
    }
}

fn ious(counts: &LabelPairCounts, names: &BTreeMap<LabelId, String>) -> Vec<LabelIou> {
    let mut ids: Vec<LabelId> = counts
        .keys()
        .map(|&(row, _)| row)
        .filter(|&row| row != LabelId::NONE)
        .collect();
    ids.dedup();
    let iou = |id: LabelId| LabelIou {
        id,
        name: name(names, id),
        iou: share(
            sum(counts, |row, column| row == id && column == id),
            sum(counts, |row, column| row == id || column == id),
        ),
        points: sum(counts, |row, _| row == id),
    };
    ids.into_iter().map(iou).collect()
}

fn confusion(counts: &LabelPairCounts, names: &BTreeMap<LabelId, String>) -> Confusion {
    let axis = |of: fn(&(LabelId, LabelId)) -> LabelId| {
        let mut ids: Vec<LabelId> = counts.keys().map(of).collect();
        ids.sort_unstable();
        ids.dedup();
        ids
    };
    let (rows, columns) = (axis(|key| key.0), axis(|key| key.1));
    let count = |row, column| counts.get(&(row, column)).copied().unwrap_or(0);
    Confusion {
        truth: rows.iter().map(|&id| name(names, id)).collect(),
        result: columns.iter().map(|&id| name(names, id)).collect(),
        counts: rows
            .iter()
            .map(|&row| columns.iter().map(|&column| count(row, column)).collect())
            .collect(),
    }
}

/// Returns names by ground truth id, including result labels without a partner.
fn names(
    truth: &LabelTree,
    result: &LabelTree,
    paired: &BTreeMap<LabelId, LabelId>,
) -> BTreeMap<LabelId, String> {
    let stand_ins = result
        .iter()
        .filter_map(|label| Some((*paired.get(&label.id)?, label.name.clone())));
    let mut names: BTreeMap<LabelId, String> = stand_ins.collect();
    names.extend(truth.iter().map(|label| (label.id, label.name.clone())));
    names
}

fn name(names: &BTreeMap<LabelId, String>, id: LabelId) -> String {
    match names.get(&id) {
        _ if id == LabelId::NONE => "-".into(),
        Some(name) => name.clone(),
        None => id.0.to_string(),
    }
}

/// Maps each result label to a ground truth label.
///
/// The partner has the same name, or else the same id unless a name has taken that. A result label
/// without a partner gets an id that the ground truth does not use.
#[must_use]
pub fn pair_labels(truth: &LabelTree, result: &LabelTree) -> BTreeMap<LabelId, LabelId> {
    let mut pairs = BTreeMap::new();
    for label in result.iter() {
        if let Some(same) = truth.by_name(&label.name) {
            pairs.insert(label.id, same.id);
        }
    }
    let mut used: BTreeSet<LabelId> = pairs.values().copied().collect();
    let mut alone = Vec::new();
    for label in result
        .iter()
        .filter(|label| truth.by_name(&label.name).is_none())
    {
        if truth.get(label.id).is_some() && used.insert(label.id) {
            pairs.insert(label.id, label.id);
        } else {
            alone.push(label.id);
        }
    }
    used.extend(truth.iter().map(|label| label.id));
    for id in alone {
        let free = std::iter::once(id)
            .chain((1..=u16::MAX).rev().map(LabelId))
            .find(|id| !used.contains(id));
        let stand_in = free.unwrap_or(LabelId::NONE);
        used.insert(stand_in);
        pairs.insert(id, stand_in);
    }
    pairs
}

/// Label of the matched point; `None` if no result point is in range.
type Taken = Option<LabelId>;
