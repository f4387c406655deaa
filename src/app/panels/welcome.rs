use std::path::Path;

use egui::{Align, Button, Color32, Layout, Rect, RichText, Sense, Stroke, Ui, Vec2, WidgetInfo};

use super::jobs::progress_text;
use crate::action::Requests;
use crate::textures::Textures;
use crate::{Action, Dialog, NewProjectForm, SessionView, SourceKind, ViewState};
use ostra_session::{Command, JobTask, RecentProject};

/// Widest content of the page, in points.
const WIDTH: f32 = 760.0;
const GAP: f32 = 12.0;
const CARD_HEIGHT: f32 = 126.0;
const RECENT_HEIGHT: f32 = 52.0;

/// What can be opened: kind, title and what comes out of it.
const CARDS: [(SourceKind, &str, &str); 3] = [
    (
        SourceKind::Photos,
        "Photos of an object",
        "Gives a labelled 3-D model; cameras and depth are computed",
    ),
    (
        SourceKind::Video,
        "Video",
        "Gives masks on every frame, and a 3-D model if the camera moves",
    ),
    (
        SourceKind::Recording,
        "RGB-D recording",
        "Gives a labelled 3-D model in metres from the measured depth",
    ),
];

/// Draws the first page: what can be opened, the example and recent projects.
pub(crate) fn welcome_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    textures: &mut Textures,
    requests: &mut Requests,
) {
    let rows = session.recent.len().min(8).div_ceil(2) as f32;
    let height = 390.0 + (RECENT_HEIGHT + 4.0) * rows;
    let space = ((ui.available_height() - height) * 0.35).max(14.0);
    let width = (ui.available_width() - 40.0).min(WIDTH);
    let margin = (ui.available_width() - width) * 0.5;
    egui::ScrollArea::vertical()
        .auto_shrink([false, false])
        .show(ui, |ui| {
            ui.add_space(space);
            ui.horizontal(|ui| {
                ui.add_space(margin);
                ui.allocate_ui_with_layout(
                    Vec2::new(width, 0.0),
                    Layout::top_down(Align::Min),
                    |ui| page_ui(ui, session, view, textures, requests),
                );
            });
            ui.add_space(12.0);
        });
}

fn page_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    textures: &mut Textures,
    requests: &mut Requests,
) {
    ui.spacing_mut().item_spacing = Vec2::new(GAP, 5.0);
    ui.label(RichText::new("OSTRA").size(28.0).strong());
    ui.label(
        RichText::new("Turn photos and videos into labelled 3-D models")
            .weak()
            .size(15.0),
    );
    ui.add_space(14.0);
    ui.horizontal(|ui| {
        let width = (ui.available_width() - 2.0 * GAP) / 3.0;
        for (kind, title, text) in CARDS {
            let size = Vec2::new(width, CARD_HEIGHT);
            if card_ui(ui, size, kind, [title, text]).clicked() {
                view.new_project = NewProjectForm::of(kind);
                view.dialog = Some(Dialog::NewProject);
            }
        }
    });
    ui.add_space(8.0);
    drop_zone_ui(ui);
    ui.add_space(8.0);
    buttons_ui(ui, session, view, &mut requests.actions);
    ui.add_space(14.0);
    recent_ui(ui, session, textures, &mut requests.commands);
}

/// Text that is part of a larger button, and therefore no widget of its own.
struct PaintedText<'a> {
    text: &'a str,
    size: f32,
    color: Color32,
    /// Maximum number of rows; a longer text ends in an ellipsis.
    rows: usize,
}

/// Paints a text into `rect` and returns its height.
fn text_ui(ui: &Ui, rect: Rect, painted: &PaintedText<'_>) -> f32 {
    let font = egui::FontId::proportional(painted.size);
    let mut job =
        egui::text::LayoutJob::simple(painted.text.to_owned(), font, painted.color, rect.width());
    job.wrap.max_rows = painted.rows;
    job.wrap.break_anywhere = painted.rows == 1;
    let galley = ui.painter().layout_job(job);
    let height = galley.size().y;
    ui.painter().galley(rect.min, galley, painted.color);
    height
}

