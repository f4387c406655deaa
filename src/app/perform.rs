use egui::{Context, ThemePreference, ViewportCommand};
use ostra_project::SegmenterId;

use super::canvas::{Tool, clear_label, click_at, label_extent, step_size};
use super::dialogs::RelocateForm;
use super::dialogs::{HelpPage, IntoRequest, PathRequest, choose_path, typed_path};
use super::panels::{InspectedPoint, add_label, listed, next_worst, pairs_in};
use super::player::toggle_play;
use super::ranges::{is_range_change, range_request, set_range, split_at};
use super::view_state::SceneAction;
use super::{Action, Dialog, Panes, SessionView, Severity, ViewState};
use ostra_masks::Direction;
use ostra_project::{FuseRequest, ReconstructRequest};
use ostra_session::{AttachRequest, CleanRequest, CloudChange, Command};
use ostra_view::Layer;

/// Performs an action: changes the view, or issues commands.
pub(super) fn perform(
    action: Action,
    ctx: &Context,
    session: &SessionView<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
) {
    if !action.is_available(session, view) {
        return;
    }
    if let Some(dialog) = dialog_of(action, session, view) {
        view.dialog = Some(dialog);
        view.relocate = RelocateForm::of(&session.project.frames);
        view.clear_path();
        view.new_project.reopen();
        if let Dialog::Path(request @ (PathRequest::OpenProject | PathRequest::InspectPly)) = dialog
        {
            choose_path(view, request);
        }
        return;
    }
    if let Some(frame) = destination(action, session, view) {
        view.go_to(frame);
        return;
    }
    match action {
        Action::Example => view.wants_example = true,
        Action::Close => out.push(Command::Close),
        Action::Quit => ctx.send_viewport_cmd(ViewportCommand::Close),
        Action::Undo => step(view, Command::Undo, out),
        Action::Redo => step(view, Command::Redo, out),
        Action::Stop => out.push(Command::Stop),
        Action::Cancel => cancel(view),
        Action::ToggleTheme => toggle_theme(ctx, view),
        Action::TogglePlay => toggle_play(ctx, session, view),
        _ if is_range_change(action) => {
            out.extend(range_request(action, session, view).map(Command::Range));
        }
        other => edit(other, ctx, session, view, out),
    }
}

/// Performs an action on labels, masks or points of the cloud, or any other one.
fn edit(
    action: Action,
    ctx: &Context,
    session: &SessionView<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
) {
    match action {
        Action::AddLabel => add_label(session, view, out),
        Action::ChooseLabel(number) => choose_label(session, view, number),
        Action::PreviousLabel => {
            view.label = view.labels.previous(&session.project.labels);
        }
        Action::IncludeHere => click_here(session, view, true, out),
        Action::ExcludeHere => click_here(session, view, false, out),
        Action::ClearLabelHere => clear_label(session, view, out),
        Action::ClearFrame => out.push(Command::ClearMask { frame: view.frame }),
        Action::MakeKeyframe => out.push(Command::MakeKeyframe { frame: view.frame }),
        Action::AcceptVote => out.push(Command::AcceptVote {
            frame: view.frame,
            labels: Vec::new(),
        }),
        Action::AcceptLabelVote => {
            out.push(Command::AcceptVote {
                frame: view.frame,
                labels: view.label.into_iter().collect(),
            });
        }
        Action::ChoosePoints => choose_points(view),
        Action::AssignChosen => {
            let change = view.label.map(CloudChange::Assign);
            out.extend(change.and_then(|change| view.scene_select.correct(change)));
        }
        Action::ClearChosen => out.extend(view.scene_select.correct(CloudChange::Clear)),
        Action::AttachFragments => out.push(Command::Attach(AttachRequest::default())),
        Action::RangeFrom | Action::RangeTo | Action::DropRange => set_range(action, view),
        Action::CopyMask => view.copied = view.label.map(|label| (label, view.frame)),
        Action::ZoomToLabel => zoom_to_label(session, view),
        Action::FillHoles => tidy(view, view.prefs.tidy_px, 0, out),
        Action::RemoveIslands => tidy(view, 0, view.prefs.tidy_px, out),
        other => start(other, ctx, session, view, out),
    }
}

/// Performs an action that starts a computation, or one that changes the tools or the view.
fn start(
    action: Action,
    ctx: &Context,
    session: &SessionView<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
) {
    match action {
        Action::Track => out.push(Command::Track(view.track.clone())),
        Action::TrackForward => track_from_here(view, Direction::Forward, out),
        Action::TrackBackward => track_from_here(view, Direction::Backward, out),
        Action::Retrack => out.extend(view.retracking(session).map(Command::Track)),
        Action::Suggest => out.push(Command::Suggest),
        Action::Propose => out.push(Command::Propose {
            frame: view.frame,
            segmenter: SegmenterId::Sam,
        }),
        Action::Reconstruct => reconstruct(view, out),
        Action::SetScale => {
            // The points stay, so that the line shows the true length once the scale is set.
            out.extend(view.ruler.command());
        }
        Action::FindInScene => find_in_scene(session, view),
        Action::SmallerBrush if view.tool == Tool::Click => step_size(session, view, false, out),
        Action::LargerBrush if view.tool == Tool::Click => step_size(session, view, true, out),
        Action::Fuse => {
            let onto = typed_path(&view.onto_text);
            out.push(Command::Fuse(FuseRequest {
                onto,
                ..view.fuse.clone()
            }));
        }
        other => look_differently(other, ctx, view),
    }
}

