use egui::{Pos2, Response, Ui};

use super::draft::Tool;
use super::map::CanvasMap;
use crate::rest::Rest;
use crate::{Look, ViewState};
use ostra_masks::Click;
use ostra_session::PromptRequest;

/// Wishes to see what an include click would give where the pointer rests.
pub(super) fn follow_pointer(
    ui: &Ui,
    response: &Response,
    map: &CanvasMap,
    look: &Look<'_>,
    view: &mut ViewState,
) {
    view.hover_wish = None;
    let Some(at) = response.hover_pos().filter(|_| may_preview(ui, look, view)) else {
        view.rest = None;
        return;
    };
    if let Some(at) = Rest::follow(&mut view.rest, ui, at) {
        view.hover_wish = wish_at(at, map, look, view);
    }
}

/// Whether a preview helps now: with the click tool, while nothing is drawn, sent or running.
fn may_preview(ui: &Ui, look: &Look<'_>, view: &ViewState) -> bool {
    let busy = !look.jobs.is_empty()
        || view.draft.is_sending()
        || ui.input(|input| input.pointer.any_down());
    view.prefs.hover_preview
        && view.masks_shown
        && view.tool == Tool::Click
        && view.dialog.is_none()
        && !busy
}

fn wish_at(at: Pos2, map: &CanvasMap, look: &Look<'_>, view: &ViewState) -> Option<PromptRequest> {
    let at_px = map.inside(map.to_px(at))?;
    let label = view
        .label
        .filter(|&label| look.project.labels.get(label).is_some())?;
    let mut prompt = view.draft.prompt(look.project, view.frame, label);
    prompt.clicks.push(Click {
        at_px,
        include: true,
    });
    Some(PromptRequest {
        frame: view.frame,
        label,
        prompt,
        segmenter: view.segmenter.clone(),
    })
}
