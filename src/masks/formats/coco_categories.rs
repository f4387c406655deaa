//! Mapping from the categories of a COCO file to labels.

use std::collections::{BTreeMap, BTreeSet};

use super::coco_json::{Category, Id};
use super::label_import::{LabelImport, Newcomer};
use crate::{LabelId, MAX_DEPTH, MaskError};

/// Labels of a file's categories.
pub(super) struct CategoryLabels<'c> {
    /// Label by category id.
    pub labels: BTreeMap<&'c Id, LabelId>,
    /// Decisions that the user should know about.
    pub warnings: Vec<String>,
}

/// Categories of a file by name.
struct Categories<'c>(BTreeMap<&'c str, Vec<&'c Category>>);

/// Finds or adds the label of every used category.
///
/// Ancestors are added first. A category is identified by its name. When the file or the project
/// has that name under another parent, it is identified by name and parent.
///
/// # Errors
/// [`MaskError::Label`] when two different categories share an id, or no label id is free.
pub(super) fn import_categories<'c>(
    categories: &[&'c Category],
    used: &BTreeSet<&Id>,
    label_import: &mut LabelImport,
) -> Result<CategoryLabels<'c>, MaskError> {
    let mut by_id: BTreeMap<&Id, &Category> = BTreeMap::new();
    let mut by_name = Categories(BTreeMap::new());
    for category in categories {
        match by_id.insert(&category.id, category) {
            Some(other) if (&other.name, above(other)) == (&category.name, above(category)) => {
                continue;
            }
            Some(other) => {
                return Err(MaskError::Label(format!(
                    "the category id {} is listed for '{}' and for '{}'; give each category its own id",
                    category.id, other.name, category.name
                )));
            }
            None => by_name.0.entry(&category.name).or_default().push(category),
        }
    }
    let mut found = CategoryLabels {
        labels: BTreeMap::new(),
        warnings: Vec::new(),
    };
    // Follows the file's order, so that the first of several categories of one name gets the plain
    // name.
    for category in categories
        .iter()
        .filter(|category| used.contains(&category.id))
    {
        let label =
            by_name.label_import(category, &mut Vec::new(), label_import, &mut found.warnings)?;
        found.labels.insert(&category.id, label);
    }
    let labels = &found.labels;
    let of_one_name = by_name.0.values().filter(|twins| twins.len() > 1);
    found
        .warnings
        .extend(of_one_name.filter_map(|twins| describe_twins(twins, labels, label_import)));
    Ok(found)
}

impl<'c> Categories<'c> {
    /// Returns the label of a category, adding it and its ancestors where needed.
    ///
    /// `below` holds the names of the categories below this one, to end cycles.
    fn label_import(
        &self,
        category: &'c Category,
        below: &mut Vec<&'c str>,
        label_import: &mut LabelImport,
        warnings: &mut Vec<String>,
    ) -> Result<LabelId, MaskError> {
        below.push(&category.name);
        let mut parent = None;
        if let Some(above) =
            above(category).filter(|above| !below.contains(above) && below.len() < MAX_DEPTH)
        {
            parent = Some(match self.0.get(above).and_then(|listed| listed.first()) {
                Some(listed) => self.label_import(listed, below, label_import, warnings)?,
                None => label_import.named(&Newcomer {
                    name: &one_line(above),
                    id: None,
                    parent: None,
                    color: None,
                })?,
            });
        }
        let plain = one_line(&category.name);
        let known = label_import
            .tree()
            .by_name(&plain)
            .map(|known| (known.id, known.parent));
        let name = match known {
            Some((id, its_parent)) if its_parent == parent => return Ok(id),
            Some((_, its_parent))
                if self.is_ambiguous(category) || (its_parent.is_some() && parent.is_some()) =>
            {
                qualified(&plain, category)
            }
            Some((id, _)) => {
                if let Some(above) = above(category).filter(|_| parent.is_some()) {
                    let path = label_import.tree().name_path(id);
                    warnings.push(format!(
                        "the category '{plain}' under '{above}' was taken as the label '{path}'"
                    ));
                }
                return Ok(id);
            }
            None => match qualified(&plain, category) {
                qualified
                    if self.is_ambiguous(category)
                        && label_import.tree().by_name(&qualified).is_some() =>
                {
                    qualified
                }
                _ => plain,
            },
        };
        let id = category.id.number().map(LabelId);
        label_import.named(&Newcomer {
            name: &name,
            id,
            parent,
            color: category.color,
        })
    }

    /// Returns whether another category has the same name under another supercategory.
    fn is_ambiguous(&self, category: &Category) -> bool {
        let twins = self.0.get(category.name.as_str()).into_iter().flatten();
        twins.into_iter().any(|twin| above(twin) != above(category))
    }
}

/// Returns the name of the supercategory; `None` at the top level.
fn above(category: &Category) -> Option<&str> {
    let above = category.supercategory.as_deref()?;
    (above != category.name && !above.is_empty() && above != "none").then_some(above)
}

fn qualified(name: &str, category: &Category) -> String {
    match above(category) {
        Some(above) => format!("{name} ({})", one_line(above)),
        None => format!("{name} (category {})", category.id),
    }
}

/// Replaces line breaks, because label names have one line.
fn one_line(name: &str) -> String {
    name.replace(['\n', '\r'], " ")
}

/// Describes which labels several used categories of one name became.
fn describe_twins(
    twins: &[&Category],
    labels: &BTreeMap<&Id, LabelId>,
    label_import: &LabelImport,
) -> Option<String> {
    let used: Vec<LabelId> = twins
        .iter()
        .filter_map(|twin| labels.get(&twin.id).copied())
        .collect();
    if used.len() < 2 {
        return None;
    }
    let different: BTreeSet<LabelId> = used.iter().copied().collect();
    let paths: Vec<String> = different
        .iter()
        .take(10)
        .map(|&id| format!("'{}'", label_import.tree().name_path(id)))
        .collect();
    let (count, name, paths) = (used.len(), &twins[0].name, paths.join(", "));
    Some(match different.len() {
        1 => format!("{count} categories are named '{name}' and became one label, {paths}"),
        _ => format!("{count} categories are named '{name}' and became the labels {paths}"),
    })
}
