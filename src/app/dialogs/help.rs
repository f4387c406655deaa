//! Pages of the Help menu: the guide, what is new, how to report a problem, and the program.

use egui::{RichText, ScrollArea, Ui};

use super::HelpPage;
use crate::tooltips::modal;
use crate::{SessionView, ViewState};

/// Pages of the guide, each with its name.
const GUIDE: [(&str, &str); 9] = [
    (
        "Photos",
        include_str!("../../../docs/book/src/tutorials/photos-of-a-plant.md"),
    ),
    (
        "Video",
        include_str!("../../../docs/book/src/tutorials/video-to-coco.md"),
    ),
    (
        "RGB-D",
        include_str!("../../../docs/book/src/tutorials/rgbd-to-mesh.md"),
    ),
    (
        "Open",
        include_str!("../../../docs/book/src/how-to/open.md"),
    ),
    (
        "Click",
        include_str!("../../../docs/book/src/how-to/click.md"),
    ),
    (
        "Track",
        include_str!("../../../docs/book/src/how-to/track.md"),
    ),
    (
        "Correct",
        include_str!("../../../docs/book/src/how-to/correct.md"),
    ),
    (
        "Measure",
        include_str!("../../../docs/book/src/how-to/measure.md"),
    ),
    (
        "Export",
        include_str!("../../../docs/book/src/how-to/export.md"),
    ),
];

const NEWS: &str = include_str!("../../../CHANGELOG.md");

/// Returns the address of the program's home, if its package names one.
fn home() -> Option<&'static str> {
    Some(env!("CARGO_PKG_REPOSITORY")).filter(|home| !home.is_empty())
}

/// Draws a page of the help.
pub(crate) fn help_ui(ui: &Ui, session: &SessionView<'_>, view: &mut ViewState, page: HelpPage) {
    let screen = ui.ctx().content_rect();
    let width = (screen.width() - 120.0).min(680.0);
    let response = modal(ui, "help", width, |ui| {
        let (heading, text) = match page {
            HelpPage::Guide => ("Guide", GUIDE[view.guide_page.min(GUIDE.len() - 1)].1),
            HelpPage::News => ("What's new", NEWS),
            HelpPage::Report => ("Report a problem", REPORT),
            HelpPage::About => ("About OSTRA", ABOUT),
        };
        ui.heading(heading);
        ui.add_space(6.0);
        if page == HelpPage::Guide {
            ui.horizontal_wrapped(|ui| {
                for (number, (name, _)) in GUIDE.iter().enumerate() {
                    let tip = format!("Show the page about {}", name.to_lowercase());
                    ui.selectable_value(&mut view.guide_page, number, *name)
                        .on_hover_text(tip);
                }
            });
            ui.add_space(4.0);
        }
        let details = details(session, view);
        ScrollArea::vertical()
            .id_salt((page as u8, view.guide_page))
            .max_height((screen.height() - 200.0).max(120.0))
            .show(ui, |ui| {
                ui.set_width(ui.available_width());
                markdown_ui(ui, text);
                if matches!(page, HelpPage::About | HelpPage::Report) {
                    ui.add_space(6.0);
                    details_ui(ui, &details);
                }
            });
        ui.add_space(10.0);
        end_ui(ui, view, page, details);
    });
    if response.should_close() {
        view.dialog = None;
    }
}

const REPORT: &str = "Describe what you did, what you expected and what happened, and send it with the details below. \
                      A screenshot and the project's `recipe.jsonl` help to repeat the problem.";

const ABOUT: &str = "Turns photos, videos and RGB-D recordings into labelled 3-D models.";

fn end_ui(ui: &mut Ui, view: &mut ViewState, page: HelpPage, details: Vec<[String; 2]>) {
    ui.horizontal(|ui| {
        if matches!(page, HelpPage::About | HelpPage::Report)
            && ui
                .button("Copy details")
                .on_hover_text("Copy version and system to the clipboard")
                .clicked()
        {
            let lines: Vec<String> = details
                .into_iter()
                .map(|[name, value]| format!("{name}: {value}"))
                .collect();
            ui.ctx().copy_text(lines.join("\n"));
        }
        if let Some(home) = home()
            && ui.button("Open web page").on_hover_text(home).clicked()
        {
            let address = match page {
                HelpPage::Report => format!("{home}/issues/new"),
                _ => home.to_owned(),
            };
            ui.ctx().open_url(egui::OpenUrl::new_tab(address));
        }
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            if ui
                .button("Close")
                .on_hover_text("Close the page (Esc)")
                .clicked()
            {
                view.dialog = None;
            }
        });
    });
}

