mod session_contents;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use anyhow::Result;
use egui::{Context, ViewportBuilder, ViewportCommand};

use self::session_contents::view_of;
use super::attention::{Attention, notify_end, title_with_progress};
use super::dialogs::{PathPicker, RecipeTarget};
use super::file_manager::open_folder;
use super::opening::{MakeExample, Opening, example_folder, open_dropped, open_paths};
use super::option_names::in_window_words;
use super::scene_image::write_scene_image;
use super::theme::set_theme;
use super::window_icon::window_icon;
use super::{Layers, Prefs, SessionView, Severity, Shell, layers_of};
use ostra_compute::nn::{ModelStatus, Provider};
use ostra_core::disk;
use ostra_frames::Frame;
use ostra_project::export_targets::ExportTargets;
use ostra_project::{Project, scale_between};
use ostra_session::Event;
use ostra_session::{Command, EngineInfo, Images, Recent, Session, list_engines, list_models};

/// Opens the window.
///
/// `path` is a project, a folder of frames, a video or a labelled PLY to open. `make_example` makes
/// the example project.
///
/// # Errors
/// If the system provides no window or no graphics adapter.
pub fn run(path: Option<PathBuf>, make_example: MakeExample) -> Result<()> {
    let viewport = ViewportBuilder::default()
        .with_title("OSTRA")
        .with_app_id("ostra")
        .with_icon(window_icon())
        .with_inner_size([1440.0, 900.0])
        .with_min_inner_size([720.0, 480.0]);
    let options = eframe::NativeOptions {
        viewport,
        ..eframe::NativeOptions::default()
    };
    let result = eframe::run_native(
        "ostra",
        options,
        Box::new(move |cc| Ok(Box::new(Window::new(cc, path, make_example)))),
    );
    result.map_err(|error| {
        anyhow::anyhow!(
            "no window can be opened ({error}); use the command line, see 'ostra --help'"
        )
    })
}

/// Main window and the session behind it.
pub struct Window {
    session: Session,
    shell: Shell,
    nothing: Arc<Project>,
    images: Option<Images>,
    layers: Option<Layers>,
    shown_frames: Arc<Vec<Frame>>,
    engines: Vec<EngineInfo>,
    models: Vec<ModelStatus>,
    recent: Recent,
    title: String,
    attention: Attention,
    /// Whether the end of long work may be shown by a message of the system.
    notifies: bool,
    /// Folder of the project that the view belongs to.
    open_root: Option<PathBuf>,
    /// Number of changes of the project and its conflicts so far.
    revision: u64,
    opening: Opening,
}

const PREFS: &str = "prefs";

impl Window {
    fn new(
        cc: &eframe::CreationContext<'_>,
        path: Option<PathBuf>,
        make_example: MakeExample,
    ) -> Self {
        set_theme(&cc.egui_ctx);
        let prefs: Prefs = cc
            .storage
            .and_then(|storage| eframe::get_value(storage, PREFS))
            .unwrap_or_default();
        if Provider::chosen() == Provider::default() {
            prefs.provider.choose();
        }
        let mut window = Self::with(
            Shell::new(prefs, cc.wgpu_render_state.as_ref()),
            Recent::load(),
            &cc.egui_ctx,
        );
        window.shell.view.picker = PathPicker::native();
        window.notifies = true;
        if let Some(folder) = example_folder() {
            window.offer_example(folder, make_example);
        }
        let given = path.into_iter().collect();
        if let Some(command) = open_paths(given, &mut window.shell.view) {
            window.act(command);
        }
        window
    }

    /// Creates a window around a shell, with nothing open.
    #[must_use]
    pub fn with(shell: Shell, recent: Recent, ctx: &Context) -> Self {
        let mut session = Session::new();
        let waker = ctx.clone();
        session.set_waker(move || waker.request_repaint());
        Self {
            session,
            shell,
            nothing: Arc::default(),
            images: None,
            layers: None,
            shown_frames: Arc::default(),
            engines: list_engines(),
            models: list_models().unwrap_or_default(),
            recent,
            title: String::new(),
            attention: Attention::default(),
            notifies: false,
            open_root: None,
            revision: 0,
            opening: Opening::new(ctx),
        }
    }

    /// Offers an example project, which is made in `folder`.
    pub fn offer_example(&mut self, folder: PathBuf, make: MakeExample) {
        self.opening.offer_example(folder, make);
    }

    /// Returns the session behind the window.
    #[must_use]
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// Returns the shell that draws the window.
    pub fn shell(&mut self) -> &mut Shell {
        &mut self.shell
    }

