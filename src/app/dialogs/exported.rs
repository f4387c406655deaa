//! The list of what an export wrote.

use std::path::{Path, PathBuf};

use egui::{Grid, ScrollArea, Ui};

use crate::ViewState;
use crate::tooltips::{add_explained, modal};
use ostra_session::ExportedItem;

/// Draws the files that the last export wrote, with their sizes.
pub(crate) fn exported_ui(ui: &Ui, view: &mut ViewState) {
    let folder = common_folder(&view.exported);
    let height = (ui.ctx().content_rect().height() - 170.0).max(120.0);
    let mut is_done = false;
    let response = modal(ui, "exported", 480.0, |ui| {
        ui.heading("Export finished");
        if let Some(folder) = &folder {
            ui.add(
                egui::Label::new(egui::RichText::new(folder.display().to_string()).weak()).wrap(),
            );
        }
        ui.add_space(6.0);
        ScrollArea::vertical()
            .max_height(height)
            .show(ui, |ui| items_ui(ui, &view.exported, folder.as_deref()));
        ui.add_space(10.0);
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Min), |ui| {
            let close = ui.button("Close").on_hover_text("Close the list (Esc)");
            is_done |= close.accessible_name("Close list of files").clicked();
            let reason = folder.is_none().then_some("Nothing was written");
            let show = egui::Button::new("Show in folder");
            if add_explained(ui, show, "Open the folder in the file manager", reason).clicked() {
                view.folder_to_show.clone_from(&folder);
            }
        });
    });
    if is_done || response.should_close() {
        view.dialog = None;
    }
}

fn items_ui(ui: &mut Ui, items: &[ExportedItem], folder: Option<&Path>) {
    Grid::new("exported")
        .num_columns(2)
        .striped(true)
        .spacing([24.0, 4.0])
        .show(ui, |ui| {
            for item in items {
                let name = folder
                    .and_then(|folder| item.path.strip_prefix(folder).ok())
                    .filter(|name| !name.as_os_str().is_empty())
                    .unwrap_or(&item.path);
                let name = match item.files {
                    Some(1) => format!("{}{}, 1 file", name.display(), std::path::MAIN_SEPARATOR),
                    Some(count) => {
                        format!(
                            "{}{}, {count} files",
                            name.display(),
                            std::path::MAIN_SEPARATOR
                        )
                    }
                    None => name.display().to_string(),
                };
                ui.label(name)
                    .on_hover_text(item.path.display().to_string());
                ui.weak(size_text(item.bytes));
                ui.end_row();
            }
        });
}

/// Returns the folder that has all exported files and folders.
fn common_folder(items: &[ExportedItem]) -> Option<PathBuf> {
    let mut folders = items.iter().filter_map(|item| item.path.parent());
    let mut common = folders.next()?.to_owned();
    for folder in folders {
        while !folder.starts_with(&common) {
            common = common.parent()?.to_owned();
        }
    }
    Some(common)
}

/// Formats a size in the largest decimal unit that is at least 1.
fn size_text(bytes: u64) -> String {
    let size = bytes as f64;
    match bytes {
        0..1_000 => format!("{bytes} B"),
        1_000..1_000_000 => format!("{:.1} kB", size / 1e3),
        1_000_000..1_000_000_000 => format!("{:.1} MB", size / 1e6),
        _ => format!("{:.1} GB", size / 1e9),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folder_has_all_items_and_sizes_are_short() {
        let item = |path: &str| ExportedItem {
            path: path.into(),
            files: None,
            bytes: 1,
        };
        let items = [item("/out/cloud.ply"), item("/out/masks")];
        assert_eq!(common_folder(&items), Some("/out".into()));
        let apart = [item("/out/a/cloud.ply"), item("/out/b/traits.csv")];
        assert_eq!(common_folder(&apart), Some("/out".into()));
        assert_eq!(common_folder(&[]), None);
        let sizes = [0, 999, 1500, 2_345_678, 7_000_000_000].map(size_text);
        assert_eq!(sizes, ["0 B", "999 B", "1.5 kB", "2.3 MB", "7.0 GB"]);
    }
}
