use egui::Ui;

use super::picker::{PathPicker, Pick, PickTarget, path_field_ui};
use crate::tips::icon_button;
use crate::view_state::typed_path;
use ostra_frames::FrameFolder;

/// One source of frames as typed.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct SourceForm {
    pub frames: String,
    pub depth: String,
}

impl SourceForm {
    /// The source; `None` while no frames are named.
    pub fn source(&self) -> Option<FrameFolder> {
        Some(FrameFolder {
            frames: typed_path(&self.frames)?,
            depth: typed_path(&self.depth),
        })
    }
}

/// The rows of all sources, each with its depth folder.
pub(super) fn sources_ui(ui: &mut Ui, picker: &mut PathPicker, sources: &mut Vec<SourceForm>) {
    let mut removed = None;
    let several = sources.len() > 1;
    for (index, source) in sources.iter_mut().enumerate() {
        let number = if several {
            format!(" {}", index + 1)
        } else {
            String::new()
        };
        ui.label(format!("Frames{number}"))
            .on_hover_text("A folder of pictures, one picture, or a film");
        ui.horizontal(|ui| {
            let name = format!("Frames folder or film{number}");
            let ends = (
                "folder of pictures, or a film",
                (Pick::Folder, PickTarget::Frames(index)),
            );
            path_field_ui(ui, picker, (&name, ends.0), &mut source.frames, ends.1);
            if several
                && icon_button(
                    ui,
                    "×",
                    &format!("Remove source{number}"),
                    "Takes this source out",
                )
                .clicked()
            {
                removed = Some(index);
            }
        });
        ui.end_row();
        ui.label(format!("Depth{number}"))
            .on_hover_text("Folder of 16-bit depth pictures that belong to these frames");
        ui.horizontal(|ui| {
            let name = format!("Depth folder{number}");
            let target = (Pick::Folder, PickTarget::Depth(index));
            path_field_ui(ui, picker, (&name, "none"), &mut source.depth, target);
        });
        ui.end_row();
    }
    if let Some(index) = removed {
        sources.remove(index);
    }
    ui.label("");
    if ui
        .small_button("+ More frames")
        .on_hover_text("Adds another folder or film to the same project")
        .clicked()
    {
        sources.push(SourceForm::default());
    }
    ui.end_row();
}
