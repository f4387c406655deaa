use egui::{
    CentralPanel, Context, Event, FocusDirection, Frame, Key, Margin, Panel, ScrollArea, Ui,
    UiBuilder,
};

use super::action::Requests;
use super::centre::{Parts, centre_ui};
use super::dialogs::{
    export_ui, exported_ui, go_to_frame_ui, help_ui, image_ui, into_ui, models_ui, new_project_ui,
    palette_ui, path_ui, preferences_ui, relocate_ui, take_picked,
};
use super::focus_ring::FocusRing;
use super::leave::{Leaving, leaving_ui, waiting_ui};
use super::menu::menu_bar_ui;
use super::notices::notices_ui;
use super::panels::{
    CONTROLS_WIDTH, FILMSTRIP_HEIGHT, HEAT_HEIGHT, ScenePane, cloud_labels_ui, filmstrip_ui,
    heat_ui, instances_ui, jobs_ui, keep_track_valid, labels_ui, matches_ui, play_controls_ui,
    point_ui, selection_ui, status_ui, step_strip_ui, steps_ui, timeline_height, timeline_rows,
    timeline_ui, unfinished_ui, welcome_ui,
};
use super::perform::perform;
use super::player::play;
use super::textures::Textures;
use super::theme::AppliedLook;
use super::tooltips::{icon_button, section_heading};
use super::{Action, Dialog, Prefs, SessionView, ViewState};
use ostra_session::{Command, JobView};
use ostra_view::Orbit;

/// Width of a window below which the side panel is a strip until it is expanded.
const NARROW: f32 = 1000.0;
/// Width of the side panel in a window of common size.
const SIDE_WIDTH: f32 = 232.0;

