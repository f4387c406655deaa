use egui::{Button, Color32, Pos2, Rect, ScrollArea, Sense, Stroke, Ui, Vec2};
use glam::DVec2;

use crate::textures::Textures;
use crate::{SessionView, ViewState};
use ostra_reconstruct::rgbd::{FrameLink, LinkKind};
use ostra_reconstruct::sfm::RegistrationStatus;
use ostra_session::SparseReconstruction;

/// Maximum number of drawn lines. Of more matches every n-th is shown.
const LINES: usize = 120;
/// Reprojection error in pixels from which a line is drawn red.
const BAD_PX: f64 = 2.0;
const UV: Rect = Rect {
    min: Pos2::ZERO,
    max: Pos2::new(1.0, 1.0),
};

/// Draws the window of registered frames and of the matches between two frames.
pub(crate) fn matches_ui(
    ui: &Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    textures: &mut Textures,
) {
    let mut open = view.matches.open;
    let window = egui::Window::new("Cameras and matches")
        .open(&mut open)
        .default_size([980.0, 560.0]);
    let middle = ui.ctx().content_rect().center() - Vec2::new(490.0, 290.0);
    window.default_pos(middle).show(ui.ctx(), |ui| {
        let Some(sparse) = session.sparse else {
            ui.label("Matches appear here after cameras have been computed.");
            return;
        };
        let margin = egui::Margin {
            right: 8,
            ..egui::Margin::ZERO
        };
        egui::Panel::left("outcomes")
            .frame(egui::Frame::new().inner_margin(margin))
            .resizable(true)
            .default_size(330.0)
            .show(ui, |ui| {
                outcomes_ui(ui, session, view, sparse);
            });
        egui::Frame::new()
            .inner_margin(egui::Margin {
                left: 8,
                ..egui::Margin::ZERO
            })
            .show(ui, |ui| {
                pair_ui(ui, session, view, textures, sparse);
            });
    });
    view.matches.open = open;
}

fn pair_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    textures: &mut Textures,
    sparse: &SparseReconstruction,
) {
    let partners = partners(sparse, view.frame);
    let known = |&other: &usize| partners.iter().any(|&(frame, _)| frame == other);
    let Some(other) = view
        .matches
        .other
        .filter(known)
        .or(partners.first().map(|&(frame, _)| frame))
    else {
        ui.label(format!(
            "Frame {} has no match with another frame.",
            view.frame
        ));
        return;
    };
    let by_points = sparse.links.is_empty();
    ui.horizontal(|ui| {
        ui.label(format!("Frame {} with", view.frame));
        other_ui(ui, view, &partners, other);
        for (error_px, text) in [(0.0, "< 0.5 px"), (BAD_PX, "≥ 2 px error")]
            .into_iter()
            .filter(|_| by_points)
        {
            ui.colored_label(error_color(error_px), text)
                .on_hover_text("Colour of a line: mean reprojection error of its point");
        }
    });
    let matches = sparse.matches(view.frame, other);
    let size = Vec2::new(
        ui.available_width(),
        (ui.available_height() - 4.0).max(120.0),
    );
    let (rect, response) = ui.allocate_exact_size(size, Sense::hover());
    let name = format!("Matches of frames {} and {other}", view.frame);
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, &name));
    let places = places(rect, session, view.frame);
    let shown = [view.frame, other];
    let fitted = images_ui(ui, session, textures, shown, places);
    let at = |i: usize, at_px: DVec2| {
        let frame = &session.project.frames[shown[i]];
        let share = Vec2::new(
            (at_px.x / f64::from(frame.width)) as f32,
            (at_px.y / f64::from(frame.height)) as f32,
        );
        fitted[i].min + share * fitted[i].size()
    };
    for &(first, second, point) in matches.iter().step_by(matches.len().div_ceil(LINES).max(1)) {
        let error_px = sparse
            .points
            .points
            .get(point as usize)
            .and_then(|point| point.error_px)
            .unwrap_or(0.0);
        let color = error_color(error_px);
        let ends = [at(0, first), at(1, second)];
        ui.painter()
            .line_segment(ends, Stroke::new(1.0, color.gamma_multiply(0.4)));
        for end in ends {
            ui.painter().circle_filled(end, 2.0, color);
        }
    }
}

/// Returns the frames linked to this one with a description, strongest first.
///
/// Links come from depth registration if there are any, else from shared points.
fn partners(sparse: &SparseReconstruction, frame: usize) -> Vec<(usize, String)> {
    let linked = |(other, link): (usize, FrameLink)| {
        let kind = match link.kind {
            LinkKind::Odometry => "consecutive",
            LinkKind::Loop => "similar appearance",
            LinkKind::Overlap => "overlap",
            LinkKind::Shape => "matching shape",
        };
        let verdict = if link.holds { "" } else { ", rejected" };
        (
            other,
            format!(
                "frame {other}: {kind}, {:.0} % agrees{verdict}",
                100.0 * link.consistent
            ),
        )
    };
    if sparse.links.is_empty() {
        let shared = |(other, count)| (other, format!("frame {other}: {count} shared points"));
        sparse.neighbours(frame).into_iter().map(shared).collect()
    } else {
        sparse.linked(frame).into_iter().map(linked).collect()
    }
}