    /// Processes the events since the last call; takes little time.
    pub fn poll(&mut self, ctx: &Context) {
        let mut has_noticed = false;
        for event in self.session.poll() {
            // What a job reports at its end says more than that it is done.
            let is_end = matches!(event, Event::Finished { .. });
            let keeps_note = is_end && std::mem::take(&mut has_noticed);
            has_noticed |= matches!(
                event,
                Event::Notice(_) | Event::Exported(_) | Event::Unchanged { .. }
            );
            if self.attention.is_due(&event, Instant::now()) && !ctx.input(|input| input.focused) {
                if self.notifies && self.shell.view.prefs.notify {
                    notify_end(&event, &self.open_name().unwrap_or_default());
                }
                ctx.send_viewport_cmd(ViewportCommand::RequestUserAttention(
                    egui::UserAttentionType::Informational,
                ));
            }
            if !keeps_note {
                self.take(event);
            }
        }
        self.follow_frames(ctx);
        let title = self.window_title();
        if title != self.title {
            ctx.send_viewport_cmd(ViewportCommand::Title(title.clone()));
            self.title = title;
        }
        if let Some(command) = open_dropped(ctx, &mut self.shell.view) {
            self.shell.request(command);
        }
        self.shell.hold_back_quit(ctx, &self.session.jobs());
    }

    /// Draws the window and executes the commands that the user issued.
    pub fn show(&mut self, ui: &mut egui::Ui) {
        let view = &mut self.shell.view;
        self.opening
            .follow(&mut self.session, view, &self.recent, ui.ctx());
        self.session.follow_masks();
        let jobs = self.session.jobs();
        let view = &self.shell.view;
        let before = if view.compare {
            self.session.mask_before(view.frame)
        } else {
            None
        };
        let session = SessionView {
            images: self.images.as_ref(),
            layers: self.layers.as_ref(),
            jobs: &jobs,
            engines: &self.engines,
            models: &self.models,
            recent: self.recent.paths(),
            recent_projects: self.opening.recent_projects(),
            survey: self.opening.survey(),
            survey_images: self.opening.images(),
            before: before.as_ref(),
            revision: self.revision,
            unfinished: self.session.unfinished(),
            ..view_of(&self.session, &self.nothing, view)
        };
        let requested = self.shell.ui(ui, &session);
        let changes = !requested.is_empty();
        for command in requested {
            self.act(command);
        }
        self.follow_view();
        if changes {
            ui.ctx().request_repaint();
        }
        if !jobs.is_empty() {
            ui.ctx().request_repaint_after_secs(0.1);
        }
    }

    /// Passes what the view needs to the session, and writes the files that it requested.
    fn follow_view(&mut self) {
        if !self.shell.view.playback.is_playing() {
            self.session
                .prepare(self.shell.view.frame, self.shell.view.segmenter);
        }
        if let Some(root) = &self.open_root {
            let view = &mut self.shell.view;
            view.prefs.last_frames.note(root, view.frame);
        }
        self.session.hover(self.shell.view.hover_request.clone());
        self.session.select(&self.shell.view.scene_select.steps);
        if std::mem::take(&mut self.shell.view.dismisses_unfinished) {
            self.session.dismiss_unfinished();
        }
        if let Some(folder) = self.shell.view.folder_to_show.take()
            && let Err(error) = open_folder(&folder)
        {
            self.fail(&format!("{error:#}"));
        }
        if let Some(target) = self.shell.view.recipe_to.take() {
            self.save_recipe(&target);
        }
        if let Some((request, portrait)) = self.shell.view.portrait.take() {
            let started = write_scene_image(&mut self.session, &request, portrait);
            if let Err(error) = started {
                self.fail(&format!("{error:#}"));
            }
        }
    }

    /// Executes a command. A failure is shown as a notice.
    pub fn act(&mut self, command: Command) {
        let moved = match command {
            Command::Undo => self
                .session
                .undo_title()
                .map(|title| format!("Undone: {title}")),
            Command::Redo => self
                .session
                .redo_title()
                .map(|title| format!("Redone: {title}")),
            _ => None,
        };
        let creates = matches!(command, Command::New(_) | Command::AddFrames(_));
        if let Command::New(new) = &command {
            self.shell.view.prefs.last_frames.forget(&new.root);
        }
        let done = self.session.act(command);
        let done = if creates {
            self.opening.note_creation(done, &mut self.shell.view)
        } else {
            done
        };
        match (done, moved) {
            (Ok(_), Some(moved)) => self.shell.view.note = moved,
            (Ok(_), None) => {}
            (Err(error), _) => self.fail(&format!("{error:#}")),
        }
    }

    fn fail(&mut self, text: &str) {
        self.shell.view.draft.forget_sent();
        self.tell(Severity::Error, text);
    }

    fn tell(&mut self, severity: Severity, text: &str) {
        let notices = &mut self.shell.view.notices;
        notices.tell(severity, in_window_words(text));
    }