fn choose_points(view: &mut ViewState) {
    view.scene_select.in_hand = !view.scene_select.in_hand;
    show_scene(view);
}

/// Shows the 3-D view if it is hidden.
fn show_scene(view: &mut ViewState) {
    if view.prefs.panes == Panes::Image {
        view.prefs.panes = Panes::Both;
    }
}

fn find_in_scene(session: &SessionView<'_>, view: &mut ViewState) {
    let (Some(cloud), Some(votes), Some(at_px)) = (session.cloud, session.votes, view.pointer_px)
    else {
        return;
    };
    view.inspected_point = InspectedPoint::seen_at(cloud, votes, view.frame, at_px);
    match view.inspected_point {
        Some(_) => {
            show_scene(view);
            view.scene_action = Some(SceneAction::ShowInspected);
        }
        None => view.note = "No point of the cloud is visible here".into(),
    }
}

fn reconstruct(view: &mut ViewState, out: &mut Vec<Command>) {
    match pairs_in(&view.pairs_text) {
        Ok(pairs) => out.push(Command::Reconstruct(ReconstructRequest {
            pairs,
            ..view.reconstruct.clone()
        })),
        Err(wrong) => view.notices.tell(Severity::Error, wrong),
    }
}

fn dialog_of(action: Action, session: &SessionView<'_>, view: &ViewState) -> Option<Dialog> {
    Some(match action {
        Action::MergeRange => Dialog::Into(IntoRequest {
            label: view.label?,
            range: view.frames_meant(),
            piece: None,
        }),
        Action::SplitRange => {
            let piece = Some((view.frame, split_at(session, view)?));
            Dialog::Into(IntoRequest {
                label: view.label?,
                range: view.frames_meant(),
                piece,
            })
        }
        Action::NewProject => Dialog::NewProject,
        Action::AddFrames => Dialog::AddFrames,
        Action::Relocate => Dialog::Relocate,
        Action::Export => Dialog::Export,
        Action::Models => Dialog::Models,
        Action::GoToFrame => Dialog::GoToFrame,
        Action::Palette => Dialog::Palette,
        Action::Preferences => Dialog::Preferences,
        Action::ShortcutSheet => Dialog::Shortcuts,
        Action::Guide => Dialog::Help(HelpPage::Guide),
        Action::WhatsNew => Dialog::Help(HelpPage::News),
        Action::ReportProblem => Dialog::Help(HelpPage::Report),
        Action::About => Dialog::Help(HelpPage::About),
        Action::Open => Dialog::Path(PathRequest::OpenProject),
        Action::Inspect => Dialog::Path(PathRequest::InspectPly),
        Action::ImportMasks => Dialog::Path(PathRequest::ImportMasks),
        Action::SaveImage => Dialog::Image,
        Action::SaveRecipe => Dialog::Path(PathRequest::SaveRecipe),
        _ => return None,
    })
}

/// Returns the frame that a navigation action leads to.
fn destination(action: Action, session: &SessionView<'_>, view: &ViewState) -> Option<usize> {
    let last = session.project.frames.len().checked_sub(1)?;
    Some(match action {
        Action::PreviousFrame => view.frame.saturating_sub(1),
        Action::NextFrame => (view.frame + 1).min(last),
        Action::Back10 => view.frame.saturating_sub(10),
        Action::Forward10 => (view.frame + 10).min(last),
        Action::FirstFrame => 0,
        Action::LastFrame => last,
        Action::NextUncertain => view.frames.review.next_after(view.frame)?,
        Action::NextWorst => next_worst(session.conflicts, view.frame).unwrap_or(view.frame),
        _ => return None,
    })
}