/// Returns two rectangles next to each other, or stacked if that shows the images larger.
fn places(rect: Rect, session: &SessionView<'_>, frame: usize) -> [Rect; 2] {
    let known = &session.project.frames[frame];
    let size = Vec2::new(known.width as f32, known.height as f32);
    let scale = |place: Vec2| (place.x / size.x).min(place.y / size.y);
    let adjacent = Vec2::new((rect.width() - 6.0) / 2.0, rect.height());
    let over = Vec2::new(rect.width(), (rect.height() - 6.0) / 2.0);
    let place = if scale(over) > scale(adjacent) {
        over
    } else {
        adjacent
    };
    [
        Rect::from_min_size(rect.min, place),
        Rect::from_min_size(rect.max - place, place),
    ]
}

/// Draws the choice of the second frame.
fn other_ui(ui: &mut Ui, view: &mut ViewState, partners: &[(usize, String)], other: usize) {
    let chosen = partners
        .iter()
        .find(|(frame, _)| *frame == other)
        .map_or("", |(_, text)| text);
    let choice = egui::ComboBox::from_id_salt("other frame")
        .selected_text(chosen)
        .width(260.0)
        .show_ui(ui, |ui| {
            for (frame, text) in partners {
                if ui.selectable_label(*frame == other, text).clicked() {
                    view.matches.other = Some(*frame);
                }
            }
        });
    choice
        .response
        .on_hover_text("Second frame; the list begins with the strongest link");
}

/// Draws the images of two frames into rectangles and returns the areas that they cover.
fn images_ui(
    ui: &Ui,
    session: &SessionView<'_>,
    textures: &mut Textures,
    frames: [usize; 2],
    places: [Rect; 2],
) -> [Rect; 2] {
    std::array::from_fn(|i| {
        let known = &session.project.frames[frames[i]];
        let size = Vec2::new(known.width as f32, known.height as f32);
        let scale = (places[i].width() / size.x).min(places[i].height() / size.y);
        let fitted = Rect::from_center_size(places[i].center(), size * scale);
        match session.images.and_then(|images| images.image(frames[i])) {
            Some(image) => {
                let texture = textures.of_pair(ui.ctx(), i, &image);
                ui.painter()
                    .image(texture.id(), fitted, UV, Color32::from_gray(190));
            }
            None => {
                ui.painter()
                    .rect_filled(fitted, 2.0, ui.visuals().extreme_bg_color);
            }
        }
        fitted
    })
}

/// Returns the colour of a reprojection error: green at 0, over yellow to red.
fn error_color(error_px: f64) -> Color32 {
    let share = (error_px / BAD_PX).clamp(0.0, 1.0) as f32;
    let (red, green) = ((2.0 * share).min(1.0), (2.0 - 2.0 * share).min(1.0));
    Color32::from_rgb((60.0 + 195.0 * red) as u8, (60.0 + 140.0 * green) as u8, 90)
}

/// Median error in pixels above which a frame is highlighted.
const UNCERTAIN_PX: f64 = 1.0;

/// Draws a row per frame with its accuracy, or the reason why it has no camera.
///
/// A click goes to the frame.
fn outcomes_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    sparse: &SparseReconstruction,
) {
    let placed = sparse
        .outcomes
        .values()
        .filter(|outcome| outcome.is_placed())
        .count();
    ui.label(format!(
        "{placed} of {} frames have a camera",
        sparse.outcomes.len()
    ));
    ui.separator();
    let rows: Vec<(usize, &RegistrationStatus)> = sparse
        .outcomes
        .iter()
        .map(|(&frame, outcome)| (frame, outcome))
        .collect();
    let height = ui.spacing().interact_size.y;
    ScrollArea::vertical()
        .auto_shrink([false, false])
        .show_rows(ui, height, rows.len(), |ui, shown| {
            for &(frame, outcome) in &rows[shown] {
                row_ui(ui, session, view, frame, outcome);
            }
        });
}

fn row_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    frame: usize,
    outcome: &RegistrationStatus,
) {
    let name = |frame: usize| {
        session
            .project
            .frames
            .get(frame)
            .map_or("", |frame| frame.name.as_str())
    };
    let (text, color) = summary(ui, outcome);
    let reported = egui::RichText::new(text).color(color);
    let row = Button::selectable(view.frame == frame, format!("{frame}  {}", name(frame)))
        .right_text(reported);
    let row = ui.add_sized([ui.available_width(), ui.spacing().interact_size.y], row);
    if row
        .on_hover_text(format!("{}: {}", name(frame), outcome.text(name)))
        .clicked()
    {
        view.go_to(frame);
    }
}

/// Returns the text and colour at the end of a row. Only problems are highlighted.
fn summary(ui: &Ui, outcome: &RegistrationStatus) -> (String, Color32) {
    let visuals = ui.visuals();
    match outcome {
        RegistrationStatus::Placed { points, error_px } => {
            let color = if *error_px > UNCERTAIN_PX {
                visuals.warn_fg_color
            } else {
                visuals.weak_text_color()
            };
            (format!("{points} points  {error_px:.2} px"), color)
        }
        RegistrationStatus::Registered {
            neighbours,
            consistent,
        } => (
            format!("{neighbours} frames  {:.0} %", 100.0 * consistent),
            visuals.weak_text_color(),
        ),
        _ => ("no camera".into(), visuals.error_fg_color),
    }
}