/// Draws a card with an icon, a title and a line of text; the whole card is a button.
fn card_ui(
    ui: &mut Ui,
    size: Vec2,
    kind: SourceKind,
    [title, text]: [&'static str; 2],
) -> egui::Response {
    let (rect, response) = ui.allocate_exact_size(size, Sense::click());
    response.widget_info(|| WidgetInfo::labeled(egui::Role::Button, true, title));
    let visuals = ui.style().interact(&response);
    let is_raised = response.hovered() || response.has_focus();
    let (fill, stroke) = if is_raised {
        let stroke = Stroke::new(1.5, ui.visuals().hyperlink_color);
        (visuals.weak_bg_fill, stroke)
    } else {
        let stroke = ui.visuals().widgets.noninteractive.bg_stroke;
        (ui.visuals().faint_bg_color, stroke)
    };
    ui.painter()
        .rect(rect, 8.0, fill, stroke, egui::StrokeKind::Inside);
    let inner = rect.shrink(14.0);
    let icon = Rect::from_min_size(inner.min, Vec2::new(40.0, 28.0));
    icon_ui(ui, icon, kind);
    let inner = inner.with_min_y(icon.bottom() + 10.0);
    let strong = ui.visuals().strong_text_color();
    let height = text_ui(
        ui,
        inner,
        &PaintedText {
            text: title,
            size: 15.0,
            color: strong,
            rows: 1,
        },
    );
    let inner = inner.with_min_y(inner.top() + height + 4.0);
    let color = ui.visuals().weak_text_color();
    text_ui(
        ui,
        inner,
        &PaintedText {
            text,
            size: 12.5,
            color,
            rows: 3,
        },
    );
    response.on_hover_text("Choose the files and create a project")
}

/// Draws an icon: stacked photos, a video, or an image with depth.
fn icon_ui(ui: &Ui, rect: Rect, kind: SourceKind) {
    let color = ui.visuals().hyperlink_color;
    let line = Stroke::new(1.6, color);
    let painter = ui.painter();
    let frame = |rect: Rect| {
        painter.rect_stroke(rect, 3.0, line, egui::StrokeKind::Inside);
    };
    let front = Rect::from_min_size(rect.min + Vec2::new(0.0, 5.0), Vec2::new(32.0, 23.0));
    match kind {
        SourceKind::Any | SourceKind::Photos => {
            let back = front.translate(Vec2::new(7.0, -5.0));
            painter.line_segment([back.left_top(), back.right_top()], line);
            painter.line_segment([back.right_top(), back.right_bottom()], line);
            frame(front);
            let at = |x: f32, y: f32| front.min + Vec2::new(x, y);
            painter.line_segment([at(4.0, 19.0), at(13.0, 9.0)], line);
            painter.line_segment([at(13.0, 9.0), at(20.0, 17.0)], line);
            painter.circle_filled(at(24.0, 8.0), 2.5, color);
        }
        SourceKind::Video => {
            let screen = Rect::from_min_size(rect.min, Vec2::new(38.0, 28.0));
            frame(screen);
            let at = |x: f32, y: f32| screen.center() + Vec2::new(x, y);
            let triangle = vec![at(-5.0, -7.0), at(8.0, 0.0), at(-5.0, 7.0)];
            painter.add(egui::Shape::convex_polygon(triangle, color, Stroke::NONE));
        }
        SourceKind::Recording => {
            frame(front);
            for step in 0..4_u8 {
                let layer = front.shrink2(Vec2::new(4.0, 4.0));
                let left = layer.left() + layer.width() * f32::from(step) / 4.0;
                let bar = Rect::from_min_max(
                    egui::pos2(left, layer.top()),
                    egui::pos2(left + layer.width() / 4.0, layer.bottom()),
                );
                let shade = color.gamma_multiply(0.2 + 0.2 * f32::from(step));
                painter.rect_filled(bar, 0.0, shade);
            }
        }
    }
}

/// Draws the place for dropped files, which is highlighted while files hover over the window.
fn drop_zone_ui(ui: &mut Ui) {
    let hovered = ui.input(|input| !input.raw.hovered_files.is_empty());
    let size = Vec2::new(ui.available_width(), 58.0);
    let (rect, _) = ui.allocate_exact_size(size, Sense::hover());
    let (stroke, fill) = if hovered {
        (
            Stroke::new(2.0, ui.visuals().hyperlink_color),
            ui.visuals().selection.bg_fill.gamma_multiply(0.4),
        )
    } else {
        let color = ui.visuals().weak_text_color();
        (Stroke::new(1.2, color), Color32::TRANSPARENT)
    };
    ui.painter().rect_filled(rect, 8.0, fill);
    let outline = rect.shrink(1.0);
    let corners = [
        outline.left_top(),
        outline.right_top(),
        outline.right_bottom(),
        outline.left_bottom(),
        outline.left_top(),
    ];
    ui.painter()
        .extend(egui::Shape::dashed_line(&corners, stroke, 7.0, 5.0));
    let text = if hovered {
        "Drop to open"
    } else {
        "Drop photos, a folder, a video or a project here"
    };
    let mut inside = ui.new_child(
        egui::UiBuilder::new()
            .max_rect(rect)
            .layout(Layout::centered_and_justified(egui::Direction::TopDown)),
    );
    let text = RichText::new(text).size(14.0);
    let text = if hovered { text.strong() } else { text.weak() };
    inside.add(egui::Label::new(text).selectable(false));
}

fn buttons_ui(ui: &mut Ui, session: &SessionView<'_>, view: &ViewState, actions: &mut Vec<Action>) {
    if let Some(job) = session.running(&JobTask::Example) {
        ui.horizontal(|ui| {
            ui.spinner();
            ui.label(format!("{}: {}", job.title, progress_text(job)));
            let fraction = job.overview.fraction;
            let bar = egui::ProgressBar::new(fraction.unwrap_or(0.0) as f32)
                .animate(fraction.is_none())
                .desired_width(180.0)
                .desired_height(8.0);
            ui.add(bar)
                .accessible_name(format!("Progress of {}", job.title));
            let tip = view.prefs.shortcuts.tip(ui.ctx(), Action::Stop);
            if ui
                .button("Stop")
                .on_hover_text(tip)
                .accessible_name("Stop making the example")
                .clicked()
            {
                actions.push(Action::Stop);
            }
        });
        return;
    }
    ui.horizontal_wrapped(|ui| {
        for action in [Action::Example, Action::Open, Action::Inspect] {
            if action == Action::Example && !view.has_example {
                continue;
            }
            let mut button = Button::new(RichText::new(action.text()).size(14.0))
                .min_size(Vec2::new(150.0, 30.0));
            if action == Action::Example {
                button = button.fill(ui.visuals().selection.bg_fill);
            }
            let tip = view.prefs.shortcuts.tip(ui.ctx(), action);
            if ui.add(button).on_hover_text(tip).clicked() {
                actions.push(action);
            }
        }
    });
}

fn recent_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    textures: &mut Textures,
    out: &mut Vec<Command>,
) {
    if session.recent.is_empty() {
        return;
    }
    ui.label(RichText::new("Recent projects").strong().size(14.0));
    ui.add_space(2.0);
    let width = (ui.available_width() - GAP) / 2.0;
    for pair in session.recent[..session.recent.len().min(8)].chunks(2) {
        ui.horizontal(|ui| {
            for path in pair {
                let known = session
                    .recent_projects
                    .and_then(|projects| projects.get(path));
                let size = Vec2::new(width, RECENT_HEIGHT);
                if recent_project_ui(ui, size, path, known, textures).clicked() {
                    out.push(Command::Open(path.clone()));
                }
            }
        });
    }
}

