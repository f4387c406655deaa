use egui::{CursorIcon, Response, Ui};

use crate::Look;
use ostra_masks::{Label, LabelId, LabelTree};
use ostra_session::Command;

/// A label's row can be dragged onto another one, whose part it becomes; never onto itself or what is below it.
pub(super) fn drag_ui(
    ui: &Ui,
    look: &Look<'_>,
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
    let tree = &look.project.labels;
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

/// While a label is dragged that is a part of another: where it becomes a label of the top level.
pub(super) fn top_level_ui(ui: &mut Ui, look: &Look<'_>, out: &mut Vec<Command>) {
    let tree = &look.project.labels;
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

/// The command that moves a label; `None` where it is there already.
fn moved(tree: &LabelTree, id: LabelId, parent: Option<LabelId>) -> Option<Command> {
    let label = tree.get(id).filter(|label| label.parent != parent)?;
    Some(Command::EditLabel(Label {
        parent,
        ..label.clone()
    }))
}
