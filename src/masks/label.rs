use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

use super::MaskError;

/// Names a label in masks and clouds; 0 = nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize)]
#[serde(transparent)]
pub struct LabelId(pub u16);

impl LabelId {
    /// No label.
    pub const NONE: Self = Self(0);
}

/// A node of the label tree (semantic › instance › part).
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Label {
    /// Its id, never 0.
    pub id: LabelId,
    /// Unique in the tree, not empty, no line break.
    pub name: String,
    /// sRGB.
    pub color: [u8; 3],
    /// `None` = top level.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parent: Option<LabelId>,
}

/// All labels of a project, by id. Invariants: names are unique, parents exist, no circles.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(transparent)]
pub struct LabelTree {
    labels: BTreeMap<LabelId, Label>,
}

impl LabelTree {
    /// All labels, ordered by id.
    pub fn iter(&self) -> impl Iterator<Item = &Label> {
        self.labels.values()
    }

    /// The label with this id.
    #[must_use]
    pub fn get(&self, id: LabelId) -> Option<&Label> {
        self.labels.get(&id)
    }

    /// The label with this name.
    #[must_use]
    pub fn by_name(&self, name: &str) -> Option<&Label> {
        self.labels.values().find(|label| label.name == name)
    }

    /// Puts `label` in the place of its id, checking every invariant.
    ///
    /// # Errors
    /// [`MaskError::Label`] for id 0, an empty or taken name, a missing parent, a circle.
    pub fn set(&mut self, label: Label) -> Result<(), MaskError> {
        self.check(&label)?;
        self.labels.insert(label.id, label);
        Ok(())
    }

    /// Takes a label out.
    ///
    /// # Errors
    /// [`MaskError::Label`] when it is not there or has children.
    pub fn remove(&mut self, id: LabelId) -> Result<Label, MaskError> {
        if let Some(child) = self.labels.values().find(|label| label.parent == Some(id)) {
            return Err(MaskError::Label(format!(
                "label {} still has the child '{}'; remove that first",
                id.0, child.name
            )));
        }
        self.labels.remove(&id).ok_or_else(|| MaskError::Label(format!("there is no label {}", id.0)))
    }

    /// The lowest id that is free above all in use.
    #[must_use]
    pub fn next_id(&self) -> LabelId {
        LabelId(self.labels.keys().next_back().map_or(1, |id| id.0.saturating_add(1)))
    }

    /// Depth of a label: 1 = top level; 0 for [`LabelId::NONE`] or an unknown id.
    #[must_use]
    pub fn depth(&self, id: LabelId) -> usize {
        self.path(id).len()
    }

    /// Ids from the top level down to `id`; empty for an unknown id.
    #[must_use]
    pub fn path(&self, id: LabelId) -> Vec<LabelId> {
        let mut path: Vec<LabelId> =
            std::iter::successors(self.get(id), |label| self.get(label.parent?)).map(|label| label.id).collect();
        path.reverse();
        path
    }

    /// The label as read at `level` (1 = top): its ancestor there, itself where it is not deeper.
    #[must_use]
    pub fn at_level(&self, id: LabelId, level: usize) -> LabelId {
        let path = self.path(id);
        if level == 0 || path.len() <= level { id } else { path[level - 1] }
    }

    /// A colour for a new label, far from those in use for the first dozens of ids.
    #[must_use]
    pub fn color_for(id: LabelId) -> [u8; 3] {
        const PALETTE: [[u8; 3]; 12] = [
            [230, 75, 60],
            [60, 180, 75],
            [65, 105, 235],
            [255, 205, 40],
            [170, 60, 200],
            [50, 200, 210],
            [245, 130, 48],
            [150, 220, 60],
            [240, 90, 180],
            [0, 128, 128],
            [160, 110, 60],
            [120, 120, 255],
        ];
        let base = PALETTE[usize::from(id.0.wrapping_sub(1)) % PALETTE.len()];
        let dim = 1.0 - 0.17 * f32::from((id.0.wrapping_sub(1) / 12) % 4);
        base.map(|channel| (f32::from(channel) * dim) as u8)
    }

    fn check(&self, label: &Label) -> Result<(), MaskError> {
        let fail = |text: String| Err(MaskError::Label(text));
        if label.id == LabelId::NONE {
            return fail("label id 0 means nothing and cannot be used".into());
        }
        if label.name.trim().is_empty() || label.name.contains(['\n', '\r']) {
            return fail("a label needs a name of one line".into());
        }
        if self.labels.values().any(|other| other.id != label.id && other.name == label.name) {
            return fail(format!("there is already a label '{}'; choose another name", label.name));
        }
        if let Some(parent) = label.parent {
            if self.get(parent).is_none() {
                return fail(format!("the parent of '{}' does not exist", label.name));
            }
            if self.path(parent).contains(&label.id) {
                return fail(format!("'{}' cannot be its own ancestor", label.name));
            }
        }
        Ok(())
    }
}