/// Draws a recent project with the first frame, its name and its path, as one button.
fn recent_project_ui(
    ui: &mut Ui,
    size: Vec2,
    path: &Path,
    known: Option<&RecentProject>,
    textures: &mut Textures,
) -> egui::Response {
    let name = path.file_name().map_or_else(
        || path.display().to_string(),
        |name| name.to_string_lossy().into_owned(),
    );
    let reason = match known {
        Some(RecentProject::Unavailable(reason)) => Some(reason.as_str()),
        _ => None,
    };
    let sense = if reason.is_none() {
        Sense::click()
    } else {
        Sense::hover()
    };
    let (rect, response) = ui.allocate_exact_size(size, sense);
    response.widget_info(|| {
        let label = match reason {
            None => format!("Open {name}"),
            Some(reason) => format!("{name}: {reason}"),
        };
        WidgetInfo::labeled(egui::Role::Button, reason.is_none(), label)
    });
    if response.hovered() || response.has_focus() {
        let fill = ui.visuals().widgets.hovered.weak_bg_fill;
        ui.painter().rect_filled(rect, 6.0, fill);
    }
    let image = Rect::from_min_size(rect.min + Vec2::splat(4.0), Vec2::new(58.0, 44.0));
    first_frame_ui(ui, image, known, textures);
    let inner = rect.shrink(6.0).with_min_x(image.right() + 10.0);
    let weak = ui.visuals().weak_text_color();
    let color = match reason {
        None => ui.visuals().strong_text_color(),
        Some(_) => weak,
    };
    let height = text_ui(
        ui,
        inner,
        &PaintedText {
            text: &name,
            size: 13.5,
            color,
            rows: 1,
        },
    );
    let parent = path.parent().unwrap_or(path).display().to_string();
    let below = reason.map_or(parent, |reason| format!("Cannot be opened: {reason}"));
    let inner = inner.with_min_y(inner.top() + height + 3.0);
    text_ui(
        ui,
        inner,
        &PaintedText {
            text: &below,
            size: 11.0,
            color: weak,
            rows: 1,
        },
    );
    let tip = match (reason, known) {
        (Some(reason), _) => format!("{}: {reason}", path.display()),
        (None, Some(RecentProject::Available { frames, .. })) => {
            format!("{} ({frames} frames)", path.display())
        }
        _ => path.display().to_string(),
    };
    response.on_hover_text(tip)
}

/// Draws the first frame of a project, cut to fill `rect`; without one, an empty tile.
fn first_frame_ui(ui: &Ui, rect: Rect, known: Option<&RecentProject>, textures: &mut Textures) {
    let Some(RecentProject::Available {
        thumbnail: Some(image),
        ..
    }) = known
    else {
        let fill = ui.visuals().widgets.inactive.weak_bg_fill;
        ui.painter().rect_filled(rect, 3.0, fill);
        return;
    };
    let texture = textures.small(ui.ctx(), image);
    let (wide, tall) = (
        image.width as f32 / rect.width(),
        image.height as f32 / rect.height(),
    );
    let shown = Vec2::new((tall / wide).min(1.0), (wide / tall).min(1.0));
    let part = Rect::from_center_size(egui::pos2(0.5, 0.5), shown);
    ui.painter().image(texture.id(), rect, part, Color32::WHITE);
}