/// Everything that is drawn, without the session behind it: a view in, commands out.
pub struct Shell {
    /// Window state that is not part of the project.
    pub view: ViewState,
    textures: Textures,
    scene: ScenePane,
    leaving: Leaving,
    look: AppliedLook,
    focus_ring: FocusRing,
    /// Commands that were not issued in a panel.
    requested: Vec<Command>,
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
            leaving: Leaving::default(),
            look: AppliedLook::default(),
            focus_ring: FocusRing::default(),
            requested: Vec::new(),
            took_keys: false,
        }
    }

    /// Resets everything that belongs to the previous project.
    pub fn project_changed(&mut self) {
        self.view.project_changed();
        self.textures.clear();
        self.scene.clear();
    }

    /// Issues a command as if it were chosen in a panel.
    pub(super) fn request(&mut self, command: Command) {
        self.requested.push(command);
    }

    /// Asks before the window is closed while a job runs, also while nothing is drawn.
    pub(super) fn hold_back_quit(&mut self, ctx: &Context, jobs: &[JobView]) {
        self.leaving.hold_back_quit(ctx, jobs);
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
        // A drag over the image must take the keyboard from a text field, as a click does.
        ui.ctx().options_mut(|options| {
            options.input_options.surrender_focus_on = egui::SurrenderFocusOn::Presses;
        });
        let mut requests = Requests::default();
        self.look.follow(ui.ctx(), &mut self.view.prefs);
        self.view.keep_valid(session);
        self.view.labels.follow(self.view.label);
        let flag_below = self.view.prefs.flag_below;
        self.view.frames.update(session, flag_below);
        let style = self.view.overlay_style();
        let masks = &mut self.textures.masks;
        masks.set_looks(&session.project.labels, &style);
        self.view.draft.follow(session.project);
        keep_track_valid(session, &mut self.view);
        take_picked(ui.ctx(), &mut self.view, &mut requests.commands);
        let may_play = session.has_frames()
            && self.view.dialog.is_none()
            && !self.leaving.is_asking()
            && !takes_keys(ui.ctx());
        let masks = &mut self.textures.masks;
        let tapped = play(ui.ctx(), session, &mut self.view, masks, may_play);
        requests.actions.extend(tapped);
        if !self.leaving.is_asking() {
            requests
                .actions
                .extend(pressed(ui.ctx(), session, &self.view, self.took_keys));
        }
        self.bars_ui(ui, session, &mut requests);
        let fill = ui.visuals().panel_fill;
        let panes = CentralPanel::default()
            .frame(Frame::new().fill(fill))
            .show(ui, |ui| {
                self.view.panes_rect = ui.max_rect();
                self.panes_ui(ui, session, &mut requests);
            })
            .response
            .rect;
        self.dialogs_ui(ui, session, &mut requests);
        leaving_ui(ui, session, &mut self.leaving, &mut requests.actions);
        if self.view.matches.open && session.has_frames() {
            matches_ui(ui, session, &mut self.view, &mut self.textures);
        }
        if session.has_frames() && self.view.dialog.is_none() {
            drop_hint_ui(ui);
        }
        notices_ui(ui, &mut self.view.notices, panes);
        self.focus_ring.ui(ui.ctx());
        self.took_keys = takes_keys(ui.ctx());
        let Requests {
            mut commands,
            actions,
        } = requests;
        commands.append(&mut self.requested);
        for action in actions {
            perform(action, ui.ctx(), session, &mut self.view, &mut commands);
        }
        if !commands.is_empty() {
            self.view.playback.pause();
        }
        self.leaving
            .hold_back(ui.ctx(), session.jobs, &mut commands);
        for images in [session.images, session.survey_images]
            .into_iter()
            .flatten()
        {
            images.turn();
        }
        self.textures.masks.turn(ui.ctx());
        commands
    }

    /// Draws what lies around the panes: menu bar, status line, side panel, filmstrip and timeline.
    fn bars_ui(&mut self, ui: &mut Ui, session: &SessionView<'_>, requests: &mut Requests) {
        let bar = Frame::new()
            .fill(ui.visuals().panel_fill)
            .inner_margin(Margin::symmetric(8, 2));
        Panel::top("menu")
            .frame(bar)
            .show(ui, |ui| menu_bar_ui(ui, session, &mut self.view, requests));
        if session.unfinished.is_some() || self.leaving.is_waiting() {
            Panel::top("pending").frame(bar).show(ui, |ui| {
                waiting_ui(ui, &mut self.leaving);
                unfinished_ui(ui, session, &mut self.view, &mut requests.commands);
            });
        }
        Panel::bottom("status").frame(bar).show(ui, |ui| {
            status_ui(ui, session, &self.view, &mut requests.actions);
        });
        if session.has_frames() || session.inspected.is_some() {
            self.side_panel_ui(ui, session, requests);
        }
        if session.has_frames() && !self.view.steps.is_bare {
            self.strips_ui(ui, session, requests);
        }
    }

    /// Draws filmstrip and timeline below the panes.
    fn strips_ui(&mut self, ui: &mut Ui, session: &SessionView<'_>, requests: &mut Requests) {
        let strip = Frame::new()
            .fill(ui.visuals().panel_fill)
            .inner_margin(Margin {
                left: 8,
                right: 8,
                top: 4,
                bottom: 0,
            });
        Panel::bottom("filmstrip")
            .resizable(false)
            .exact_size(FILMSTRIP_HEIGHT + HEAT_HEIGHT)
            .frame(strip)
            .show(ui, |ui| {
                ui.spacing_mut().item_spacing.y = 3.0;
                let place = ui.available_rect_before_wrap();
                let (left, right) = place.split_left_right_at_x(place.left() + CONTROLS_WIDTH);
                let view = &mut self.view;
                ui.scope_builder(UiBuilder::new().max_rect(left), |ui| {
                    play_controls_ui(ui, session, view, &mut requests.actions);
                });
                ui.scope_builder(UiBuilder::new().max_rect(right), |ui| {
                    heat_ui(ui, session, view);
                    filmstrip_ui(ui, session, view, &mut self.textures);
                });
            });
        // The place is kept without labels too, so that the image does not move when they come.
        if self.view.prefs.timeline {
            let labels = session.project.labels.iter().count();
            let window = ui.ctx().content_rect().height();
            let first_rows = &mut self.view.timeline_rows;
            let rows = *first_rows.get_or_insert_with(|| timeline_rows(labels, window));
            let height = timeline_height(rows) + f32::from(strip.inner_margin.top);
            // A height that the user chose is kept for projects with as many rows.
            Panel::bottom(("timeline rows", rows))
                .resizable(true)
                .default_size(height)
                .size_range(timeline_height(1)..=400.0)
                .frame(strip)
                .show(ui, |ui| {
                    timeline_ui(ui, session, &mut self.view, &mut requests.actions);
                });
        }
    }

    /// Draws labels and steps at the side, or a strip of the steps in a narrow window.
    fn side_panel_ui(&mut self, ui: &mut Ui, session: &SessionView<'_>, requests: &mut Requests) {
        let window = ui.ctx().content_rect().width();
        let is_open = !self.view.steps.is_bare;
        let is_strip = window < NARROW && !self.view.steps.is_expanded;
        self.view.steps.is_docked = is_open && !is_strip;
        if !is_open {
            return;
        }
        let is_left = self.view.prefs.panel_on_left;
        let side = |name: &'static str| {
            if is_left {
                Panel::left(name)
            } else {
                Panel::right(name)
            }
        };
        if is_strip {
            side("step strip")
                .resizable(false)
                .exact_size(46.0)
                .show(ui, |ui| {
                    if session.has_frames() {
                        step_strip_ui(ui, session, &mut self.view);
                    }
                });
            return;
        }
        side("side")
            .resizable(true)
            .default_size((window * 0.18).clamp(SIDE_WIDTH, 320.0))
            .size_range(180.0..=460.0)
            .show(ui, |ui| {
                // A setting that is too wide is cut off; it must not widen the panel.
                let rect = ui.available_rect_before_wrap();
                ui.advance_cursor_after_rect(rect);
                let mut inner = ui.new_child(egui::UiBuilder::new().max_rect(rect));
                inner.set_clip_rect(rect.expand(4.0).intersect(ui.clip_rect()));
                self.side_content_ui(&mut inner, session, requests, window < NARROW);
            });
    }

    fn side_content_ui(
        &mut self,
        ui: &mut Ui,
        session: &SessionView<'_>,
        requests: &mut Requests,
        may_shrink: bool,
    ) {
        let view = &mut self.view;
        docked_ui(ui, session, view, requests);
        if !session.has_frames() {
            return cloud_labels_ui(ui, session, view);
        }
        if may_shrink && ui.small_button("Hide panel").clicked() {
            view.steps.is_expanded = false;
        }
        let height = (ui.available_height() * 0.3).clamp(96.0, 220.0);
        Panel::top("labels")
            .resizable(true)
            .default_size(height)
            .size_range(60.0..=600.0)
            .frame(Frame::new())
            .show(ui, |ui| {
                labels_ui(ui, session, view, &mut requests.commands);
            });
        scrolled(ui, "steps", |ui| {
            instances_ui(ui, session, view, &mut requests.commands);
            ui.spacing_mut().item_spacing.y = 4.0;
            steps_ui(ui, session, view, requests);
        });
    }

    /// Draws the image and the 3-D view, or the welcome page if nothing is open.
    fn panes_ui(&mut self, ui: &mut Ui, session: &SessionView<'_>, requests: &mut Requests) {
        if !session.has_frames() && session.inspected.is_none() {
            let (view, textures) = (&mut self.view, &mut self.textures);
            return welcome_ui(ui, session, view, textures, requests);
        }
        let parts = Parts {
            textures: &mut self.textures,
            scene: &mut self.scene,
        };
        centre_ui(ui, session, &mut self.view, parts, requests);
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
            Some(Dialog::Exported) => exported_ui(ui, view),
            Some(Dialog::Image) => image_ui(ui, view),
            Some(Dialog::Models) => models_ui(ui, session, view, &mut requests.commands),
            Some(Dialog::Preferences | Dialog::Shortcuts) => preferences_ui(ui, view),
            Some(Dialog::GoToFrame) => go_to_frame_ui(ui, session, view),
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
fn pressed(
    ctx: &Context,
    session: &SessionView<'_>,
    view: &ViewState,
    took_keys: bool,
) -> Vec<Action> {
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
    // Tab goes from control to control once one has the keyboard, and where no panel can be hidden.
    let is_travelling = ctx.memory(|memory| memory.focused().is_some())
        || !Action::TogglePanels.is_available(session, view);
    let is_steering = |event: &Event| {
        let has_keyboard = view.key_pointer.has_keyboard();
        has_keyboard && matches!(event, Event::Key { key, .. } if is_arrow(*key))
    };
    let action = |event: &Event| {
        let is_tab = matches!(event, Event::Key { key: Key::Tab, .. });
        view.prefs
            .shortcuts
            .action_for(event)
            // Playback starts when its key is released.
            .filter(|&action| action != Action::TogglePlay)
            .filter(|_| !(is_taken(event) || is_tab && is_travelling || is_steering(event)))
    };
    let actions: Vec<Action> = ctx.input(|input| input.events.iter().filter_map(action).collect());
    if actions.contains(&Action::TogglePanels) {
        ctx.memory_mut(|memory| memory.move_focus(FocusDirection::None));
    }
    actions
}

fn is_arrow(key: Key) -> bool {
    matches!(
        key,
        Key::ArrowLeft | Key::ArrowRight | Key::ArrowUp | Key::ArrowDown
    )
}

/// Returns `true` if keys go to a menu, a list or a text field.
fn takes_keys(ctx: &Context) -> bool {
    ctx.text_edit_focused() || ctx.any_popup_open()
}

/// Draws the running jobs, the inspected point and the selection at the bottom of the side panel.
///
/// They cover the end of the steps instead of moving them.
fn docked_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    requests: &mut Requests,
) {
    let panel = |name: &'static str| {
        Panel::bottom(name)
            .resizable(false)
            .frame(Frame::new().inner_margin(Margin::symmetric(0, 6)))
    };
    if session.slow_jobs().next().is_some() {
        panel("running").show(ui, |ui| jobs_ui(ui, session, view, &mut requests.actions));
    }
    if let Some(point) = view.inspected_point.clone() {
        let mut is_open = true;
        panel("point").show(ui, |ui| {
            ui.horizontal(|ui| {
                section_heading(ui, "Point");
                ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                    let close = icon_button(ui, "×", "Close point", "Inspect no point");
                    is_open = !close.clicked();
                });
            });
            point_ui(ui, session, view, &point);
        });
        if !is_open {
            view.inspected_point = None;
        }
    }
    if view.scene_select.in_hand {
        panel("selection").show(ui, |ui| {
            section_heading(ui, "Select points");
            selection_ui(ui, session, view, &mut requests.actions);
        });
    }
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

fn scrolled(ui: &mut Ui, salt: &str, content: impl FnOnce(&mut Ui)) {
    ScrollArea::vertical()
        .id_salt(salt)
        .auto_shrink([false, false])
        .show(ui, content);
}
