use egui::text::CCursorRange;
use egui::text_edit::TextEditState;
use egui::{CursorIcon, Id, Key, Response, TextEdit, Ui};

use crate::tooltips::add_explained;
use crate::{SessionView, ViewState};
use ostra_cloud::instances::InstanceOptions;
use ostra_masks::{Label, LabelId, LabelTree};
use ostra_session::{Command, InstancesRequest};

/// Draws the row for a new label below the list.
pub(super) fn new_label_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
) {
    let parent = view
        .labels
        .parent
        .and_then(|id| session.project.labels.get(id));
    let hint = parent.map_or("New label".into(), |parent| {
        format!("New label under {}", parent.name)
    });
    let parent = parent.map(|parent| parent.name.clone());
    ui.horizontal(|ui| {
        let add_width = 46.0;
        let width = ui.available_width() - add_width - ui.spacing().item_spacing.x;
        let edit = TextEdit::singleline(&mut view.labels.new_name)
            .hint_text(&hint)
            .desired_width(width);
        let edit = ui
            .add(edit)
            .on_hover_text("Name of the new label; press Enter to add it")
            .accessible_name("New label name");
        // A name that was typed before the image is pressed is meant for what is drawn there.
        let is_pane_pressed = ui.input(|i| {
            let at = i.pointer.interact_pos().filter(|_| i.pointer.any_pressed());
            at.is_some_and(|at| view.panes_rect.contains(at))
        });
        let entered =
            edit.lost_focus() && (is_pane_pressed || ui.input(|i| i.key_pressed(Key::Enter)));
        let typed = !view.labels.new_name.trim().is_empty();
        let reason = (!typed).then_some("Type a name first");
        let tip = "Add the label and select it (Enter)";
        let add = add_explained(ui, egui::Button::new("Add"), tip, reason);
        if typed && (entered || add.clicked()) {
            let name = std::mem::take(&mut view.labels.new_name).trim().to_owned();
            view.labels.parent = None;
            let known = session.project.labels.by_name(&name);
            if let Some(known) = known.filter(|_| is_pane_pressed) {
                view.label = Some(known.id);
                return;
            }
            view.label = Some(session.project.labels.next_id());
            out.push(Command::AddLabel {
                name,
                parent,
                color: None,
            });
        }
    });
}

/// Draws a text field for the label being renamed; returns `false` for other labels.
pub(super) fn rename_ui(
    ui: &mut Ui,
    view: &mut ViewState,
    out: &mut Vec<Command>,
    label: &Label,
) -> bool {
    let Some((id, text)) = &mut view.labels.renaming else {
        return false;
    };
    if *id != label.id {
        return false;
    }
    // An id of its own: one by position would change with the other widgets of the row, and the field
    // would lose the keyboard.
    let edit = TextEdit::singleline(text)
        .id(Id::unique(("new name", label.id)))
        .desired_width(f32::INFINITY);
    let edit = ui.add(edit);
    let edit = edit.accessible_name(format!("New name of {}", label.name));
    if std::mem::take(&mut view.labels.focus) {
        edit.request_focus();
        select_all(ui, &edit, text);
    } else if edit.lost_focus() {
        let name = text.trim().to_owned();
        let given_up = ui.input(|i| i.key_pressed(Key::Escape));
        if !given_up && !name.is_empty() && name != label.name {
            out.push(Command::EditLabel(Label {
                name,
                ..label.clone()
            }));
        }
        view.labels.renaming = None;
    }
    true
}

/// Selects the whole text of a field, so that typing replaces it.
fn select_all(ui: &Ui, edit: &Response, text: &str) {
    let mut state = TextEditState::load(ui.ctx(), edit.id).unwrap_or_default();
    let all = CCursorRange::select_all_str(text);
    state.cursor.set_char_range(Some(all));
    state.store(ui.ctx(), edit.id);
}

/// Draws the context menu of a label.
pub(super) fn label_menu_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
    label: &Label,
) {
    if ui
        .button("Rename")
        .on_hover_text("Rename the label (double-click)")
        .clicked()
    {
        view.labels.rename(label.id, &label.name);
    }
    if ui
        .button("Add child label")
        .on_hover_text("Add the next new label as a child of this one")
        .clicked()
    {
        view.labels.parent = Some(label.id);
    }
    if ui
        .button("Show only this label")
        .on_hover_text("Select the label and hide the other masks on the image")
        .clicked()
    {
        view.label = Some(label.id);
        view.only_label = true;
    }
    ui.menu_button("Move under", |ui| move_ui(ui, session, out, label))
        .response
        .on_hover_text("Make the label a child of another label");
    let merge = ui.menu_button("Merge into", |ui| {
        let into = chosen_ui(ui, &session.project.labels, |other| other.id != label.id);
        out.extend(into.map(|into| Command::MergeLabels {
            label: label.id,
            into,
        }));
    });
    merge
        .response
        .on_hover_text("Turn all its pixels, prompts and points into another label");
    let can_find = session.root.is_some() && session.cloud.is_some();
    let reason = (!can_find).then_some("Fuse first: instances are found in the cloud");
    let tip = "Split this class into instances by connected points in 3-D";
    if add_explained(ui, egui::Button::new("Find instances"), tip, reason).clicked() {
        view.instances = Some(InstancesRequest {
            label: label.id,
            options: InstanceOptions::default(),
        });
    }
    ui.separator();
    let has_children = session
        .project
        .labels
        .iter()
        .any(|other| other.parent == Some(label.id));
    let tip = "Remove the label and its prompts; its pixels become unlabelled (can be undone)";
    let reason = has_children.then_some("Remove or move its child labels first");
    if add_explained(ui, egui::Button::new("Remove"), tip, reason).clicked() {
        out.push(Command::RemoveLabel(label.id));
    }
}

