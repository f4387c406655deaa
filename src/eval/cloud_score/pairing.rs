use std::collections::{BTreeMap, BTreeSet};

use ostra_masks::{LabelId, LabelTree};

/// Which truth label each result label stands for: the one of the same name, else the one of the same id unless a
/// name has taken that. A result label without a partner stands for none, and gets an id that the truth does not use.
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
