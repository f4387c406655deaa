use std::collections::BTreeMap;

use super::{LabelId, LabelTree, Region};

/// Label id of every pixel of one frame, row by row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LabelMask {
    /// Number of columns.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
    /// `width · height` ids; 0 = unlabelled.
    pub ids: Vec<LabelId>,
}

impl LabelMask {
    /// Returns a mask without labels.
    #[must_use]
    #[inline]
    pub fn empty(width: u32, height: u32) -> Self {
        Self {
            width,
            height,
            ids: vec![LabelId::NONE; width as usize * height as usize],
        }
    }

    /// Returns the id in column `x`, row `y`.
    #[must_use]
    #[inline]
    pub fn at(&self, x: u32, y: u32) -> LabelId {
        self.ids[y as usize * self.width as usize + x as usize]
    }

    /// Returns the pixels of one label.
    #[must_use]
    #[inline]
    pub fn region(&self, id: LabelId) -> Region {
        Region {
            width: self.width,
            height: self.height,
            inside: self.ids.iter().map(|&at| at == id).collect(),
        }
    }

    /// Returns the pixels of a label and of all labels below it in the tree.
    #[must_use]
    #[inline]
    pub fn region_with_parts(&self, id: LabelId, tree: &LabelTree) -> Region {
        let mut wanted = tree.descendants(id);
        wanted.push(id);
        wanted.sort_unstable();
        let inside = self
            .ids
            .iter()
            .map(|at| wanted.binary_search(at).is_ok())
            .collect();
        Region {
            width: self.width,
            height: self.height,
            inside,
        }
    }

    /// Replaces every label by its ancestor at `level` (1 = top); labels that are not deeper stay.
    #[must_use]
    #[inline]
    pub fn at_level(&self, tree: &LabelTree, level: usize) -> Self {
        let mut ids = Vec::with_capacity(self.ids.len());
        let mut known: BTreeMap<LabelId, LabelId> = BTreeMap::new();
        for run in self.ids.chunk_by(|a, b| a == b) {
            let id = *known
                .entry(run[0])
                .or_insert_with(|| tree.at_level(run[0], level));
            ids.resize(ids.len() + run.len(), id);
        }
        Self {
            width: self.width,
            height: self.height,
            ids,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Label;

    #[test]
    fn labels_are_replaced_by_their_ancestors() {
        let label = |id, parent: Option<u16>| Label {
            id: LabelId(id),
            name: format!("label {id}"),
            color: [0; 3],
            parent: parent.map(LabelId),
        };
        let tree: LabelTree = vec![
            label(1, None),
            label(2, Some(1)),
            label(3, Some(2)),
            label(4, None),
        ]
        .try_into()
        .unwrap();
        let mask = LabelMask {
            width: 3,
            height: 2,
            ids: [0, 1, 2, 3, 4, 9].map(LabelId).to_vec(),
        };
        assert_eq!(mask.at_level(&tree, 1).ids, [0, 1, 1, 1, 4, 9].map(LabelId));
        assert_eq!(mask.at_level(&tree, 2).ids, [0, 1, 2, 2, 4, 9].map(LabelId));
        assert_eq!(
            mask.region_with_parts(LabelId(2), &tree).inside,
            [false, false, true, true, false, false]
        );
        assert_eq!(mask.region(LabelId(2)).area(), 1);
    }
}
