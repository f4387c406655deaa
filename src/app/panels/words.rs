use egui::{Key, Slider, TextEdit, Ui};

use crate::{Look, ViewState};
use ostra_session::{Command, EngineKind, FoundThing, GroundRequest, TakeRequest};

/// Least score that is looked for: the slider leaves more out without looking again.
const LOOKED_FOR: f32 = 0.1;

/// What is typed to look for, and how sure a thing must be to be offered.
#[derive(Debug, Clone, PartialEq)]
pub struct Words {
    text: String,
    /// Least score of a thing that is offered, 0–1.
    pub least: f32,
}

impl Default for Words {
    fn default() -> Self {
        Self {
            text: String::new(),
            least: 0.3,
        }
    }
}

impl Words {
    /// What is to be looked for on a frame; phrases are parted by `;` or `,`.
    fn request(&self, frame: usize) -> Option<Command> {
        let phrases = self
            .text
            .split([';', ','])
            .map(|phrase| phrase.trim().to_owned());
        let phrases: Vec<String> = phrases.filter(|phrase| !phrase.is_empty()).collect();
        let request = GroundRequest {
            frame,
            phrases,
            threshold: Some(LOOKED_FOR),
            grounder: "auto".into(),
        };
        (!request.phrases.is_empty()).then_some(Command::Ground(request))
    }
}

/// The things found by words on the shown frame that are sure enough, with their numbers from 1.
pub(crate) fn offered<'a>(
    look: &Look<'a>,
    view: &ViewState,
) -> impl Iterator<Item = (usize, &'a FoundThing)> + use<'a> {
    let (frame, least) = (view.frame, view.words.least);
    let found = look.grounding.filter(|grounding| grounding.frame == frame);
    let things = found
        .into_iter()
        .flat_map(|grounding| (1..).zip(&grounding.things));
    things.filter(move |(_, thing)| thing.score >= least)
}

/// Words to look for, and what they found: taken one by one or all at once.
pub(crate) fn words_ui(ui: &mut Ui, look: &Look<'_>, view: &mut ViewState, out: &mut Vec<Command>) {
    let installed = look
        .engines_of(EngineKind::Grounder)
        .any(|engine| engine.installed);
    let needs = look
        .engines_of(EngineKind::Grounder)
        .next()
        .map_or("", |engine| engine.needs);
    let ready = installed && look.has_frames() && look.running("Look for words").is_none();
    ui.add_enabled_ui(ready, |ui| {
        ui.horizontal(|ui| {
            let width = (ui.available_width() - 52.0).max(60.0);
            let edit = TextEdit::singleline(&mut view.words.text).hint_text("banana; cup").desired_width(width);
            let tip = "What to look for on this frame; each word becomes a label, each thing an instance of it";
            let edit = ui.add(edit).on_hover_text(tip).on_disabled_hover_text(format!("Needs {needs}"));
            let edit = edit.accessible_name("Words to look for");
            let entered = edit.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter));
            if ui.button("Look").on_hover_text(tip).clicked() || entered {
                out.extend(view.words.request(view.frame));
            }
        });
    });
    if look
        .grounding
        .is_none_or(|grounding| grounding.frame != view.frame)
    {
        return;
    }
    ui.horizontal(|ui| {
        ui.spacing_mut().slider_width = 90.0;
        let slider = Slider::new(&mut view.words.least, LOOKED_FOR..=1.0).show_value(false);
        ui.add(slider)
            .on_hover_text("Only things at least so sure are offered")
            .accessible_name("Least score");
        ui.weak(format!("{:.0} %", 100.0 * view.words.least));
    });
    let found: Vec<(usize, FoundThing)> = offered(look, view)
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
                .small_button("Take")
                .on_hover_text("Makes a label and a mask of it");
            if take
                .accessible_name(format!("Take {} {number}", thing.phrase))
                .clicked()
            {
                out.push(taken(view, [thing]));
            }
        });
    }
    if found.is_empty() {
        ui.weak("Nothing is as sure as that.");
    } else if found.len() > 1
        && ui
            .button("Take all")
            .on_hover_text("Makes a label and a mask of each")
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
        segmenter: view.segmenter.clone(),
    })
}
