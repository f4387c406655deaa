//! Preview of what the files of a new project hold.

use std::path::Path;

use egui::{Color32, RichText, Ui};

use super::new_project_form::{NewProjectForm, SourceKind};
use crate::SessionView;
use crate::option_names::in_window_words;
use crate::textures::Textures;
use crate::tooltips::grouped;
use ostra_frames::ImageSource;
use ostra_session::Survey;

/// Number of thumbnails shown, and their height in points.
const THUMBNAILS: usize = 6;
const THUMBNAIL_HEIGHT: f32 = 62.0;
/// Height of the preview in points, from the start, so that nothing below moves when it fills.
const FOUND_HEIGHT: f32 = 160.0;

/// Draws what was found in the given files, with a tick for each part that can be left out.
pub(super) fn found_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    form: &mut NewProjectForm,
    survey: Option<&Survey>,
    textures: &mut Textures,
) {
    let hovered = ui.input(|input| !input.raw.hovered_files.is_empty());
    let stroke = if hovered {
        egui::Stroke::new(2.0, ui.visuals().hyperlink_color)
    } else {
        ui.visuals().widgets.noninteractive.bg_stroke
    };
    egui::Frame::new()
        .fill(ui.visuals().faint_bg_color)
        .stroke(stroke)
        .corner_radius(6.0)
        .inner_margin(10.0)
        .show(ui, |ui| {
            ui.set_width(ui.available_width());
            ui.set_min_height(FOUND_HEIGHT);
            match survey {
                _ if hovered => {
                    ui.strong("Drop to add");
                }
                None if form.paths().is_empty() => {
                    ui.weak(
                        "Nothing chosen yet. The images, depth and cameras found are shown here.",
                    );
                }
                None => {
                    ui.horizontal(|ui| {
                        ui.spinner();
                        ui.weak("Reading the files…");
                    });
                }
                Some(Survey {
                    error: Some(error), ..
                }) => {
                    ui.colored_label(ui.visuals().error_fg_color, in_window_words(error));
                }
                Some(survey) => {
                    ui.strong(summary(survey));
                    thumbnails_ui(ui, session, survey, textures);
                    ticks_ui(ui, form, survey);
                    warnings_ui(ui, form, survey);
                }
            }
        });
}

/// Describes the frames in one line.
fn summary(survey: &Survey) -> String {
    let count = survey.frames.len();
    let noun = if survey.is_video() { "frame" } else { "image" };
    let mut text = format!(
        "{} {noun}{}",
        grouped(count),
        if count == 1 { "" } else { "s" }
    );
    if let Some(((width, height), _)) = survey.size() {
        text += &format!(" · {width} × {height} pixels");
    }
    if let Some(ImageSource::Video { time_s, .. }) = survey.frames.last().map(|frame| &frame.image)
    {
        text = format!("Video · {text} · {time_s:.0} s");
    }
    text
}

fn thumbnails_ui(ui: &mut Ui, session: &SessionView<'_>, survey: &Survey, textures: &mut Textures) {
    let Some(images) = session.survey_images else {
        return;
    };
    let count = survey.frames.len();
    let shown = count.min(THUMBNAILS);
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        for place in 0..shown {
            let frame = place * (count - 1) / (shown - 1).max(1);
            let (width, height) = (survey.frames[frame].width, survey.frames[frame].height);
            let aspect = (width as f32 / height.max(1) as f32).clamp(0.4, 1.5);
            let size = egui::vec2(THUMBNAIL_HEIGHT * aspect, THUMBNAIL_HEIGHT);
            let (rect, response) = ui.allocate_exact_size(size, egui::Sense::hover());
            let name = survey.frames[frame].name.as_str();
            match images.thumbnail(frame) {
                Some(image) => {
                    let texture = textures.small(ui.ctx(), &image);
                    let whole =
                        egui::Rect::from_min_max(egui::pos2(0.0, 0.0), egui::pos2(1.0, 1.0));
                    ui.painter()
                        .image(texture.id(), rect, whole, Color32::WHITE);
                    response.on_hover_text(name);
                }
                None => {
                    let color = ui.visuals().widgets.inactive.bg_fill;
                    ui.painter().rect_filled(rect, 2.0, color);
                    let tip = images.failure(frame).unwrap_or_else(|| name.to_owned());
                    response.on_hover_text(in_window_words(&tip));
                }
            }
        }
    });
}

fn ticks_ui(ui: &mut Ui, form: &mut NewProjectForm, survey: &Survey) {
    let count = survey.frames.len();
    if let Some(depth) = &survey.depth {
        let text = format!(
            "Depth of {} of {count} frames, in {}",
            depth.frames,
            short(&depth.folder)
        );
        let tip = format!("Use the depth in {}", depth.folder.display());
        ui.checkbox(&mut form.take_depth, text).on_hover_text(tip);
    }
    if let Some(cameras) = &survey.cameras {
        let text = format!(
            "Cameras of {} of {count} frames, from {}",
            cameras.frames,
            short(&cameras.path)
        );
        let tip = format!("Use the cameras in {}", cameras.path.display());
        ui.checkbox(&mut form.take_cameras, text).on_hover_text(tip);
    }
    if let Some(path) = &survey.intrinsics {
        let tip = format!("Use the intrinsics in {}", path.display());
        ui.checkbox(
            &mut form.take_intrinsics,
            format!("Intrinsics, from {}", short(path)),
        )
        .on_hover_text(tip);
    }
    let missing = match (&survey.depth, &survey.cameras) {
        (None, None) => "Cameras: none · Depth: none. Step Cameras & depth computes both.",
        (None, Some(_)) => "Depth: none. Step Cameras & depth computes it.",
        (Some(_), None) => "Cameras: none. Step Cameras & depth computes them.",
        (Some(_), Some(_)) => return,
    };
    ui.weak(missing);
}

fn warnings_ui(ui: &mut Ui, form: &NewProjectForm, survey: &Survey) {
    let other_sizes = survey
        .size()
        .filter(|(_, others)| *others > 0)
        .map(|(_, others)| {
            format!(
                "{others} of {} images have another size than the rest",
                survey.frames.len()
            )
        });
    let no_depth = (form.kind == SourceKind::Recording && survey.depth.is_none())
        .then(|| "No depth was found with these images; give its folder under Advanced".to_owned());
    let all = other_sizes
        .into_iter()
        .chain(no_depth)
        .chain(survey.warnings.iter().map(|text| in_window_words(text)));
    for warning in all {
        let text = RichText::new(warning).color(ui.visuals().warn_fg_color);
        ui.add(egui::Label::new(text).wrap());
    }
}

/// Returns the last two parts of a path.
fn short(path: &Path) -> String {
    let parts: Vec<_> = path
        .components()
        .rev()
        .take(2)
        .map(|part| part.as_os_str().to_string_lossy())
        .collect();
    parts.into_iter().rev().collect::<Vec<_>>().join("/")
}
