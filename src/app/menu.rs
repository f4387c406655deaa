use egui::{Button, MenuBar, Ui};
use ostra_project::{EngineName, SegmenterId};

use super::action::Requests;
use super::panels::has_chosen;
use super::ranges::{is_range_change, range_request, split_at};
use super::tooltips::action_button;
use super::{Action, MenuName, SessionView, ViewState};
use ostra_session::{Command, EngineKind, JobTask};

/// Draws the menu bar from the list of actions, with undo and redo at its end.
pub(super) fn menu_bar_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &ViewState,
    requests: &mut Requests,
) {
    MenuBar::new().ui(ui, |ui| {
        for menu in MenuName::ALL {
            ui.menu_button(menu.text(), |ui| {
                menu_ui(ui, menu, session, view, requests);
            });
        }
        ui.separator();
        undo_redo_ui(ui, session, view, &mut requests.actions);
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            if theme_button_ui(ui, view).clicked() {
                requests.actions.push(Action::ToggleTheme);
            }
            ui.weak(title(session));
        });
    });
}

/// Returns the name of the open project or point cloud.
pub(super) fn title(session: &SessionView<'_>) -> String {
    let open = session
        .root
        .or(session.inspected)
        .and_then(|path| path.file_name());
    open.map(|name| name.to_string_lossy().into_owned())
        .unwrap_or_default()
}

/// Returns `true` if an action can be performed now.
pub(super) fn is_possible(action: Action, session: &SessionView<'_>, view: &ViewState) -> bool {
    use Action as A;
    match action {
        A::AddFrames | A::ImportMasks | A::SaveRecipe => session.root.is_some(),
        A::Example => view.has_example && session.running(&JobTask::Example).is_none(),
        A::Relocate => session.has_frames(),
        A::Close => session.root.is_some() || session.inspected.is_some(),
        A::SaveImage => session.points().is_some(),
        A::Export => session.root.is_some() || session.cloud.is_some(),
        A::Stop => !session.jobs.is_empty(),
        A::Undo => session.undo.is_some(),
        A::Redo => session.redo.is_some(),
        A::AddLabel => session.root.is_some(),
        A::FillHoles | A::RemoveIslands => {
            view.label.is_some() && session.project.masks.contains_key(&view.frame)
        }
        A::MakeKeyframe | A::ClearFrame => session.project.masks.contains_key(&view.frame),
        A::AcceptVote => session.conflicts.contains_key(&view.frame),
        A::AcceptLabelVote => view.label.is_some() && session.conflicts.contains_key(&view.frame),
        A::FindInScene => {
            view.pointer_px.is_some() && session.cloud.is_some() && session.votes.is_some()
        }
        A::NextWorst => session
            .conflicts
            .values()
            .any(|conflict| conflict.against > 0),
        A::ToggleMeasures => session.cloud.is_some() || view.measures.open,
        A::IncludeHere | A::ExcludeHere => view.pointer_px.is_some(),
        A::ClearLabelHere => view.label.is_some() && session.has_frames(),
        A::RangeFrom | A::RangeTo => session.has_frames(),
        A::DropRange => view.range.is_some(),
        A::MergeRange => view.label.is_some() && session.project.labels.iter().nth(1).is_some(),
        A::SplitRange => {
            split_at(session, view).is_some() && session.project.labels.iter().nth(1).is_some()
        }
        A::CopyMask => view
            .label
            .is_some_and(|label| view.frames.presence.on_frame(view.frame).contains(&label)),
        A::ChoosePoints | A::AttachFragments => session.votes.is_some(),
        A::AssignChosen => has_chosen(session, view) && view.label.is_some(),
        A::ClearChosen => has_chosen(session, view),
        A::CompareBefore | A::ToggleTimeline | A::ToggleMatches => session.has_frames(),
        _ if is_range_change(action) => range_request(action, session, view).is_some(),
        A::Track | A::TrackForward | A::TrackBackward | A::Suggest => {
            !session.project.masks.is_empty()
        }
        A::Propose => session.has_frames() && is_sam_installed(session),
        A::Retrack => view.retracking(session).is_some(),
        A::Fuse | A::LookThrough => session
            .project
            .frames
            .iter()
            .any(|frame| frame.posed_camera().is_some()),
        A::SetScale => view.ruler.command().is_some(),
        A::NextUncertain => view.frames.review.next_after(view.frame).is_some(),
        A::Reconstruct | A::Fit | A::ActualSize => session.has_frames(),
        A::TogglePanels | A::SwapPanes | A::StackPanes | A::MovePanel => {
            session.has_frames() || session.inspected.is_some()
        }
        A::PreviousFrame
        | A::NextFrame
        | A::Back10
        | A::Forward10
        | A::FirstFrame
        | A::LastFrame
        | A::GoToFrame => session.has_frames(),
        A::TogglePlay => session.project.frames.len() > 1,
        _ => true,
    }
}

