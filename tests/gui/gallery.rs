//! Opens everything once, dark and light; with `OSTRA_GALLERY=DIR` it leaves a picture of each there.

use std::path::{Path, PathBuf};

use egui_kittest::wgpu::{WgpuTestRenderer, create_render_state, default_wgpu_setup};
use ostra::app::{Dialog, Panes, Prefs, Severity, Shell};
use ostra::view::Coloring;

use crate::desk::Desk;

type Scene = (&'static str, fn() -> Desk, fn(&mut Desk));

const SCENES: [Scene; 10] = [
    ("welcome", Desk::empty, |desk| desk.recent = vec!["/home/me/rice-ostra".into(), "/home/me/shelf".into()]),
    ("both", Desk::sample, |_| ()),
    ("picture", Desk::sample, |desk| desk.shell.view.prefs.panes = Panes::Picture),
    ("scene", Desk::sample, |desk| {
        desk.shell.view.prefs.panes = Panes::Scene;
        desk.shell.view.coloring = Coloring::Label;
    }),
    ("new_project", Desk::sample, |desk| desk.shell.view.dialog = Some(Dialog::NewProject)),
    ("export", Desk::sample, |desk| desk.shell.view.dialog = Some(Dialog::Export)),
    ("shortcuts", Desk::sample, |desk| desk.shell.view.dialog = Some(Dialog::Shortcuts)),
    ("palette", Desk::sample, |desk| desk.shell.view.dialog = Some(Dialog::Palette)),
    ("notices", Desk::sample, |desk| {
        let notices = &mut desk.shell.view.notices;
        notices.tell(Severity::Error, "/data/000012.png: cannot be read (No such file); check that it exists");
        notices.tell(Severity::Warning, "3 frames have no depth and were left out: 000003, 000007, 000009");
    }),
    ("confidence", Desk::sample, |desk| {
        desk.shell.view.prefs.panes = Panes::Scene;
        desk.shell.view.coloring = Coloring::Confidence;
    }),
];

#[test]
fn everything_opens_dark_and_light() {
    let keep = std::env::var_os("OSTRA_GALLERY").map(PathBuf::from);
    for (name, desk, change) in SCENES {
        for theme in [egui::Theme::Dark, egui::Theme::Light] {
            show(name, desk(), change, theme, keep.as_deref());
        }
    }
}

fn show(name: &str, mut desk: Desk, change: fn(&mut Desk), theme: egui::Theme, keep: Option<&Path>) {
    let mut builder = egui_kittest::Harness::builder().with_theme(theme).with_context_setup(ostra::app::set_theme);
    if keep.is_some() {
        let gpu = create_render_state(default_wgpu_setup(), egui_wgpu::RendererOptions::PREDICTABLE);
        desk.shell = Shell::new(Prefs::default(), Some(&gpu));
        builder = builder.renderer(WgpuTestRenderer::from_render_state(gpu));
    }
    change(&mut desk);
    let mut harness = desk.shown_by(builder);
    harness.run_steps(10);
    assert_eq!(harness.unnamed_widgets(), Vec::<String>::new(), "{name}");
    if let Some(dir) = keep {
        let theme = if theme == egui::Theme::Dark { "dark" } else { "light" };
        harness.render().unwrap().save(dir.join(format!("{name}_{theme}.png"))).unwrap();
    }
}
