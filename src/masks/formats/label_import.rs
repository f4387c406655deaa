use std::collections::BTreeMap;

use crate::{Label, LabelId, LabelTree, MaskError};

/// Merges the labels of imported files into a project's label tree.
///
/// Labels with a known name keep the project's label; others are added.
pub(super) struct LabelImport {
    tree: LabelTree,
    added: Vec<LabelId>,
    /// Highest id that files use as a number; fresh ids start above it.
    reserved: LabelId,
}

/// A label as described by a file.
pub(super) struct Newcomer<'a> {
    pub name: &'a str,
    /// Preferred id, used when it is free.
    pub id: Option<LabelId>,
    pub parent: Option<LabelId>,
    pub color: Option<[u8; 3]>,
}

impl LabelImport {
    /// Starts from a project's tree; `reserved` is the highest id that files use as a number.
    pub(super) fn new(tree: &LabelTree, reserved: LabelId) -> Self {
        Self {
            tree: tree.clone(),
            added: Vec::new(),
            reserved,
        }
    }

    /// Returns the tree with all added labels.
    pub(super) fn tree(&self) -> &LabelTree {
        &self.tree
    }

    /// Returns the label for a numeric id.
    ///
    /// An id without a label in the tree gets one named after the number.
    pub(super) fn number(&mut self, id: LabelId) -> Result<LabelId, MaskError> {
        if id == LabelId::NONE || self.tree.get(id).is_some() {
            return Ok(id);
        }
        let mut name = id.0.to_string();
        while self.tree.by_name(&name).is_some() {
            name.insert(0, '#');
        }
        self.add(Label {
            id,
            name,
            color: LabelTree::color_for(id),
            parent: None,
        })
    }

    /// Returns the project's label of that name, or adds one.
    pub(super) fn named(&mut self, newcomer: &Newcomer<'_>) -> Result<LabelId, MaskError> {
        if let Some(known) = self.tree.by_name(newcomer.name) {
            return Ok(known.id);
        }
        let wanted = newcomer
            .id
            .filter(|&id| id != LabelId::NONE && self.tree.get(id).is_none());
        let id = wanted.unwrap_or_else(|| self.fresh_id());
        let color = newcomer.color.unwrap_or_else(|| LabelTree::color_for(id));
        self.add(Label {
            id,
            name: newcomer.name.to_owned(),
            color,
            parent: newcomer.parent,
        })
    }

    /// Adds all labels of another tree and returns the new id of each.
    pub(super) fn tree_of(
        &mut self,
        other: &LabelTree,
    ) -> Result<BTreeMap<LabelId, LabelId>, MaskError> {
        let mut ids = BTreeMap::new();
        // Sorting by depth puts parents first. Querying the children of each label would compare
        // all labels with all others.
        let mut all: Vec<&Label> = other.iter().collect();
        all.sort_by_key(|label| other.depth(label.id));
        for label in all {
            let parent = label.parent.and_then(|parent| ids.get(&parent).copied());
            let newcomer = Newcomer {
                name: &label.name,
                id: Some(label.id),
                parent,
                color: Some(label.color),
            };
            ids.insert(label.id, self.named(&newcomer)?);
        }
        Ok(ids)
    }

    /// Returns the added labels, each after its parent.
    pub(super) fn into_added(self) -> Vec<Label> {
        self.added
            .iter()
            .filter_map(|&id| self.tree.get(id).cloned())
            .collect()
    }

    fn fresh_id(&self) -> LabelId {
        let above = LabelId(self.reserved.0.saturating_add(1)).max(self.tree.next_id());
        if self.tree.get(above).is_none() {
            above
        } else {
            self.tree.next_id()
        }
    }

    fn add(&mut self, label: Label) -> Result<LabelId, MaskError> {
        let id = label.id;
        self.tree.set(label)?;
        self.added.push(id);
        Ok(id)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tree(labels: &[(u16, &str, Option<u16>)]) -> LabelTree {
        let label = |&(id, name, parent): &(u16, &str, Option<u16>)| Label {
            id: LabelId(id),
            name: name.into(),
            color: [id as u8; 3],
            parent: parent.map(LabelId),
        };
        labels
            .iter()
            .map(label)
            .collect::<Vec<_>>()
            .try_into()
            .unwrap()
    }

    #[test]
    fn labels_match_by_name_and_numeric_ids_stay() {
        let project = tree(&[(1, "leaf", None), (7, "stem", None)]);
        let file = tree(&[
            (1, "grain", Some(2)),
            (2, "panicle", None),
            (3, "stem", None),
        ]);
        let mut label_import = LabelImport::new(&project, LabelId(8));
        let ids = label_import.tree_of(&file).unwrap();
        assert_eq!(
            ids,
            BTreeMap::from([(1, 9), (2, 2), (3, 7)].map(|(a, b)| (LabelId(a), LabelId(b))))
        );
        assert_eq!(label_import.number(LabelId(8)).unwrap(), LabelId(8));
        assert_eq!(label_import.number(LabelId(7)).unwrap(), LabelId(7));
        let added: Vec<(u16, String, Option<u16>)> = label_import
            .into_added()
            .into_iter()
            .map(|label| (label.id.0, label.name, label.parent.map(|parent| parent.0)))
            .collect();
        assert_eq!(
            added,
            [
                (2, "panicle".into(), None),
                (9, "grain".into(), Some(2)),
                (8, "8".into(), None)
            ]
        );
    }

    #[test]
    fn numeric_id_whose_name_is_taken_gets_a_prefixed_name() {
        let mut label_import =
            LabelImport::new(&tree(&[(1, "5", None), (2, "#5", None)]), LabelId(5));
        label_import.number(LabelId(5)).unwrap();
        assert_eq!(label_import.into_added()[0].name, "##5");
    }

    #[test]
    fn highest_possible_id_is_not_assigned_twice() {
        let mut label_import = LabelImport::new(&tree(&[(1, "a", None)]), LabelId(u16::MAX));
        label_import.number(LabelId(u16::MAX)).unwrap();
        let newcomer = Newcomer {
            name: "b",
            id: None,
            parent: None,
            color: None,
        };
        assert_eq!(label_import.named(&newcomer).unwrap(), LabelId(2));
    }
}
