use std::collections::{BTreeMap, BTreeSet};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::MaskError;

/// Identifies a label in masks and clouds; 0 = unlabelled.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Hash,
    Default,
    Serialize,
    Deserialize,
    JsonSchema,
)]
#[serde(transparent)]
pub struct LabelId(pub u16);

impl LabelId {
    /// No label.
    pub const NONE: Self = Self(0);
}

/// A node of the label tree (class › instance › part).
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Label {
    /// Id, never 0.
    pub id: LabelId,
    /// Name: unique in the tree, not empty, no line break.
    pub name: String,
    /// Colour, sRGB.
    pub color: [u8; 3],
    /// Parent label; `None` for the top level.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parent: Option<LabelId>,
}

/// All labels of a project, by id.
///
/// Invariants: names are unique, parents exist, there are no cycles. The tree is serialised as a
/// list of labels; a list that breaks an invariant is rejected.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(into = "Vec<Label>", try_from = "Vec<Label>")]
pub struct LabelTree {
    labels: BTreeMap<LabelId, Label>,
    /// Ids by name.
    ///
    /// Without it, checking one name would compare it with all; files can list 65,535 labels.
    ids: BTreeMap<String, LabelId>,
}

/// Maximum number of labels that an error lists.
const MOST_NAMED: usize = 10;

/// Maximum depth of a label in the tree.
///
/// Every walk to the top level takes as many steps as the label is deep; a file with 65,535 labels
/// in one chain would take minutes.
pub const MAX_DEPTH: usize = 64;

impl LabelTree {
    /// Returns all labels, ordered by id.
    pub fn iter(&self) -> impl Iterator<Item = &Label> {
        self.labels.values()
    }

    /// Returns the label with this id.
    #[must_use]
    pub fn get(&self, id: LabelId) -> Option<&Label> {
        self.labels.get(&id)
    }

    /// Returns the label with this name.
    #[must_use]
    pub fn by_name(&self, name: &str) -> Option<&Label> {
        self.labels.get(self.ids.get(name)?)
    }

    /// Inserts `label`, or replaces the label with the same id.
    ///
    /// # Errors
    /// [`MaskError::Label`] for id 0, an empty or taken name, a missing parent, a cycle, or a depth
    /// above [`MAX_DEPTH`].
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

    /// Removes a label.
    ///
    /// # Errors
    /// [`MaskError::Label`] if the label does not exist or has children.
    pub fn remove(&mut self, id: LabelId) -> Result<Label, MaskError> {
        if let Some(child) = self.labels.values().find(|label| label.parent == Some(id)) {
            return Err(MaskError::Label(format!(
                "label {} still has the child '{}'; remove that first",
                id.0, child.name
            )));
        }
        let label = self.labels.remove(&id).ok_or_else(|| {
            MaskError::Label(format!(
                "there is no label {}; 'ostra info' lists the labels",
                id.0
            ))
        })?;
        self.ids.remove(&label.name);
        Ok(label)
    }

    /// Returns a free id: the one after the highest in use.
    ///
    /// Once 65535 is taken, returns the lowest free id, or [`LabelId::NONE`] (which [`Self::set`]
    /// rejects) if there is none.
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

    /// Returns the labels directly below `parent` (`None` = top level), ordered by id.
    pub fn children(&self, parent: Option<LabelId>) -> impl Iterator<Item = &Label> {
        self.labels
            .values()
            .filter(move |label| label.parent == parent)
    }

    /// Returns all labels below `id`, parents before their children; `id` itself is not included.
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

    /// Returns whether `ancestor` lies above `id`; a label is not its own ancestor.
    #[must_use]
    pub fn is_ancestor(&self, ancestor: LabelId, id: LabelId) -> bool {
        ancestor != id && self.path(id).contains(&ancestor)
    }

