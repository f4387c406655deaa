use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use crate::MaskError;

/// Names a label in masks and clouds; 0 = nothing.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize,
)]
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

/// All labels of a project, by id. Invariants: names are unique, parents exist, no circles. Stored as a list of
/// labels; a list that breaks an invariant is refused.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(into = "Vec<Label>", try_from = "Vec<Label>")]
pub struct LabelTree {
    labels: BTreeMap<LabelId, Label>,
    /// Ids by name, so that a check of one name does not compare it with all: files can list 65,535 labels.
    ids: BTreeMap<String, LabelId>,
}

/// Most labels that an error names.
const MOST_NAMED: usize = 10;

/// Labels lie at most this deep. Every walk to the top level costs as many steps, so that a file of 65,535 labels in one
/// chain would take minutes.
pub const MAX_DEPTH: usize = 64;

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
        self.labels.get(self.ids.get(name)?)
    }

    /// Puts `label` in the place of its id, checking every invariant.
    ///
    /// # Errors
    /// [`MaskError::Label`] for id 0, an empty or taken name, a missing parent, a circle, a depth above 64.
    pub fn set(&mut self, label: Label) -> Result<(), MaskError> {
        self.check(&label)?;
        self.ids.insert(label.name.clone(), label.id);
        let name = label.name.clone();
        if let Some(before) = self
            .labels
            .insert(label.id, label)
            .filter(|before| before.name != name)
        {
            self.ids.remove(&before.name);
        }
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
        let label = self
            .labels
            .remove(&id)
            .ok_or_else(|| MaskError::Label(format!("there is no label {}", id.0)))?;
        self.ids.remove(&label.name);
        Ok(label)
    }

    /// The id after the highest in use; once 65535 is taken, the lowest that is free; [`LabelId::NONE`] (which
    /// [`Self::set`] refuses) when none is.
    #[must_use]
    pub fn next_id(&self) -> LabelId {
        let highest = self.labels.keys().next_back().map_or(0, |id| id.0);
        let next = highest.checked_add(1).map(LabelId);
        next.or_else(|| {
            (1..=u16::MAX)
                .map(LabelId)
                .find(|id| !self.labels.contains_key(id))
        })
        .unwrap_or_default()
    }

    /// Labels directly below `parent` (`None` = the top level), ordered by id.
    pub fn children(&self, parent: Option<LabelId>) -> impl Iterator<Item = &Label> {
        self.labels
            .values()
            .filter(move |label| label.parent == parent)
    }

    /// All labels below `id`, each before its own children; without `id` itself.
    #[must_use]
    pub fn descendants(&self, id: LabelId) -> Vec<LabelId> {
        let mut found = Vec::new();
        let mut open: Vec<LabelId> = self.children(Some(id)).map(|label| label.id).collect();
        open.reverse();
        while let Some(next) = open.pop() {
            found.push(next);
            let at = open.len();
            open.extend(self.children(Some(next)).map(|label| label.id));
            open[at..].reverse();
        }
        found
    }

    /// Whether `ancestor` lies above `id`; a label is not its own ancestor.
    #[must_use]
    pub fn is_ancestor(&self, ancestor: LabelId, id: LabelId) -> bool {
        ancestor != id && self.path(id).contains(&ancestor)
    }

    /// Names from the top level down, as shown to people: `rice › stem 1`; empty for an unknown id.
    #[must_use]
    pub fn name_path(&self, id: LabelId) -> String {
        let names: Vec<&str> = self
            .path(id)
            .iter()
            .filter_map(|&id| Some(self.get(id)?.name.as_str()))
            .collect();
        names.join(" › ")
    }

    /// Gives a label another name.
    ///
    /// # Errors
    /// As [`Self::set`], and when there is no such label.
    pub fn rename(&mut self, id: LabelId, name: &str) -> Result<(), MaskError> {
        let label = self.known(id)?.clone();
        self.set(Label {
            name: name.to_owned(),
            ..label
        })
    }

    /// Gives a label another colour (sRGB).
    ///
    /// # Errors
    /// [`MaskError::Label`] when there is no such label.
    pub fn recolor(&mut self, id: LabelId, color: [u8; 3]) -> Result<(), MaskError> {
        let label = self.known(id)?.clone();
        self.set(Label { color, ..label })
    }

    /// Moves a label, with all below it, under another parent (`None` = to the top level).
    ///
    /// # Errors
    /// As [`Self::set`], and when there is no such label.
    pub fn reparent(&mut self, id: LabelId, parent: Option<LabelId>) -> Result<(), MaskError> {
        let label = self.known(id)?.clone();
        self.set(Label { parent, ..label })
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
            std::iter::successors(self.get(id), |label| self.get(label.parent?))
                .map(|label| label.id)
                .collect();
        path.reverse();
        path
    }

    /// The label as read at `level` (1 = top): its ancestor there, itself where it is not deeper.
    #[must_use]
    pub fn at_level(&self, id: LabelId, level: usize) -> LabelId {
        let path = self.path(id);
        if level == 0 || path.len() <= level {
            id
        } else {
            path[level - 1]
        }
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

    fn known(&self, id: LabelId) -> Result<&Label, MaskError> {
        self.get(id)
            .ok_or_else(|| MaskError::Label(format!("there is no label {}", id.0)))
    }

    fn check(&self, label: &Label) -> Result<(), MaskError> {
        let fail = |text: String| Err(MaskError::Label(text));
        if label.id == LabelId::NONE {
            return fail("label id 0 means nothing and cannot be used".into());
        }
        if label.name.trim().is_empty() || label.name.contains(['\n', '\r']) {
            return fail("a label needs a name of one line".into());
        }
        if self
            .by_name(&label.name)
            .is_some_and(|other| other.id != label.id)
        {
            return fail(format!(
                "there is already a label '{}'; choose another name",
                label.name
            ));
        }
        if let Some(parent) = label.parent {
            if self.get(parent).is_none() {
                return fail(format!("the parent of '{}' does not exist", label.name));
            }
            let path = self.path(parent);
            if path.contains(&label.id) {
                return fail(format!("'{}' cannot be its own ancestor", label.name));
            }
            if path.len() >= MAX_DEPTH {
                return fail(format!(
                    "'{}' lies more than {MAX_DEPTH} labels deep; move it up",
                    label.name
                ));
            }
        }
        Ok(())
    }
}

