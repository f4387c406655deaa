use egui::{DragValue, TextEdit, Ui};

use super::segmenter::engine_choice_ui;
use crate::tips::field;
use crate::{Look, ViewState};
use ostra_session::EngineKind;

/// Sides of pictures that can be chosen, in pixels.
const SIDES: std::ops::RangeInclusive<u32> = 256..=8192;

/// How cameras are found and on which pixels: what is recognised in pictures, which pairs are compared, the size.
pub(super) fn finding_ui(ui: &mut Ui, look: &Look<'_>, view: &mut ViewState) {
    egui::Grid::new("finding").num_columns(2).spacing([8.0, 6.0]).show(ui, |ui| {
        let request = &mut view.reconstruct;
        field(ui, "Features", "What is recognised again in other pictures", |ui| {
            engine_choice_ui(ui, "features", look.engines_of(EngineKind::Features), &mut request.features);
        });
        field(ui, "Matching", "How it is recognised again", |ui| {
            engine_choice_ui(ui, "matcher", look.engines_of(EngineKind::Matcher), &mut request.matcher);
        });
        field(ui, "Pieces", "How pieces of an RGB-D recording that nothing else ties together are joined", |ui| {
            registration_ui(ui, &mut request.registration);
        });
        let tip = "Larger pictures are worked on at this size; automatic = 3200 px for cameras, 1600 px for depths";
        field(ui, "Longest side", tip, |ui| side_ui(ui, &mut request.max_side));
        let tip = "Frames that show the same and are compared in any case, for example 0,12 3,40";
        field(ui, "Pairs", tip, |ui| {
            let text = TextEdit::singleline(&mut view.pairs_text).hint_text("0,12 3,40").desired_width(150.0);
            ui.add(text).on_hover_text(tip).accessible_name("Pairs");
        });
    });
    if let Err(wrong) = pairs_in(&view.pairs_text) {
        ui.colored_label(ui.visuals().error_fg_color, wrong);
    }
    ui.checkbox(&mut view.reconstruct.only_labelled, "Only labelled pixels")
        .on_hover_text("Leaves out what has no label: a background that moves, behind a turntable");
}

fn registration_ui(ui: &mut Ui, chosen: &mut String) {
    const WAYS: [(&str, &str, &str); 3] = [
        ("auto", "Automatic", "One way after the other"),
        (
            "fgr",
            "FGR",
            "Fast Global Registration: one robust fit to all matches",
        ),
        ("ransac", "RANSAC", "The best of many fits to a few matches"),
    ];
    let text = WAYS
        .iter()
        .find(|row| row.0 == *chosen)
        .map_or(chosen.as_str(), |row| row.1)
        .to_owned();
    egui::ComboBox::from_id_salt("registration")
        .selected_text(text)
        .width(150.0)
        .show_ui(ui, |ui| {
            for (value, text, tip) in WAYS {
                ui.selectable_value(chosen, value.to_owned(), text)
                    .on_hover_text(tip);
            }
        });
}

fn side_ui(ui: &mut Ui, max_side: &mut Option<u32>) {
    let mut full = max_side.is_none();
    if ui.checkbox(&mut full, "Automatic").changed() {
        *max_side = (!full).then_some(1600);
    }
    if let Some(side) = max_side {
        ui.add(DragValue::new(side).range(SIDES).suffix(" px"));
    }
}

/// The pairs of frames that a text names, `0,12 3,40`; else what is wrong with it.
pub(crate) fn pairs_in(text: &str) -> Result<Vec<[usize; 2]>, String> {
    let pair = |word: &str| {
        let (first, second) = word.split_once(',')?;
        Some([first.parse().ok()?, second.parse().ok()?])
    };
    let read =
        |word| pair(word).ok_or_else(|| format!("'{word}' is no pair of frames; write 0,12 3,40"));
    text.split_whitespace().map(read).collect()
}

#[cfg(test)]
mod tests {
    use super::pairs_in;

    #[test]
    fn pairs_are_read_and_the_first_wrong_word_is_named() {
        assert_eq!(pairs_in(""), Ok(vec![]));
        assert_eq!(pairs_in("0,12  3,40"), Ok(vec![[0, 12], [3, 40]]));
        assert!(pairs_in("0,12 3-40 x").unwrap_err().contains("'3-40'"));
        assert!(pairs_in("0,1x").unwrap_err().contains("'0,1x'"));
    }
}
