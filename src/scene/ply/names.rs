use crate::masks::{Label, LabelId, LabelTree};

/// The comment lines that keep a label tree in a PLY header: `label ID PARENT NAME`, then `color ID RRGGBB`.
pub(in crate::scene) fn comments_of(tree: &LabelTree) -> Vec<String> {
    let names = tree.iter().map(|label| {
        let parent = label.parent.map_or(0, |id| id.0);
        format!("label {} {parent} {}", label.id.0, label.name)
    });
    let colors = tree.iter().map(|label| {
        let [red, green, blue] = label.color;
        format!("color {} {red:02x}{green:02x}{blue:02x}", label.id.0)
    });
    names.chain(colors).collect()
}

/// The label tree kept in a header's comments; lines that are no label or colour are other people's and are left alone.
///
/// A parent that is missing or makes a circle is dropped (the label comes to the top level); a name that is taken gets
/// a stroke.
pub(super) fn tree_from_comments(comments: &[String]) -> LabelTree {
    let mut waiting: Vec<Label> = comments.iter().filter_map(|comment| label_from(comment)).collect();
    let mut tree = LabelTree::default();
    while !waiting.is_empty() {
        let ready = |label: &Label| label.parent.is_none_or(|parent| tree.get(parent).is_some());
        let (now, later): (Vec<Label>, Vec<Label>) = waiting.into_iter().partition(ready);
        waiting = later;
        if now.is_empty() {
            waiting.iter_mut().for_each(|label| label.parent = None);
        }
        now.into_iter().for_each(|label| add(&mut tree, label));
    }
    for (id, color) in comments.iter().filter_map(|comment| color_from(comment)) {
        recolor(&mut tree, id, color);
    }
    tree
}

fn label_from(comment: &str) -> Option<Label> {
    let mut words = comment.strip_prefix("label ")?.splitn(3, ' ');
    let id = LabelId(words.next()?.parse().ok()?);
    let parent: u16 = words.next()?.parse().ok()?;
    let name = words.next()?.trim().to_string();
    let known = id != LabelId::NONE && !name.is_empty();
    known.then(|| Label { id, name, color: LabelTree::color_for(id), parent: (parent != 0).then_some(LabelId(parent)) })
}

fn color_from(comment: &str) -> Option<(LabelId, [u8; 3])> {
    let (id, hex) = comment.strip_prefix("color ")?.split_once(' ')?;
    let hex = hex.trim();
    let value = u32::from_str_radix(hex, 16).ok().filter(|_| hex.len() == 6)?;
    let [_, red, green, blue] = value.to_be_bytes();
    Some((LabelId(id.parse().ok()?), [red, green, blue]))
}

fn add(tree: &mut LabelTree, mut label: Label) {
    if tree.get(label.id).is_some() {
        return;
    }
    while tree.by_name(&label.name).is_some() {
        label.name.push('\'');
    }
    // The invariants hold: parent present, name free, id new and not 0.
    let _ = tree.set(label);
}

fn recolor(tree: &mut LabelTree, id: LabelId, color: [u8; 3]) {
    if let Some(label) = tree.get(id).cloned() {
        let _ = tree.set(Label { color, ..label });
    }
}