impl From<LabelTree> for Vec<Label> {
    fn from(tree: LabelTree) -> Self {
        tree.labels.into_values().collect()
    }
}

impl TryFrom<Vec<Label>> for LabelTree {
    type Error = MaskError;

    /// Takes labels in any order: a child may stand before its parent.
    fn try_from(labels: Vec<Label>) -> Result<Self, MaskError> {
        if let Some(id) = repeated_id(&labels) {
            return Err(MaskError::Label(format!(
                "label id {} is there twice; give each label its own",
                id.0
            )));
        }
        let mut below: BTreeMap<Option<LabelId>, Vec<Label>> = BTreeMap::new();
        for label in labels {
            below.entry(label.parent).or_default().push(label);
        }
        let mut tree = Self::default();
        let mut open = below.remove(&None).unwrap_or_default();
        while let Some(label) = open.pop() {
            open.extend(below.remove(&Some(label.id)).unwrap_or_default());
            tree.set(label)?;
        }
        let mut rest = below.values().flatten().map(|label| label.name.as_str());
        let names: Vec<&str> = rest.by_ref().take(MOST_NAMED).collect();
        if names.is_empty() {
            return Ok(tree);
        }
        let more = match rest.count() {
            0 => String::new(),
            count => format!(" and {count} more"),
        };
        Err(MaskError::Label(format!(
            "the parents of these labels do not exist or form a circle: {}{more}",
            names.join(", ")
        )))
    }
}

