use std::path::PathBuf;

use super::{Look, Prefs, Shell, theme::set_theme};
use crate::session::Project;

/// Opens the window.
///
/// # Errors
/// When no window can be made.
pub fn run(path: Option<PathBuf>) -> anyhow::Result<()> {
    let _ = path;
    let options = eframe::NativeOptions::default();
    eframe::run_native("OSTRA", options, Box::new(|cc| Ok(Box::new(Window::new(cc)))))
        .map_err(|e| anyhow::anyhow!("{e}"))
}

struct Window {
    shell: Shell,
    project: Project,
}

impl Window {
    fn new(cc: &eframe::CreationContext<'_>) -> Self {
        set_theme(&cc.egui_ctx);
        Self { shell: Shell::new(Prefs::default(), cc.wgpu_render_state.as_ref()), project: Project::default() }
    }
}

impl eframe::App for Window {
    fn ui(&mut self, ui: &mut egui::Ui, _frame: &mut eframe::Frame) {
        let look = Look {
            project: &self.project,
            root: None,
            cloud: None,
            inspected: None,
            pictures: None,
            jobs: &[],
            engines: &[],
            undo: None,
            redo: None,
            recent: &[],
        };
        let _ = self.shell.ui(ui, &look);
    }
}
