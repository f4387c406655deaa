use egui::{Color32, Context, CornerRadius, Margin, Stroke, Style, Theme, ThemePreference, Vec2};

use super::Prefs;

/// Theme and size of the interface that were applied last.
pub(super) struct AppliedLook {
    theme: ThemePreference,
    scale: f32,
}

impl Default for AppliedLook {
    fn default() -> Self {
        Self {
            theme: ThemePreference::default(),
            scale: 1.0,
        }
    }
}

impl AppliedLook {
    /// Applies preferences that changed, and takes over what egui's own keys or memory changed.
    pub(super) fn follow(&mut self, ctx: &Context, prefs: &mut Prefs) {
        if prefs.theme == self.theme {
            prefs.theme = ctx.options(|options| options.theme_preference);
        } else {
            ctx.set_theme(prefs.theme);
        }
        self.theme = prefs.theme;
        if prefs.scale == self.scale {
            prefs.scale = ctx.zoom_factor();
        } else {
            ctx.set_zoom_factor(prefs.scale);
        }
        self.scale = prefs.scale;
    }
}

/// Sets the dark and light theme: muted greys, one accent colour, uniform spacing.
pub fn set_theme(ctx: &Context) {
    ctx.style_mut_of(Theme::Dark, |style| {
        spacing(style);
        dark(style);
    });
    ctx.style_mut_of(Theme::Light, |style| {
        spacing(style);
        light(style);
    });
}

fn spacing(style: &mut Style) {
    let spacing = &mut style.spacing;
    spacing.item_spacing = Vec2::new(6.0, 5.0);
    spacing.button_padding = Vec2::new(7.0, 2.0);
    spacing.interact_size.y = 20.0;
    spacing.window_margin = Margin::same(16);
    spacing.menu_margin = Margin::same(6);
    spacing.scroll = egui::style::ScrollStyle::thin();
    let visuals = &mut style.visuals;
    for widget in [
        &mut visuals.widgets.noninteractive,
        &mut visuals.widgets.inactive,
        &mut visuals.widgets.hovered,
        &mut visuals.widgets.active,
        &mut visuals.widgets.open,
    ] {
        widget.corner_radius = CornerRadius::same(4);
        widget.expansion = 0.0;
    }
    visuals.window_corner_radius = CornerRadius::same(8);
    visuals.menu_corner_radius = CornerRadius::same(6);
    visuals.slider_trailing_fill = true;
    visuals.indent_has_left_vline = false;
}

fn dark(style: &mut Style) {
    let visuals = &mut style.visuals;
    let grey = Color32::from_gray;
    visuals.panel_fill = Color32::from_rgb(30, 31, 34);
    visuals.window_fill = Color32::from_rgb(37, 38, 42);
    visuals.extreme_bg_color = Color32::from_rgb(19, 20, 22);
    visuals.faint_bg_color = Color32::from_rgb(38, 39, 43);
    visuals.window_stroke = Stroke::new(1.0, grey(60));
    visuals.selection.bg_fill = Color32::from_rgb(36, 84, 148);
    visuals.selection.stroke = Stroke::new(1.0, Color32::from_rgb(225, 236, 250));
    visuals.hyperlink_color = Color32::from_rgb(104, 166, 245);
    visuals.widgets.noninteractive.bg_stroke = Stroke::new(1.0, grey(50));
    visuals.widgets.noninteractive.fg_stroke.color = grey(205);
    visuals.widgets.inactive.fg_stroke.color = grey(215);
    visuals.widgets.inactive.weak_bg_fill = Color32::from_rgb(52, 54, 59);
    visuals.widgets.inactive.bg_fill = Color32::from_rgb(58, 60, 66);
    visuals.widgets.hovered.weak_bg_fill = Color32::from_rgb(66, 68, 75);
    visuals.widgets.hovered.bg_stroke = Stroke::new(1.0, grey(95));
    visuals.weak_text_color = Some(grey(160));
    visuals.error_fg_color = Color32::from_rgb(255, 120, 110);
}

