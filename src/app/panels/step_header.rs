//! Header rows of the steps and their icons.

use egui::{Align2, Color32, FontId, Pos2, Rect, Response, Role, Sense, Shape, Stroke, Ui, Vec2};

use ostra_project::workflow::{StepState, WorkflowStep};

/// What a header shows.
pub(super) struct StepHeader<'a> {
    pub step: WorkflowStep,
    /// Place in the order, from 1.
    pub number: usize,
    pub state: StepState,
    pub is_running: bool,
    pub is_open: bool,
    pub text: &'a str,
}

/// Returns the title of a step.
pub(super) fn title(step: WorkflowStep) -> &'static str {
    match step {
        WorkflowStep::Label => "Label",
        WorkflowStep::Track => "Track",
        WorkflowStep::Geometry => "Cameras & depth",
        WorkflowStep::Cloud => "Cloud",
        WorkflowStep::Measure => "Measure & export",
    }
}

impl StepHeader<'_> {
    /// Returns the state in words, for screen readers and tooltips.
    pub(super) fn spoken(&self) -> String {
        let state = match self.state {
            _ if self.is_running => "running",
            StepState::Open => "not done",
            StepState::Next => "next",
            StepState::Done => "done",
            StepState::Stale => "stale",
        };
        format!("{}: {state}, {}", title(self.step), self.text)
    }

    /// Draws the header as a row that opens the step when clicked.
    pub(super) fn show(&self, ui: &mut Ui) -> Response {
        let size = Vec2::new(ui.available_width(), 30.0);
        let (rect, response) = ui.allocate_exact_size(size, Sense::click());
        self.describe(&response);
        let visuals = ui.visuals();
        let fill = match (self.is_open, response.hovered()) {
            (true, _) => visuals.widgets.inactive.weak_bg_fill,
            (false, true) => visuals.widgets.hovered.weak_bg_fill,
            (false, false) => visuals.faint_bg_color,
        };
        ui.painter().rect_filled(rect, 4.0, fill);
        if response.has_focus() {
            let stroke = visuals.selection.stroke;
            ui.painter()
                .rect_stroke(rect, 4.0, stroke, egui::StrokeKind::Inside);
        }
        self.icon(ui, rect.left_center() + Vec2::new(16.0, 0.0));
        let strong = visuals.strong_text_color();
        let color = if self.is_open {
            strong
        } else {
            visuals.text_color()
        };
        let at = rect.left_center() + Vec2::new(32.0, 0.0);
        let font = FontId::proportional(14.0);
        let written = ui
            .painter()
            .text(at, Align2::LEFT_CENTER, title(self.step), font, color);
        self.note(ui, rect, written.right());
        response.on_hover_text(self.spoken())
    }

    /// Draws only the icon, for the narrow strip.
    pub(super) fn show_small(&self, ui: &mut Ui) -> Response {
        let (rect, response) = ui.allocate_exact_size(Vec2::splat(30.0), Sense::click());
        self.describe(&response);
        if response.hovered() || response.has_focus() {
            let fill = ui.visuals().widgets.hovered.weak_bg_fill;
            ui.painter().rect_filled(rect, 4.0, fill);
        }
        self.icon(ui, rect.center());
        response.on_hover_text(self.spoken())
    }

    fn describe(&self, response: &Response) {
        let name = self.spoken();
        response
            .widget_info(|| egui::WidgetInfo::selected(Role::Button, true, self.is_open, &name));
    }

    /// Writes the state at the right end, cut to the space after the title.
    fn note(&self, ui: &Ui, rect: Rect, left: f32) {
        let color = match self.state {
            StepState::Stale => ui.visuals().warn_fg_color,
            _ => ui.visuals().weak_text_color(),
        };
        let text = if self.is_running {
            "running…"
        } else {
            self.text
        };
        let font = FontId::proportional(11.0);
        let mut job = egui::text::LayoutJob::simple_singleline(text.to_owned(), font, color);
        let width = rect.right() - 8.0 - (left + 8.0);
        job.wrap = egui::text::TextWrapping::truncate_at_width(width.max(0.0));
        let galley = ui.painter().layout_job(job);
        let at = Pos2::new(
            rect.right() - 8.0 - galley.size().x,
            rect.center().y - galley.size().y / 2.0,
        );
        ui.painter().galley(at, galley, color);
    }

    /// Paints the number, or a tick, a warning sign or a turning arc; they differ in shape.
    fn icon(&self, ui: &Ui, at: Pos2) {
        let painter = ui.painter();
        let accent = ui.visuals().hyperlink_color;
        if self.is_running {
            let time = ui.input(|input| input.time) as f32;
            let arc = (0..=12).map(|k| at + 7.0 * Vec2::angled(4.0 * time + k as f32 / 12.0 * 4.2));
            painter.add(Shape::line(arc.collect(), Stroke::new(2.0, accent)));
            return;
        }
        match self.state {
            StepState::Done => {
                painter.circle_filled(at, 8.0, Color32::from_rgb(60, 150, 90));
                let tick = [(-3.5, 0.2), (-1.0, 3.0), (3.8, -2.8)];
                let tick = tick.map(|(x, y)| at + Vec2::new(x, y));
                painter.add(Shape::line(tick.to_vec(), Stroke::new(1.8, Color32::WHITE)));
            }
            StepState::Stale => {
                let corners = [(0.0, -8.0), (8.5, 6.5), (-8.5, 6.5)];
                let corners = corners.map(|(x, y)| at + Vec2::new(x, y));
                painter.add(Shape::convex_polygon(
                    corners.to_vec(),
                    ui.visuals().warn_fg_color,
                    Stroke::NONE,
                ));
                let font = FontId::proportional(11.0);
                painter.text(
                    at + Vec2::new(0.0, 1.5),
                    Align2::CENTER_CENTER,
                    "!",
                    font,
                    Color32::BLACK,
                );
            }
            state => {
                let is_next = state == StepState::Next;
                let color = if is_next {
                    Color32::WHITE
                } else {
                    ui.visuals().weak_text_color()
                };
                if is_next {
                    painter.circle_filled(at, 8.5, Color32::from_rgb(44, 108, 190));
                } else {
                    painter.circle_stroke(at, 8.0, Stroke::new(1.2, color));
                }
                let font = FontId::proportional(11.0);
                let number = self.number.to_string();
                painter.text(at, Align2::CENTER_CENTER, number, font, color);
            }
        }
    }
}
