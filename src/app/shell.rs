use egui::{CentralPanel, Context, Event, Frame, Key, Margin, Panel, ScrollArea, Stroke, Ui};

use super::action::Requests;
use super::canvas::image_pane_ui;
use super::dialogs::{
    export_ui, help_ui, image_ui, into_ui, models_ui, new_project_ui, palette_ui, path_ui,
    relocate_ui, sheet_ui, take_picked,
};
use super::menu::menu_bar_ui;
use super::notices::notices_ui;
use super::panels::{
    HEAT_HEIGHT, ScenePane, cloud_labels_ui, conflicts_ui, filmstrip_ui, fuse_ui, heat_ui,
    instances_ui, jobs_ui, labels_ui, matches_ui, measures_ui, reconstruct_ui, results_ui,
    segmenter_ui, status_ui, suggestions_ui, text_prompt_ui, timeline_ui, track_ui, welcome_ui,
};
use super::perform::perform;
use super::textures::Textures;
use super::tooltips::section_heading;
use super::{Action, Dialog, Panes, Prefs, SessionView, ViewState};
use ostra_session::Command;
use ostra_view::Orbit;

/// Everything that is drawn, without the session behind it: a view in, commands out.
pub struct Shell {
    /// Window state that is not part of the project.
    pub view: ViewState,
    textures: Textures,
    scene: ScenePane,
    /// Whether keys went to a menu, list or text field when the window was last drawn.
    took_keys: bool,
}

impl Shell {
    /// Creates a shell with stored preferences.
    ///
    /// Without a GPU the 3-D view shows a message that it needs one.
    #[must_use]
    pub fn new(prefs: Prefs, gpu: Option<&egui_wgpu::RenderState>) -> Self {
        let (mut view, textures, scene) = (
            ViewState::new(prefs),
            Textures::default(),
            ScenePane::new(gpu),
        );
        view.adapter = gpu.map(|gpu| gpu.adapter.get_info().name);
        Self {
            view,
            textures,
            scene,
            took_keys: false,
        }
    }

    /// Resets everything that belongs to the previous project.
    pub fn project_changed(&mut self) {
        self.view.project_changed();
        self.textures.clear();
        self.scene.clear();
    }

    /// Multiplies scene lengths by `factor`; the 3-D view keeps showing the same part of the scene.
    pub fn scale_by(&mut self, factor: f64) {
        self.view.scale_by(factor);
        self.scene.scale_by(factor as f32);
    }

    /// Returns the camera of the 3-D view; `None` before there is something to show.
    #[must_use]
    pub fn orbit(&self) -> Option<Orbit> {
        self.scene.orbit()
    }

    /// Draws the whole window and returns the commands that the user issued, in order.
    pub fn ui(&mut self, ui: &mut Ui, session: &SessionView<'_>) -> Vec<Command> {
        let mut requests = Requests::default();
        self.view.keep_valid(session);
        self.view.presence.update(session.project);
        self.view.draft.follow(session.project);
        take_picked(ui.ctx(), &mut self.view, &mut requests.commands);
        requests
            .actions
            .extend(pressed(ui.ctx(), &self.view, self.took_keys));
        self.bars_ui(ui, session, &mut requests);
        if session.has_frames() {
            self.side_panels_ui(ui, session, &mut requests);
        } else if session.inspected.is_some() {
            side_panel(Panel::left("labels"), 256.0)
                .show(ui, |ui| cloud_labels_ui(ui, session, &mut self.view));
        }
        let fill = ui.visuals().panel_fill;
        CentralPanel::default()
            .frame(Frame::new().fill(fill))
            .show(ui, |ui| {
                self.panes_ui(ui, session, &mut requests);
            });
        self.dialogs_ui(ui, session, &mut requests);
        if self.view.matches.open && session.has_frames() {
            matches_ui(ui, session, &mut self.view, &mut self.textures);
        }
        if self.view.measures.open {
            measures_ui(ui, session, &mut self.view);
        }
        if session.has_frames() && self.view.dialog.is_none() {
            drop_hint_ui(ui);
        }
        notices_ui(ui, &mut self.view.notices);
        self.took_keys = takes_keys(ui.ctx());
        let Requests {
            mut commands,
            actions,
        } = requests;
        for action in actions {
            perform(action, ui.ctx(), session, &mut self.view, &mut commands);
        }
        for images in [session.images, session.survey_images]
            .into_iter()
            .flatten()
        {
            images.turn();
        }
        commands
    }

