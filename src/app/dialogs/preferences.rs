use egui::{ComboBox, Slider, ThemePreference, Ui};

use super::models::provider_ui;
use super::sheet::{listen, shortcuts_ui};
use crate::tooltips::{add_explained, field, modal};
use crate::{Dialog, Prefs, ViewState};

/// Sizes of the interface that can be chosen, relative to the one that the system asks for.
const SCALES: [f32; 8] = [0.75, 0.9, 1.0, 1.1, 1.25, 1.5, 1.75, 2.0];

const THEMES: [(ThemePreference, &str, &str); 3] = [
    (
        ThemePreference::System,
        "System",
        "Use the theme of the system",
    ),
    (ThemePreference::Dark, "Dark", "Light text on a dark ground"),
    (
        ThemePreference::Light,
        "Light",
        "Dark text on a light ground",
    ),
];

/// Draws the preferences: a page of settings and a page of shortcuts.
///
/// Each takes effect at once and is stored when the window closes.
pub(crate) fn preferences_ui(ui: &Ui, view: &mut ViewState) {
    let on_shortcuts = view.dialog == Some(Dialog::Shortcuts);
    if on_shortcuts {
        listen(ui.ctx(), view);
    }
    let width = (ui.ctx().content_rect().width() - 80.0).min(720.0);
    let response = modal(ui, "preferences", width, |ui| {
        ui.horizontal(|ui| {
            ui.heading("Preferences");
            ui.add_space(12.0);
            for (page, text, tip) in [
                (Dialog::Preferences, "General", "Theme, size, previews"),
                (Dialog::Shortcuts, "Shortcuts", "Keys of all actions"),
            ] {
                let is_shown = view.dialog == Some(page);
                let tab = ui.selectable_label(is_shown, text).on_hover_text(tip);
                if tab.clicked() {
                    view.dialog = Some(page);
                }
            }
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                let close = ui.button("Close").on_hover_text("Close the window (Esc)");
                if close.clicked() {
                    view.dialog = None;
                }
            });
        });
        ui.add_space(6.0);
        if on_shortcuts {
            shortcuts_ui(ui, view);
        } else {
            general_ui(ui, view);
        }
    });
    if response.should_close() && !view.sheet.is_listening() {
        view.dialog = None;
    }
    if view.dialog != Some(Dialog::Shortcuts) {
        view.sheet = Default::default();
    }
}

fn general_ui(ui: &mut Ui, view: &mut ViewState) {
    egui::Grid::new("preferences")
        .num_columns(2)
        .spacing([24.0, 10.0])
        .show(ui, |ui| {
            let prefs = &mut view.prefs;
            field(ui, "Theme", "Colours of the window", |ui| {
                for (theme, text, tip) in THEMES {
                    ui.selectable_value(&mut prefs.theme, theme, text)
                        .on_hover_text(tip);
                }
            });
            let tip = "Size of texts and controls (Ctrl++, Ctrl+-, Ctrl+0)";
            field(ui, "Interface size", tip, |ui| scale_ui(ui, prefs));
            field(
                ui,
                "Clicks",
                "What the pointer shows over the image",
                |ui| {
                    ui.checkbox(&mut prefs.hover_preview, "Preview the mask of a click")
                        .on_hover_text(
                            "Show the mask that a click at the resting pointer would give",
                        );
                },
            );
            field(ui, "Masks", "How masks are drawn over the image", |ui| {
                ui.checkbox(&mut prefs.outlines, "Outlines")
                    .on_hover_text("Draw a line around every label");
                let slider = Slider::new(&mut prefs.opacity, 0.0..=1.0).show_value(false);
                add_explained(ui, slider, "Opacity of the masks", None)
                    .accessible_name("Opacity of masks");
            });
            let tip = "Labels and steps are at this side of the window";
            field(ui, "Side panel", tip, |ui| {
                for (is_left, text) in [(true, "Left"), (false, "Right")] {
                    ui.selectable_value(&mut prefs.panel_on_left, is_left, text)
                        .on_hover_text(tip);
                }
            });
            field(ui, "Networks", "What networks run on", |ui| {
                provider_ui(ui, view);
                ui.checkbox(&mut view.prefs.offer_networks, "Offer them")
                    .on_hover_text("Offer to install a network where it would help");
            });
            field(ui, "Messages", "Messages outside the window", |ui| {
                ui.checkbox(&mut view.prefs.notify, "At the end of long work")
                    .on_hover_text("Shown while another window is in use");
            });
        });
}

fn scale_ui(ui: &mut Ui, prefs: &mut Prefs) {
    let percent = |scale: f32| format!("{:.0} %", 100.0 * scale);
    let choice = ComboBox::from_id_salt("scale")
        .selected_text(percent(prefs.scale))
        .show_ui(ui, |ui| {
            for scale in SCALES {
                ui.selectable_value(&mut prefs.scale, scale, percent(scale));
            }
        });
    choice
        .response
        .on_hover_text("Size of texts and controls")
        .accessible_name("Interface size");
}