    fn take(&mut self, event: Event) {
        self.revision += u64::from(changes_project(&event));
        if self.opening.take(&event, &mut self.shell.view) {
            return;
        }
        match event {
            Event::Opened(root) => {
                self.shell.project_changed();
                self.recent.opened(&root);
                self.resume(root);
            }
            Event::Inspecting(_) | Event::Closed => {
                self.shell.project_changed();
                self.open_root = None;
            }
            Event::Failed { error, .. } => self.fail(&error),
            Event::Warning(text) => self.tell(Severity::Warning, &text),
            Event::Notice(text) => self.shell.view.note = text,
            Event::Exported(items) => self.shell.view.show_exported(items),
            Event::Finished { title, .. } => self.shell.view.note = format!("{title}: done"),
            Event::Stopped { title, .. } => {
                self.shell.view.draft.forget_sent();
                self.shell.view.note = format!("{title}: stopped; finished parts are kept");
            }
            Event::Paused {
                frame, label, text, ..
            } => {
                if self.shell.view.is_free() {
                    self.shell.view.go_to(frame);
                    self.shell.view.label = Some(label);
                }
                self.shell.view.notices.tell(Severity::Warning, text);
            }
            Event::Unchanged { frame, text, .. } => {
                self.shell.view.draft.forget_sent();
                self.shell.view.note.clone_from(&text);
                self.shell.view.answer.note_unchanged(frame, text);
            }
            Event::Changed => self.shell.view.answer.forget(),
            Event::ModelsChanged => {
                self.engines = list_engines();
                self.models = list_models().unwrap_or_default();
            }
            Event::Started { .. }
            | Event::CloudChanged
            | Event::SparseChanged
            | Event::ConflictsChanged => {}
        }
    }

    /// Shows the frame of a project that was shown last, and the options of an interrupted job.
    fn resume(&mut self, root: PathBuf) {
        let view = &mut self.shell.view;
        view.frame = view.prefs.last_frames.of(&root);
        if let Some(Command::Reconstruct(request)) = self
            .session
            .unfinished()
            .map(|unfinished| &unfinished.command)
        {
            view.set_reconstruction(request);
        }
        self.open_root = Some(root);
    }

    /// Loads images of the open frames.
    ///
    /// Loaded images are kept if only cameras or depth maps changed.
    fn follow_frames(&mut self, ctx: &Context) {
        let frames = &self.session.project().unwrap_or(&self.nothing).frames;
        if Arc::ptr_eq(frames, &self.shown_frames) {
            return;
        }
        if let Some(factor) = scale_between(&self.shown_frames, frames) {
            self.shell.scale_by(factor);
        }
        let (waker, store) = (ctx.clone(), Arc::clone(self.session.store()));
        self.layers = Some(layers_of(Arc::clone(frames), store, move || {
            waker.request_repaint();
        }));
        let same = frames.len() == self.shown_frames.len()
            && frames
                .iter()
                .zip(self.shown_frames.iter())
                .all(|(a, b)| a.image == b.image);
        if !same {
            let waker = ctx.clone();
            let store = Arc::clone(self.session.store());
            self.images = Some(Images::of(Arc::clone(frames), store, move || {
                waker.request_repaint();
            }));
        }
        self.shown_frames = Arc::clone(frames);
    }

    /// Returns the name of the open project or cloud.
    fn open_name(&self) -> Option<String> {
        let open = self.session.root().or(self.session.inspected());
        let name = open.and_then(Path::file_name)?;
        Some(name.to_string_lossy().into_owned())
    }

    fn window_title(&self) -> String {
        let access = if self.session.view_reason().is_some() {
            " (viewing only)"
        } else {
            ""
        };
        let title = self
            .open_name()
            .map_or("OSTRA".into(), |name| format!("{name}{access} – OSTRA"));
        title_with_progress(&title, &self.session.jobs())
    }

    fn save_recipe(&mut self, target: &RecipeTarget) {
        let path = &target.path;
        let allowed = self.session.check_export(path, target.may_replace);
        let written = allowed
            .and_then(|()| Ok(serde_json::to_string_pretty(self.session.recipe())?))
            .and_then(|text| {
                let write = || Ok(disk::write(path, text.as_bytes())?);
                ExportTargets::write_files(std::slice::from_ref(path), write)
            });
        match written {
            Ok(()) => self.shell.view.note = format!("Recipe saved to {}", path.display()),
            Err(error) => {
                self.fail(&format!(
                    "{}: the recipe cannot be written ({error}); choose another place",
                    path.display()
                ));
            }
        }
    }
}

impl eframe::App for Window {
    fn logic(&mut self, ctx: &Context, _frame: &mut eframe::Frame) {
        self.poll(ctx);
    }

    fn ui(&mut self, ui: &mut egui::Ui, _frame: &mut eframe::Frame) {
        self.show(ui);
    }

    fn save(&mut self, storage: &mut dyn eframe::Storage) {
        eframe::set_value(storage, PREFS, &self.shell.view.prefs);
    }
}

/// Returns `true` if an event may change the project or its conflicts.
fn changes_project(event: &Event) -> bool {
    matches!(
        event,
        Event::Opened(_)
            | Event::Inspecting(_)
            | Event::Closed
            | Event::Changed
            | Event::CloudChanged
            | Event::ConflictsChanged
    )
}

#[cfg(test)]
mod tests;