    /// Draws the menu bar at the top, and the status line, filmstrip and timeline at the bottom.
    fn bars_ui(&mut self, ui: &mut Ui, session: &SessionView<'_>, requests: &mut Requests) {
        let bar = Frame::new()
            .fill(ui.visuals().panel_fill)
            .inner_margin(Margin::symmetric(8, 3));
        Panel::top("menu")
            .frame(bar)
            .show(ui, |ui| menu_bar_ui(ui, session, &self.view, requests));
        Panel::bottom("status").frame(bar).show(ui, |ui| {
            status_ui(ui, session, &self.view, &mut requests.actions);
        });
        if session.has_frames() {
            let strip = Frame::new()
                .fill(ui.visuals().panel_fill)
                .inner_margin(Margin {
                    left: 8,
                    right: 8,
                    top: 6,
                    bottom: 2,
                });
            Panel::bottom("filmstrip")
                .resizable(false)
                .exact_size(118.0 + HEAT_HEIGHT)
                .frame(strip)
                .show(ui, |ui| {
                    heat_ui(ui, session, &mut self.view);
                    filmstrip_ui(ui, session, &mut self.view, &mut self.textures);
                });
            if self.view.prefs.timeline && session.project.labels.iter().next().is_some() {
                let grid = Panel::bottom("timeline")
                    .resizable(true)
                    .default_size(112.0)
                    .size_range(64.0..=400.0);
                grid.frame(strip).show(ui, |ui| {
                    timeline_ui(ui, session, &mut self.view, &mut requests.actions);
                });
            }
        }
    }

    fn side_panels_ui(&mut self, ui: &mut Ui, session: &SessionView<'_>, requests: &mut Requests) {
        let view = &mut self.view;
        side_panel(Panel::left("labels"), 256.0).show(ui, |ui| {
            scrolled(ui, "left", |ui| {
                labels_ui(ui, session, view, &mut requests.commands);
                instances_ui(ui, session, view, &mut requests.commands);
                ui.separator();
                segmenter_ui(ui, session, view);
                ui.separator();
                section_heading(ui, "Find by text");
                text_prompt_ui(ui, session, view, &mut requests.commands);
            });
        });
        side_panel(Panel::right("work"), 262.0).show(ui, |ui| {
            scrolled(ui, "right", |ui| {
                section(ui, "Track", true, |ui| {
                    track_ui(ui, session, view, &mut requests.actions);
                });
                if !session.conflicts.is_empty() {
                    section(ui, "Conflicts", true, |ui| {
                        conflicts_ui(ui, session, view, &mut requests.actions);
                    });
                }
                section(ui, "Suggestions", !session.suggestions.is_empty(), |ui| {
                    suggestions_ui(ui, session, view, requests);
                });
                section(ui, "Reconstruct", true, |ui| {
                    reconstruct_ui(ui, session, view, &mut requests.actions);
                });
                section(ui, "Fuse", true, |ui| {
                    fuse_ui(ui, session, view, &mut requests.actions);
                });
                section(ui, "Results", false, |ui| results_ui(ui, session));
                if session.slow_jobs().next().is_some() {
                    section(ui, "Running", true, |ui| {
                        jobs_ui(ui, session, view, &mut requests.actions);
                    });
                }
            });
        });
    }

    /// Draws the image and the 3-D view, or the welcome page if nothing is open.
    fn panes_ui(&mut self, ui: &mut Ui, session: &SessionView<'_>, requests: &mut Requests) {
        let has_scene = session.points().is_some()
            || session
                .project
                .frames
                .iter()
                .any(|frame| frame.posed_camera().is_some());
        match (session.has_frames(), session.inspected.is_some()) {
            (false, false) => {
                let (view, textures) = (&mut self.view, &mut self.textures);
                return welcome_ui(ui, session, view, textures, requests);
            }
            (false, true) => {
                return self.scene.ui(
                    ui,
                    session,
                    &mut self.view,
                    &mut self.textures,
                    &mut requests.actions,
                );
            }
            (true, _) => {}
        }
        let panes = self.view.prefs.panes;
        if panes == Panes::Scene {
            return self.scene.ui(
                ui,
                session,
                &mut self.view,
                &mut self.textures,
                &mut requests.actions,
            );
        }
        if panes == Panes::Both && has_scene {
            let half = ui.available_width() * 0.46;
            let frame = Frame::new().fill(ui.visuals().panel_fill);
            Panel::right("scene")
                .resizable(true)
                .default_size(half)
                .size_range(220.0..=half * 1.8)
                .frame(frame)
                .show(ui, |ui| {
                    self.scene.ui(
                        ui,
                        session,
                        &mut self.view,
                        &mut self.textures,
                        &mut requests.actions,
                    );
                });
        }
        image_pane_ui(ui, session, &mut self.view, &mut self.textures, requests);
    }