    /// Returns the names from the top level down, such as `rice › stem 1`; empty for an unknown id.
    #[must_use]
    pub fn name_path(&self, id: LabelId) -> String {
        let names: Vec<&str> = self
            .path(id)
            .iter()
            .filter_map(|&id| Some(self.get(id)?.name.as_str()))
            .collect();
        names.join(" › ")
    }

    /// Renames a label.
    ///
    /// # Errors
    /// Same as [`Self::set`], and if there is no such label.
    pub fn rename(&mut self, id: LabelId, name: &str) -> Result<(), MaskError> {
        let label = self.known(id)?.clone();
        self.set(Label {
            name: name.to_owned(),
            ..label
        })
    }

    /// Changes the colour of a label (sRGB).
    ///
    /// # Errors
    /// [`MaskError::Label`] if there is no such label.
    pub fn recolor(&mut self, id: LabelId, color: [u8; 3]) -> Result<(), MaskError> {
        let label = self.known(id)?.clone();
        self.set(Label { color, ..label })
    }

    /// Moves a label and everything below it to another parent (`None` = top level).
    ///
    /// # Errors
    /// Same as [`Self::set`], and if there is no such label.
    pub fn reparent(&mut self, id: LabelId, parent: Option<LabelId>) -> Result<(), MaskError> {
        let label = self.known(id)?.clone();
        self.set(Label { parent, ..label })
    }

    /// Returns the depth of a label: 1 = top level; 0 for [`LabelId::NONE`] or an unknown id.
    #[must_use]
    pub fn depth(&self, id: LabelId) -> usize {
        self.path(id).len()
    }

    /// Returns the ids from the top level down to `id`; empty for an unknown id.
    #[must_use]
    pub fn path(&self, id: LabelId) -> Vec<LabelId> {
        let mut path: Vec<LabelId> =
            std::iter::successors(self.get(id), |label| self.get(label.parent?))
                .map(|label| label.id)
                .collect();
        path.reverse();
        path
    }

    /// Returns the ancestor of a label at `level` (1 = top), or the label if it is not deeper.
    #[must_use]
    pub fn at_level(&self, id: LabelId, level: usize) -> LabelId {
        let path = self.path(id);
        if level == 0 || path.len() <= level {
            id
        } else {
            path[level - 1]
        }
    }

    /// Returns a colour for a new label; colours of the first dozens of ids are far apart.
    ///
    /// Magenta, cyan and orange come first: they stand out from plants and soil, which green, brown
    /// and red do not.
    #[must_use]
    pub fn color_for(id: LabelId) -> [u8; 3] {
        const PALETTE: [[u8; 3]; 12] = [
            [230, 60, 200],
            [40, 190, 220],
            [255, 140, 30],
            [120, 100, 255],
            [255, 215, 50],
            [30, 120, 235],
            [200, 130, 255],
            [0, 150, 140],
            [255, 130, 150],
            [165, 105, 55],
            [150, 215, 60],
            [230, 75, 60],
        ];
        let base = PALETTE[usize::from(id.0.wrapping_sub(1)) % PALETTE.len()];
        let dim = 1.0 - 0.17 * f32::from((id.0.wrapping_sub(1) / 12) % 4);
        base.map(|channel| (f32::from(channel) * dim) as u8)
    }

    fn known(&self, id: LabelId) -> Result<&Label, MaskError> {
        self.get(id).ok_or_else(|| {
            MaskError::Label(format!(
                "there is no label {}; 'ostra info' lists the labels",
                id.0
            ))
        })
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

    /// Accepts labels in any order: a child may come before its parent.
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
    fn queries_follow_the_hierarchy() {
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
    fn next_id_is_the_lowest_free_one_once_the_highest_is_taken() {
        let mut tree = rice();
        assert_eq!(tree.next_id(), LabelId(10));
        tree.set(label(u16::MAX, "last", None)).unwrap();
        assert_eq!(tree.next_id(), LabelId(5));
    }

    #[test]
    fn lists_that_break_an_invariant_are_rejected() {
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
    fn toml_is_a_readable_list() {
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