fn move_ui(ui: &mut Ui, session: &SessionView<'_>, out: &mut Vec<Command>, label: &Label) {
    let tree = &session.project.labels;
    let reason = label
        .parent
        .is_none()
        .then_some("The label is at the top level already");
    let top = egui::Button::new("Top level");
    if add_explained(ui, top, "Move the label out of its parent", reason).clicked() {
        out.push(Command::EditLabel(Label {
            parent: None,
            ..label.clone()
        }));
    }
    let is_allowed =
        |other: &Label| Some(other.id) != label.parent && !tree.path(other.id).contains(&label.id);
    let parent = chosen_ui(ui, tree, is_allowed);
    out.extend(parent.map(|parent| {
        Command::EditLabel(Label {
            parent: Some(parent),
            ..label.clone()
        })
    }));
}

/// Draws a button for each allowed label and returns the one clicked.
fn chosen_ui(
    ui: &mut Ui,
    tree: &LabelTree,
    is_allowed: impl Fn(&Label) -> bool,
) -> Option<LabelId> {
    let mut chosen = None;
    egui::ScrollArea::vertical()
        .max_height(320.0)
        .show(ui, |ui| {
            for ListedLabel { label: other, .. } in listed(tree) {
                if is_allowed(&other) && ui.button(&other.name).clicked() {
                    chosen = Some(other.id);
                }
            }
        });
    chosen
}

/// Lets a row be dragged onto another one, to become its child.
///
/// Dropping a label onto itself or a descendant is not possible.
pub(super) fn drag_ui(
    ui: &Ui,
    session: &SessionView<'_>,
    out: &mut Vec<Command>,
    row: &Response,
    label: &Label,
) {
    row.dnd_set_drag_payload(label.id);
    let Some(dragged) = row.dnd_hover_payload::<LabelId>() else {
        return;
    };
    if *dragged == label.id {
        return;
    }
    let tree = &session.project.labels;
    if !can_be_below(tree, *dragged, label.id) {
        ui.ctx().set_cursor_icon(CursorIcon::NotAllowed);
        return;
    }
    let stroke = egui::Stroke::new(1.5, ui.visuals().selection.stroke.color);
    ui.painter()
        .rect_stroke(row.rect, 3.0, stroke, egui::StrokeKind::Inside);
    if row.dnd_release_payload::<LabelId>().is_some() {
        out.extend(moved(tree, *dragged, Some(label.id)));
    }
}

/// Draws a drop area for the top level while a child label is dragged.
pub(super) fn top_level_ui(ui: &mut Ui, session: &SessionView<'_>, out: &mut Vec<Command>) {
    let tree = &session.project.labels;
    let dragged = egui::DragAndDrop::payload::<LabelId>(ui.ctx());
    let is_part = |id: &LabelId| tree.get(*id).is_some_and(|label| label.parent.is_some());
    if !dragged.is_some_and(|id| is_part(&id)) {
        return;
    }
    let place = ui.add(egui::Button::new("Drop here for the top level").wrap());
    if let Some(dragged) = place.dnd_release_payload::<LabelId>() {
        out.extend(moved(tree, *dragged, None));
    }
}

fn can_be_below(tree: &LabelTree, id: LabelId, parent: LabelId) -> bool {
    !tree.path(parent).contains(&id)
}

/// Returns the command that moves a label; `None` if it already has this parent.
fn moved(tree: &LabelTree, id: LabelId, parent: Option<LabelId>) -> Option<Command> {
    let label = tree.get(id).filter(|label| label.parent != parent)?;
    Some(Command::EditLabel(Label {
        parent,
        ..label.clone()
    }))
}

/// Row of the label list.
pub(crate) struct ListedLabel {
    pub label: Label,
    /// Number of labels above it in the tree; 0 = top.
    pub depth: usize,
    /// Position in the list, counted from 0.
    pub number: usize,
}

/// Returns all labels in the order of the label list and of the keys 1–9.
///
/// Children come after their parent.
pub(crate) fn listed(tree: &LabelTree) -> Vec<ListedLabel> {
    let mut rows = Vec::new();
    push_children(tree, None, 0, &mut rows);
    rows
}

fn push_children(
    tree: &LabelTree,
    parent: Option<LabelId>,
    depth: usize,
    rows: &mut Vec<ListedLabel>,
) {
    for label in tree.iter().filter(|label| label.parent == parent) {
        rows.push(ListedLabel {
            label: label.clone(),
            depth,
            number: rows.len(),
        });
        push_children(tree, Some(label.id), depth + 1, rows);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn children_are_listed_after_their_parent() {
        let mut tree = LabelTree::default();
        for (id, parent) in [(1, None), (2, None), (3, Some(1)), (4, Some(3))] {
            let parent = parent.map(LabelId);
            tree.set(Label {
                id: LabelId(id),
                name: format!("l{id}"),
                color: [0; 3],
                parent,
            })
            .unwrap();
        }
        let rows: Vec<_> = listed(&tree)
            .into_iter()
            .map(|row| (row.label.id.0, row.depth))
            .collect();
        assert_eq!(rows, [(1, 0), (3, 1), (4, 2), (2, 0)]);
    }
}