    fn dialogs_ui(&mut self, ui: &Ui, session: &SessionView<'_>, requests: &mut Requests) {
        let view = &mut self.view;
        match view.dialog {
            Some(Dialog::NewProject | Dialog::AddFrames) => {
                let textures = &mut self.textures;
                new_project_ui(ui, session, view, textures, &mut requests.commands);
            }
            Some(Dialog::Help(page)) => help_ui(ui, session, view, page),
            Some(Dialog::Relocate) => relocate_ui(ui, view, &mut requests.commands),
            Some(Dialog::Export) => export_ui(ui, session, view, &mut requests.commands),
            Some(Dialog::Image) => image_ui(ui, view),
            Some(Dialog::Models) => models_ui(ui, session, view, &mut requests.commands),
            Some(Dialog::Shortcuts) => sheet_ui(ui, view),
            Some(Dialog::Palette) => palette_ui(ui, session, view, &mut requests.actions),
            Some(Dialog::Into(request)) => {
                into_ui(ui, session, view, request, &mut requests.commands);
            }
            Some(Dialog::Path(request)) => path_ui(ui, view, request, &mut requests.commands),
            None => {}
        }
    }
}

/// Returns the actions whose shortcuts were pressed; none while typing or in a dialog.
///
/// Esc closes a menu or leaves a text field before this code runs. If one had focus when the window
/// was last drawn, that Esc must not cancel anything else.
fn pressed(ctx: &Context, view: &ViewState, took_keys: bool) -> Vec<Action> {
    if view.dialog.is_some() || takes_keys(ctx) {
        return Vec::new();
    }
    let is_taken = |event: &Event| {
        took_keys
            && matches!(
                event,
                Event::Key {
                    key: Key::Escape,
                    ..
                }
            )
    };
    let action = |event: &Event| {
        view.prefs
            .shortcuts
            .action_for(event)
            .filter(|_| !is_taken(event))
    };
    ctx.input(|input| input.events.iter().filter_map(action).collect())
}

/// Returns `true` if keys go to a menu, a list or a text field.
fn takes_keys(ctx: &Context) -> bool {
    ctx.text_edit_focused() || ctx.any_popup_open()
}

/// Covers the window with a hint while files hover over it.
fn drop_hint_ui(ui: &Ui) {
    if ui.input(|input| input.raw.hovered_files.is_empty()) {
        return;
    }
    let id = egui::Id::unique("drop hint");
    let layer = egui::LayerId::new(egui::Order::Foreground, id);
    let (painter, screen) = (ui.ctx().layer_painter(layer), ui.ctx().content_rect());
    painter.rect_filled(screen, 0.0, egui::Color32::from_black_alpha(170));
    painter.text(
        screen.center(),
        egui::Align2::CENTER_CENTER,
        "Drop to create a new project",
        egui::FontId::proportional(22.0),
        egui::Color32::WHITE,
    );
}

fn side_panel(panel: Panel, size: f32) -> Panel {
    panel
        .resizable(true)
        .default_size(size)
        .size_range(180.0..=460.0)
}

fn scrolled(ui: &mut Ui, salt: &str, content: impl FnOnce(&mut Ui)) {
    ScrollArea::vertical()
        .id_salt(salt)
        .auto_shrink([false, false])
        .show(ui, content);
}

/// Adds a collapsible section to a side panel.
///
/// A change of `open` resets whether the section is expanded.
fn section(ui: &mut Ui, title: &str, open: bool, content: impl FnOnce(&mut Ui)) {
    let header = egui::CollapsingHeader::new(egui::RichText::new(title).strong().size(14.0));
    header
        .id_salt((title, open))
        .default_open(open)
        .show_unindented(ui, |ui| {
            ui.add_space(2.0);
            content(ui);
            ui.add_space(6.0);
        });
    let line = ui.visuals().widgets.noninteractive.bg_stroke.color;
    let (rect, _) =
        ui.allocate_exact_size(egui::vec2(ui.available_width(), 1.0), egui::Sense::hover());
    ui.painter().hline(
        rect.x_range(),
        rect.center().y,
        Stroke::new(1.0, line.gamma_multiply(0.7)),
    );
}