fn light(style: &mut Style) {
    let visuals = &mut style.visuals;
    let grey = Color32::from_gray;
    visuals.panel_fill = grey(246);
    visuals.window_fill = grey(252);
    visuals.extreme_bg_color = Color32::from_rgb(226, 228, 232);
    visuals.text_edit_bg_color = Some(grey(255));
    visuals.faint_bg_color = grey(236);
    visuals.window_stroke = Stroke::new(1.0, grey(205));
    visuals.selection.bg_fill = Color32::from_rgb(160, 200, 248);
    visuals.selection.stroke = Stroke::new(1.0, Color32::from_rgb(10, 45, 90));
    visuals.hyperlink_color = Color32::from_rgb(20, 90, 190);
    visuals.widgets.noninteractive.bg_stroke = Stroke::new(1.0, grey(212));
    visuals.widgets.noninteractive.fg_stroke.color = grey(50);
    visuals.widgets.inactive.fg_stroke.color = grey(40);
    visuals.widgets.inactive.weak_bg_fill = grey(226);
    visuals.widgets.hovered.weak_bg_fill = grey(214);
    // The ground of a control that has the keyboard, from which its ring has to stand out.
    visuals.widgets.active.weak_bg_fill = grey(196);
    visuals.weak_text_color = Some(grey(92));
    visuals.warn_fg_color = Color32::from_rgb(145, 75, 0);
    visuals.error_fg_color = Color32::from_rgb(190, 30, 30);
}

#[cfg(test)]
mod tests {
    use egui::Visuals;
    use ostra_view::contrast;

    use super::*;
    use crate::focus_ring::ring_color;

    fn of(theme: Theme) -> Visuals {
        let ctx = Context::default();
        set_theme(&ctx);
        ctx.style_of(theme).visuals.clone()
    }

    fn rgb(color: Color32) -> [u8; 3] {
        assert_eq!(color.a(), 255, "the colour is opaque");
        [color.r(), color.g(), color.b()]
    }

    fn grounds(visuals: &Visuals) -> [Color32; 5] {
        [
            visuals.panel_fill,
            visuals.window_fill,
            visuals.extreme_bg_color,
            visuals.faint_bg_color,
            visuals.text_edit_bg_color(),
        ]
    }

    #[test]
    fn text_is_readable_on_every_ground() {
        for theme in [Theme::Dark, Theme::Light] {
            let visuals = of(theme);
            let texts = [
                ("text", visuals.text_color()),
                ("weak text", visuals.weak_text_color()),
                ("strong text", visuals.strong_text_color()),
                ("link", visuals.hyperlink_color),
                ("warning", visuals.warn_fg_color),
                ("error", visuals.error_fg_color),
            ];
            for (name, text) in texts {
                for ground in grounds(&visuals) {
                    let found = contrast(rgb(text), rgb(ground));
                    assert!(found >= 4.5, "{theme:?}: {name} on {ground:?}: {found}");
                }
            }
        }
    }

    #[test]
    fn texts_of_buttons_and_of_the_selection_are_readable() {
        for theme in [Theme::Dark, Theme::Light] {
            let visuals = of(theme);
            let widgets = &visuals.widgets;
            let pairs = [
                widgets.inactive,
                widgets.hovered,
                widgets.active,
                widgets.open,
            ]
            .map(|state| (state.fg_stroke.color, state.weak_bg_fill));
            let selection = visuals.selection;
            for (text, ground) in pairs
                .into_iter()
                .chain([(selection.stroke.color, selection.bg_fill)])
            {
                let found = contrast(rgb(text), rgb(ground));
                assert!(found >= 4.5, "{theme:?}: {text:?} on {ground:?}: {found}");
            }
        }
    }

    #[test]
    fn focus_ring_stands_out_from_what_is_around_it() {
        for theme in [Theme::Dark, Theme::Light] {
            let visuals = of(theme);
            let ring = rgb(ring_color(&visuals));
            let states = &visuals.widgets;
            let buttons = [states.inactive, states.active].map(|state| state.weak_bg_fill);
            for ground in grounds(&visuals).into_iter().chain(buttons) {
                let found = contrast(ring, rgb(ground));
                assert!(found >= 3.0, "{theme:?}: on {ground:?}: {found}");
            }
        }
    }
}