/// Returns the version and what the program runs on, as names and values.
fn details(session: &SessionView<'_>, view: &ViewState) -> Vec<[String; 2]> {
    let runtime = session.models.iter().find(|row| row.name == "onnxruntime");
    let runtime = runtime.and_then(|row| row.installed.as_ref());
    let runtime = match runtime.map(|installed| installed.paths.first()) {
        None => "not installed".to_owned(),
        Some(None) => "installed".to_owned(),
        Some(Some(path)) => path.display().to_string(),
    };
    let adapter = view.adapter.clone();
    [
        ("Version", env!("CARGO_PKG_VERSION").to_owned()),
        ("Licence", env!("CARGO_PKG_LICENSE").to_owned()),
        ("Graphics adapter", adapter.unwrap_or_else(|| "none".into())),
        ("ONNX Runtime", runtime),
        (
            "System",
            format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
        ),
    ]
    .map(|(name, value)| [name.to_owned(), value])
    .to_vec()
}

fn details_ui(ui: &mut Ui, details: &[[String; 2]]) {
    egui::Grid::new("details")
        .num_columns(2)
        .spacing([16.0, 4.0])
        .show(ui, |ui| {
            for [name, value] in details {
                ui.weak(name);
                ui.add(egui::Label::new(value).wrap());
                ui.end_row();
            }
        });
}

/// Draws Markdown: headings, lists, code and paragraphs. Images are left out.
fn markdown_ui(ui: &mut Ui, text: &str) {
    let mut paragraph = String::new();
    let mut is_code = false;
    for line in text.lines().chain([""]) {
        let line = line.trim_end();
        let content = line.trim_start();
        let is_fence = content.starts_with("```");
        let starts_item = content.starts_with("- ")
            || content.starts_with(|c: char| c.is_ascii_digit()) && content.contains(". ");
        let starts = is_code
            || is_fence
            || line.is_empty()
            || starts_item
            || content.starts_with(['#', '|', '!', '<']);
        if starts && !paragraph.is_empty() {
            ui.add(egui::Label::new(plain(&paragraph)).wrap());
            ui.add_space(3.0);
            paragraph.clear();
        }
        if is_fence {
            is_code = !is_code;
        } else if is_code {
            ui.label(RichText::new(line).monospace());
        } else if let Some(title) = content.strip_prefix("# ") {
            ui.label(RichText::new(plain(title)).size(18.0).strong());
        } else if content.starts_with('#') {
            ui.add_space(6.0);
            let title = plain(content.trim_start_matches('#').trim());
            ui.label(RichText::new(title).size(14.5).strong());
        } else if content.starts_with('|') {
            if !content.contains("---") {
                ui.add(egui::Label::new(plain(content.trim_matches('|'))).wrap());
            }
        } else if !(line.is_empty() || content.starts_with("![") || content.starts_with('<')) {
            if !paragraph.is_empty() {
                paragraph.push(' ');
            }
            paragraph += &content.replacen("- ", "• ", usize::from(content.starts_with("- ")));
        }
    }
}

/// Returns text without the marks of Markdown; of links, their text is kept.
fn plain(text: &str) -> String {
    let text = text
        .replace("**", "")
        .replace('`', "")
        .replace(" | ", "  –  ");
    let mut plain = String::new();
    let mut rest = text.as_str();
    while let Some(open) = rest.find('[') {
        plain += &rest[..open];
        let link = &rest[open + 1..];
        let parts = link.find("](").and_then(|middle| {
            let end = link[middle..].find(')')?;
            Some((middle, middle + end + 1))
        });
        match parts {
            Some((middle, end)) => {
                plain += &link[..middle];
                rest = &link[end..];
            }
            None => {
                plain.push('[');
                rest = link;
            }
        }
    }
    plain + rest
}

#[cfg(test)]
mod tests {
    use super::plain;

    #[test]
    fn links_and_marks_become_text() {
        assert_eq!(
            plain("See [Set the *scale*](../how-to/scale.md), **then** `ostra fuse` [x]."),
            "See Set the *scale*, then ostra fuse [x]."
        );
    }
}
