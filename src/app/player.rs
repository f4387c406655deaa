//! Playback in the window: what starts, drives and pauses it.

use std::collections::BTreeSet;

use egui::Context;

use super::mask_drawings::{MaskDrawings, MaskSize};
use super::playback::PlayList;
use super::{Action, SessionView, ViewState};
use ostra_view::Layer;

/// Returns the frames to play: those of the range, or all.
fn play_list<'a>(session: &SessionView<'a>, view: &'a ViewState) -> PlayList<'a> {
    let last = session.project.frames.len().saturating_sub(1);
    PlayList {
        frames: &session.project.frames,
        range: view
            .range
            .filter(|(from, to)| from < to)
            .unwrap_or((0, last)),
        prefs: view.prefs.playback,
        review: &view.frames.review,
    }
}

/// Starts or pauses playback.
pub(super) fn toggle_play(ctx: &Context, session: &SessionView<'_>, view: &mut ViewState) {
    if view.playback.is_playing() {
        view.playback.pause();
        return;
    }
    let now = ctx.input(|input| input.time);
    let mut playback = std::mem::take(&mut view.playback);
    let first = playback.start(now, &play_list(session, view), view.frame);
    view.go_to(first);
    view.draft.drop_half_made();
    view.playback = playback;
    ctx.request_repaint();
}

/// Shows the frame that is due, and prepares the next ones.
///
/// Returns the action of the play key if it was tapped. `may_start` is `false` while keys go
/// elsewhere.
pub(super) fn play(
    ctx: &Context,
    session: &SessionView<'_>,
    view: &mut ViewState,
    masks: &mut MaskDrawings,
    may_start: bool,
) -> Option<Action> {
    let mut playback = std::mem::take(&mut view.playback);
    let shortcuts = &view.prefs.shortcuts;
    // Space presses the control that has the keyboard.
    let may_start = may_start && ctx.memory(|memory| memory.focused().is_none());
    let is_tapped = ctx.input(|input| {
        let is_free = may_start && !input.pointer.any_down();
        playback.follow_key(&input.events, shortcuts, is_free)
    });
    if view.dialog.is_some() {
        playback.pause();
    }
    if playback.is_playing() {
        let now = ctx.input(|input| input.time);
        let list = play_list(session, view);
        let frames = [vec![view.frame], list.coming(view.frame)].concat();
        let ready = ready(session, view, masks, &frames);
        let has_layer = |frame| {
            let layers = session.layers.filter(|_| view.layer != Layer::Image);
            layers.is_none_or(|layers| layers.get(&(frame, view.layer)).is_some())
        };
        let is_ready = |frame| ready.contains(&frame) && has_layer(frame);
        let frame = playback.advance(now, &list, view.frame, is_ready);
        if let Some(left) = playback.seconds_left(now) {
            ctx.request_repaint_after_secs(left as f32);
        }
        view.show(frame);
    }
    view.playback = playback;
    is_tapped.then_some(Action::TogglePlay)
}

/// Requests the images and masks of frames; returns the frames of which both are ready.
fn ready(
    session: &SessionView<'_>,
    view: &ViewState,
    masks: &mut MaskDrawings,
    frames: &[usize],
) -> BTreeSet<usize> {
    let mut ready = match session.images {
        Some(images) => images.play(frames),
        None => frames.iter().copied().collect(),
    };
    if view.masks_shown {
        let mut lacking = frames.to_vec();
        lacking.retain(|&frame| !masks.request(session.project, MaskSize::Preview, frame));
        lacking.iter().for_each(|frame| {
            ready.remove(frame);
        });
    }
    ready
}
