use egui::{ComboBox, Ui};

use ostra_masks::MaskFormat;

/// Formats with what a command calls them and what people do.
const FORMATS: [(MaskFormat, &str, &str); 4] = [
    (MaskFormat::Davis, "davis", "palette PNG a frame (DAVIS)"),
    (
        MaskFormat::Binary,
        "binary",
        "black and white PNG a label and frame",
    ),
    (MaskFormat::Coco, "coco", "COCO JSON with run lengths"),
    (MaskFormat::Yolo, "yolo", "YOLO outlines"),
];

/// What commands call a format.
pub(super) fn mask_format_name(format: MaskFormat) -> &'static str {
    FORMATS
        .iter()
        .find(|(of, ..)| *of == format)
        .map_or("", |(_, name, _)| name)
}

/// The choice of a format for masks.
pub(super) fn mask_format_ui(ui: &mut Ui, name: &str, chosen: &mut MaskFormat) {
    let text = FORMATS
        .iter()
        .find(|(of, ..)| of == chosen)
        .map_or("", |(_, _, text)| text);
    let choice = ComboBox::from_id_salt(name)
        .selected_text(text)
        .width(230.0)
        .show_ui(ui, |ui| {
            for (format, _, text) in FORMATS {
                ui.selectable_value(chosen, format, text);
            }
        });
    choice
        .response
        .on_hover_text("How masks are written in files")
        .accessible_name(name);
}