fn repeated_id(labels: &[Label]) -> Option<LabelId> {
    let mut seen = BTreeSet::new();
    labels
        .iter()
        .map(|label| label.id)
        .find(|&id| !seen.insert(id))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn label(id: u16, name: &str, parent: Option<u16>) -> Label {
        Label {
            id: LabelId(id),
            name: name.into(),
            color: LabelTree::color_for(LabelId(id)),
            parent: parent.map(LabelId),
        }
    }

    fn rice() -> LabelTree {
        vec![
            label(3, "grain", Some(4)),
            label(1, "rice", None),
            label(2, "stem 1", Some(1)),
            label(4, "panicle", Some(1)),
            label(9, "pot", None),
        ]
        .try_into()
        .unwrap()
    }

    #[test]
    fn tree_questions() {
        let tree = rice();
        assert_eq!(tree.name_path(LabelId(3)), "rice › panicle › grain");
        assert_eq!(tree.name_path(LabelId(77)), "");
        assert_eq!(tree.descendants(LabelId(1)), [2, 4, 3].map(LabelId));
        assert_eq!(
            tree.children(None)
                .map(|label| label.id.0)
                .collect::<Vec<_>>(),
            [1, 9]
        );
        assert!(tree.is_ancestor(LabelId(1), LabelId(3)));
        assert!(!tree.is_ancestor(LabelId(3), LabelId(3)));
        assert!(!tree.is_ancestor(LabelId(9), LabelId(3)));
        assert_eq!(tree.at_level(LabelId(3), 1), LabelId(1));
        assert_eq!(tree.at_level(LabelId(3), 2), LabelId(4));
        assert_eq!(tree.at_level(LabelId(9), 2), LabelId(9));
        assert_eq!(tree.depth(LabelId::NONE), 0);
    }

    #[test]
    fn changes_keep_the_invariants() {
        let mut tree = rice();
        tree.rename(LabelId(2), "culm").unwrap();
        tree.recolor(LabelId(2), [1, 2, 3]).unwrap();
        tree.reparent(LabelId(4), Some(LabelId(9))).unwrap();
        assert_eq!(tree.name_path(LabelId(3)), "pot › panicle › grain");
        assert_eq!(tree.get(LabelId(2)).unwrap().color, [1, 2, 3]);
        let before = tree.clone();
        assert!(tree.rename(LabelId(2), "rice").is_err());
        assert!(tree.rename(LabelId(2), " ").is_err());
        assert!(
            tree.reparent(LabelId(9), Some(LabelId(3))).is_err(),
            "a circle"
        );
        assert!(tree.reparent(LabelId(9), Some(LabelId(9))).is_err());
        assert!(tree.reparent(LabelId(9), Some(LabelId(50))).is_err());
        assert!(tree.remove(LabelId(9)).is_err(), "it has children");
        assert!(tree.set(label(0, "nothing", None)).is_err());
        assert_eq!(tree, before);
    }

    #[test]
    fn the_highest_id_taken_does_not_shadow_a_label() {
        let mut tree = rice();
        assert_eq!(tree.next_id(), LabelId(10));
        tree.set(label(u16::MAX, "last", None)).unwrap();
        assert_eq!(tree.next_id(), LabelId(5));
    }

    #[test]
    fn broken_lists_are_refused_when_read() {
        let text = serde_json::to_string(&rice()).unwrap();
        assert_eq!(serde_json::from_str::<LabelTree>(&text).unwrap(), rice());
        for broken in [
            vec![label(1, "a", Some(2)), label(2, "b", Some(1))],
            vec![label(1, "a", Some(1))],
            vec![label(1, "a", Some(7))],
            vec![label(1, "a", None), label(1, "b", None)],
            vec![label(1, "a", None), label(2, "a", None)],
            vec![label(0, "a", None)],
        ] {
            let text = serde_json::to_string(&broken).unwrap();
            assert!(serde_json::from_str::<LabelTree>(&text).is_err(), "{text}");
        }
    }

    #[test]
    fn toml_holds_a_readable_list() {
        #[derive(Serialize, Deserialize, PartialEq, Debug)]
        struct File {
            labels: LabelTree,
        }
        let text = toml::to_string(&File { labels: rice() }).unwrap();
        assert!(
            text.starts_with("[[labels]]\nid = 1\nname = \"rice\"\n"),
            "{text}"
        );
        assert_eq!(toml::from_str::<File>(&text).unwrap().labels, rice());
    }
}