fn look_differently(action: Action, ctx: &Context, view: &mut ViewState) {
    match action {
        Action::UseTool(tool) => {
            view.draft.drop_half_made();
            view.tool = tool;
        }
        Action::SmallerBrush => view.prefs.brush_px = (view.prefs.brush_px / 1.2).max(0.5),
        Action::LargerBrush => view.prefs.brush_px = (view.prefs.brush_px * 1.2).min(500.0),
        Action::ToggleSnap => view.prefs.snap = !view.prefs.snap,
        Action::Fit => view.zoom.scale = None,
        Action::ActualSize => actual_size(ctx, view),
        Action::ToggleMasks => view.masks_shown = !view.masks_shown,
        Action::CompareBefore => view.compare = !view.compare,
        Action::ToggleTimeline => view.prefs.timeline = !view.prefs.timeline,
        Action::ToggleMatches => view.matches.open = !view.matches.open,
        Action::ToggleMeasures => view.measures.open = !view.measures.open,
        Action::ToggleHover => view.prefs.hover_preview = !view.prefs.hover_preview,
        Action::NextLayer => {
            let next = Layer::ALL
                .iter()
                .position(|&layer| layer == view.layer)
                .map_or(0, |at| at + 1);
            view.layer = Layer::ALL[next % Layer::ALL.len()];
        }
        Action::ToggleOutlines => view.prefs.outlines = !view.prefs.outlines,
        Action::FocusMenu => view.focuses_menu = true,
        Action::OnlyLabel => view.only_label = !view.only_label,
        Action::ShowBoth => view.prefs.panes = Panes::Both,
        Action::ShowImage => view.prefs.panes = Panes::Image,
        Action::ShowScene => view.prefs.panes = Panes::Scene,
        Action::TogglePanels => toggle_panels(view),
        Action::MovePanel => view.prefs.panel_on_left = !view.prefs.panel_on_left,
        Action::SwapPanes => view.prefs.arrangement.swap(),
        Action::StackPanes => view.prefs.arrangement.turn(),
        Action::FrameCloud => view.scene_action = Some(SceneAction::FrameAll),
        Action::FrameCameras => view.scene_action = Some(SceneAction::FrameCameras),
        Action::LookThrough => {
            view.prefs.scene.orthographic = false;
            view.scene_action = Some(SceneAction::LookThrough);
        }
        Action::LookFrom(side) => view.scene_action = Some(SceneAction::LookFrom(side)),
        Action::ToggleOrthographic => {
            view.prefs.scene.orthographic = !view.prefs.scene.orthographic;
        }
        Action::ToggleTurntable => view.scene.turning = !view.scene.turning,
        _ => {}
    }
}

fn toggle_panels(view: &mut ViewState) {
    view.steps.is_bare = !view.steps.is_bare;
    if view.steps.is_bare {
        view.note = "Panels are hidden; View › Layout › Hide panels shows them again".into();
    }
}

fn actual_size(ctx: &Context, view: &mut ViewState) {
    if view.zoom.scale.is_none() {
        let middle_px = view.canvas_map.map(|map| map.middle_px());
        view.zoom.centre_px = view.pointer_px.or(middle_px).unwrap_or_default();
    }
    view.zoom.scale = Some(1.0 / ctx.pixels_per_point());
}

fn zoom_to_label(session: &SessionView<'_>, view: &mut ViewState) {
    if let (Some(map), Some(part)) = (view.canvas_map, label_extent(session, view)) {
        view.zoom.show(&map, part);
    }
}

fn step(view: &mut ViewState, command: Command, out: &mut Vec<Command>) {
    view.draft.drop_half_made();
    view.draft.forget_sent();
    out.push(command);
}

fn choose_label(session: &SessionView<'_>, view: &mut ViewState, number: u8) {
    let rows = listed(&session.project.labels);
    if let Some(row) = rows.get(usize::from(number.saturating_sub(1))) {
        view.label = Some(row.label.id);
    }
}

fn click_here(
    session: &SessionView<'_>,
    view: &mut ViewState,
    include: bool,
    out: &mut Vec<Command>,
) {
    if let Some(at_px) = view.pointer_px {
        click_at(session, view, at_px, include, out);
    }
}

fn tidy(view: &ViewState, holes_below_px: usize, islands_below_px: usize, out: &mut Vec<Command>) {
    if let Some(label) = view.label {
        out.push(Command::Clean(CleanRequest {
            frame: view.frame,
            label,
            holes_below_px,
            islands_below_px,
        }));
    }
}

fn track_from_here(view: &ViewState, direction: Direction, out: &mut Vec<Command>) {
    let mut settings = view.track.clone();
    settings.direction = direction;
    match direction {
        Direction::Forward => settings.from = Some(view.frame),
        Direction::Backward => settings.to = Some(view.frame),
        Direction::Both => {}
    }
    out.push(Command::Track(settings));
}

/// Handles Esc: cancels a drawing or selection in progress, else closes a window.
///
/// It never stops a job, because minutes of work could be lost.
fn cancel(view: &mut ViewState) {
    if view.draft.drop_half_made() || view.scene_select.cancel() {
        return;
    }
    if view.matches.open {
        view.matches.open = false;
    } else if view.measures.open {
        view.measures.open = false;
    }
}

fn toggle_theme(ctx: &Context, view: &mut ViewState) {
    view.prefs.theme = match ctx.theme() {
        egui::Theme::Dark => ThemePreference::Light,
        egui::Theme::Light => ThemePreference::Dark,
    };
}