/// Returns `true` if Segment Anything is installed.
fn is_sam_installed(session: &SessionView<'_>) -> bool {
    session
        .engines_of(EngineKind::Segmenter)
        .any(|engine| engine.name == SegmenterId::Sam.name() && engine.installed)
}

/// Returns the current text of an action. Undo and redo include the name of the step.
pub(super) fn text_now(action: Action, session: &SessionView<'_>) -> String {
    let step = match action {
        Action::Undo => session.undo,
        Action::Redo => session.redo,
        _ => None,
    };
    step.map_or_else(|| action.text(), |step| format!("{} {step}", action.text()))
}

fn menu_ui(
    ui: &mut Ui,
    menu: MenuName,
    session: &SessionView<'_>,
    view: &ViewState,
    requests: &mut Requests,
) {
    ui.set_min_width(220.0);
    for action in Action::all().filter(|action| action.menu() == Some(menu)) {
        if action.starts_group() {
            ui.separator();
        }
        let keys = view.prefs.shortcuts.text(ui.ctx(), action);
        let button = Button::new(text_now(action, session)).shortcut_text(keys);
        if ui
            .add_enabled(is_possible(action, session, view), button)
            .on_hover_text(action.tip())
            .clicked()
        {
            requests.actions.push(action);
        }
        if action == Action::Open {
            recent_ui(ui, session, &mut requests.commands);
        }
    }
}

fn recent_ui(ui: &mut Ui, session: &SessionView<'_>, out: &mut Vec<Command>) {
    ui.add_enabled_ui(!session.recent.is_empty(), |ui| {
        ui.menu_button("Open recent", |ui| {
            for path in session.recent.iter().take(10) {
                if ui
                    .button(path.display().to_string())
                    .on_hover_text("Open this project")
                    .clicked()
                {
                    out.push(Command::Open(path.clone()));
                }
            }
        });
    });
}

/// Draws the theme button, a half-filled disc.
fn theme_button_ui(ui: &mut Ui, view: &ViewState) -> egui::Response {
    let tip = view.prefs.shortcuts.tip(ui.ctx(), Action::ToggleTheme);
    let (rect, response) = ui.allocate_exact_size(egui::vec2(22.0, 20.0), egui::Sense::click());
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, "Dark or light"));
    let color = ui.style().interact(&response).text_color();
    let (at, radius) = (rect.center(), 5.5);
    ui.painter()
        .circle_stroke(at, radius, egui::Stroke::new(1.3, color));
    let half = (-8..=8)
        .map(|k| at + radius * egui::Vec2::angled(std::f32::consts::FRAC_PI_2 * k as f32 / 8.0));
    ui.painter().add(egui::Shape::convex_polygon(
        half.collect(),
        color,
        egui::Stroke::NONE,
    ));
    response.on_hover_text(tip)
}

fn undo_redo_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &ViewState,
    actions: &mut Vec<Action>,
) {
    for (action, text) in [(Action::Undo, "Undo"), (Action::Redo, "Redo")] {
        let response = action_button(
            ui,
            &view.prefs.shortcuts,
            action,
            text,
            is_possible(action, session, view),
        );
        if response
            .on_hover_text(text_now(action, session))
            .accessible_name(action.text())
            .clicked()
        {
            actions.push(action);
        }
    }
}
