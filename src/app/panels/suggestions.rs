use egui::{Key, Slider, TextEdit, Ui};
use ostra_session::JobTask;

use super::labels::add_label;
use crate::action::Requests;
use crate::canvas::id_at;
use crate::network_offer::text_offer_ui;
use crate::option_names::in_window_words;
use crate::panel_state::MIN_SHOWN_SCORE;
use crate::tooltips::{action_button, add_explained};
use crate::{Action, SessionView, ViewState};
use ostra_masks::LabelId;
use ostra_session::{Command, EngineKind, FoundThing, Suggestion, TakeRequest};

/// Returns the objects found by text on the shown frame, with their numbers from 1.
///
/// Objects below the minimum score are left out.
pub(crate) fn offered<'a>(
    session: &SessionView<'a>,
    view: &ViewState,
) -> impl Iterator<Item = (usize, &'a FoundThing)> + use<'a> {
    let (frame, least) = (view.frame, view.text_prompt.least);
    let found = session
        .grounding
        .filter(|grounding| grounding.frame == frame);
    let things = found
        .into_iter()
        .flat_map(|grounding| (1..).zip(&grounding.things));
    things.filter(move |(_, thing)| thing.score >= least)
}

/// Draws the search by text and its results, which can be accepted one by one or all at once.
pub(crate) fn text_prompt_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
) {
    let installed = session
        .engines_of(EngineKind::Grounder)
        .any(|engine| engine.installed);
    let needs = session
        .engines_of(EngineKind::Grounder)
        .next()
        .map_or("", |engine| engine.needs);
    let needs = format!("Needs {}", in_window_words(needs));
    let unavailable = if !installed {
        Some(needs.as_str())
    } else if session.running(&JobTask::FindByText).is_some() {
        Some("A search by text is running")
    } else {
        (!session.has_frames()).then_some("Add frames to the project first")
    };
    if text_offer_ui(ui, session, view, out) {
        out.extend(view.text_prompt.request(view.frame));
    }
    ui.horizontal(|ui| {
        let width = (ui.available_width() - 52.0).max(60.0);
        let edit = TextEdit::singleline(&mut view.text_prompt.text)
            .hint_text("banana; cup")
            .desired_width(width);
        let tip = "Objects to find on this frame, separated by ';'; each text becomes a label, each object an instance";
        // A text can be typed while the network is being installed.
        let is_read_only = unavailable.filter(|_| installed);
        let edit = add_explained(ui, edit, tip, is_read_only).accessible_name("Text to find");
        let entered = unavailable.is_none()
            && edit.lost_focus()
            && ui.input(|i| i.key_pressed(Key::Enter));
        let find = add_explained(ui, egui::Button::new("Find"), tip, unavailable);
        if find.clicked() || entered {
            out.extend(view.text_prompt.request(view.frame));
        }
    });
    if session
        .grounding
        .is_none_or(|grounding| grounding.frame != view.frame)
    {
        return;
    }
    ui.horizontal(|ui| {
        ui.spacing_mut().slider_width = 90.0;
        let slider =
            Slider::new(&mut view.text_prompt.least, MIN_SHOWN_SCORE..=1.0).show_value(false);
        ui.add(slider)
            .on_hover_text("Hide results of lower confidence")
            .accessible_name("Minimum score");
        ui.weak(format!("{:.0} %", 100.0 * view.text_prompt.least));
    });
    let found: Vec<(usize, FoundThing)> = offered(session, view)
        .map(|(number, thing)| (number, thing.clone()))
        .collect();
    for (number, thing) in &found {
        ui.horizontal(|ui| {
            ui.label(format!(
                "{number}  {} {:.0} %",
                thing.phrase,
                100.0 * thing.score
            ));
            let take = ui
                .small_button("Add")
                .on_hover_text("Create a label and a mask");
            if take
                .accessible_name(format!("Add {} {number}", thing.phrase))
                .clicked()
            {
                out.push(taken(view, [thing]));
            }
        });
    }
    if found.is_empty() {
        ui.weak("No result above the minimum confidence.");
    } else if found.len() > 1
        && ui
            .button("Add all")
            .on_hover_text("Create a label and a mask for each")
            .clicked()
    {
        out.push(taken(view, found.iter().map(|(_, thing)| thing)));
    }
}

fn taken<'a>(view: &ViewState, things: impl IntoIterator<Item = &'a FoundThing>) -> Command {
    let things = things
        .into_iter()
        .map(|thing| (thing.phrase.clone(), thing.extent))
        .collect();
    Command::TakeFound(TakeRequest {
        frame: view.frame,
        things,
        segmenter: view.segmenter,
    })
}

/// Draws the list of suggested objects, to show them or create labels of them.
pub(crate) fn suggestions_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    requests: &mut Requests,
) {
    let is_running = [JobTask::Suggest, JobTask::Propose]
        .iter()
        .any(|task| session.running(task).is_some());
    ui.horizontal_wrapped(|ui| {
        for (action, text) in [
            (Action::Suggest, "Find unlabelled objects"),
            (Action::Propose, "Propose objects here"),
        ] {
            let reason = action.unavailable(session, view);
            if action_button(ui, &view.prefs.shortcuts, action, text, reason).clicked() {
                requests.actions.push(action);
            }
        }
        if is_running {
            ui.spinner();
        }
    });
    for (number, suggestion) in (1..)
        .zip(session.suggestions)
        .filter(|(_, one)| !is_explained(session, one))
    {
        ui.horizontal(|ui| {
            // The button comes first, because the text may be cut off in a narrow panel.
            let add = ui
                .small_button("Add")
                .on_hover_text("Create a label on that frame; track it from there");
            if add
                .accessible_name(format!("Add suggestion {number}"))
                .clicked()
            {
                let id = session.project.labels.next_id();
                add_label(session, view, &mut requests.commands);
                let prompt = suggestion.prompt(id, view.segmenter);
                requests.commands.push(Command::Prompt(prompt));
                view.go_to(suggestion.frame);
            }
            let show = ui
                .link(format!("{number}  {}", suggestion.text()))
                .on_hover_text("Go to the frame, which shows a box with this number");
            if show
                .accessible_name(format!("Suggestion {number}"))
                .clicked()
            {
                view.go_to(suggestion.frame);
            }
        });
    }
}

/// Returns `true` if the suggested region has a label by now.
pub(crate) fn is_explained(session: &SessionView<'_>, suggestion: &Suggestion) -> bool {
    let mask = session.project.masks.get(&suggestion.frame);
    mask.is_some_and(|mask| id_at(&mask.runs, suggestion.at_px) != LabelId::NONE)
}
