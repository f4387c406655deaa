use std::ops::Range;

use egui::{Color32, Pos2, Rect, Role, Sense, Stroke, Ui, Vec2, WidgetInfo, lerp};

use crate::frame_review::FrameHeat;
use crate::{SessionView, ViewState};
use ostra_project::MaskOrigin;

/// Colour of keyframes.
pub(super) const CONFIRMED: Color32 = Color32::from_rgb(80, 190, 110);

/// Height of the strip in points.
pub(crate) const HEAT_HEIGHT: f32 = 9.0;

/// Draws a strip of all frames, coloured by confidence; a click or drag goes to the frame.
///
/// Low confidence of the tracker and conflict with the vote of all views are bright, high
/// confidence is dark. Keyframes without a notable conflict are green.
pub(crate) fn heat_ui(ui: &mut Ui, session: &SessionView<'_>, view: &mut ViewState) {
    let size = Vec2::new(ui.available_width(), HEAT_HEIGHT);
    let (rect, response) = ui.allocate_exact_size(size, Sense::click_and_drag());
    response.widget_info(|| WidgetInfo::labeled(Role::Slider, true, "Confidence over frames"));
    let columns = Columns {
        rect,
        frames: 0..session.project.frames.len(),
    };
    ui.painter()
        .rect_filled(rect, 2.0, ui.visuals().extreme_bg_color);
    columns.paint(ui, |frames| worst(ui, view, frames));
    for frame in [
        view.range.map(|range| range.0),
        view.range.map(|range| range.1),
    ]
    .into_iter()
    .flatten()
    {
        mark(ui, &columns, frame, ui.visuals().selection.stroke.color);
    }
    mark(ui, &columns, view.frame, ui.visuals().strong_text_color());
    let pointed = response
        .interact_pointer_pos()
        .filter(|_| response.clicked() || response.dragged());
    if let Some(frame) = pointed.and_then(|at| columns.frame_at(at)) {
        view.go_to(frame);
    }
    let hovered = response.hover_pos().and_then(|at| columns.frame_at(at));
    if let Some(frame) = hovered {
        response.on_hover_ui_at_pointer(|ui| tip_ui(ui, session, view, frame));
    }
}

/// Frames as columns of equal width in a rectangle.
pub(super) struct Columns {
    pub(super) rect: Rect,
    pub(super) frames: Range<usize>,
}

impl Columns {
    /// Returns the width of a frame in points.
    fn width(&self) -> f32 {
        self.rect.width() / self.frames.len().max(1) as f32
    }

    /// Returns the frame at a screen position, clamped to the first and last frame.
    ///
    /// Returns `None` if there are no frames.
    pub(super) fn frame_at(&self, at: Pos2) -> Option<usize> {
        let column = ((at.x - self.rect.left()) / self.width()).max(0.0) as usize;
        (!self.frames.is_empty()).then(|| (self.frames.start + column).min(self.frames.end - 1))
    }

    /// Returns the rectangle of a range of frames, `last` included, at least one point wide.
    pub(super) fn place(&self, first: usize, last: usize) -> Rect {
        let x = |frame: usize| {
            self.rect.left() + (frame as f32 - self.frames.start as f32) * self.width()
        };
        let (left, right) = (x(first), x(last + 1));
        Rect::from_x_y_ranges(left..=right.max(left + 1.0), self.rect.y_range())
            .intersect(self.rect)
    }

    /// Fills every column with the colour of its frames.
    ///
    /// Frames narrower than a point share a column. Adjacent columns of one colour become one
    /// rectangle.
    pub(super) fn paint(&self, ui: &Ui, color: impl Fn(Range<usize>) -> Option<Color32>) {
        let step = ((1.0 / self.width()).ceil() as usize).max(1);
        let mut run: Option<(usize, usize, Color32)> = None;
        let flush = |run: Option<(usize, usize, Color32)>| {
            if let Some((first, last, color)) = run {
                ui.painter()
                    .rect_filled(self.place(first, last), 0.0, color);
            }
        };
        for first in self.frames.clone().step_by(step) {
            let end = (first + step).min(self.frames.end);
            let new = color(first..end);
            match (&mut run, new) {
                (Some((_, last, old)), Some(new)) if *old == new => *last = end - 1,
                _ => {
                    flush(run.take());
                    run = new.map(|color| (first, end - 1, color));
                }
            }
        }
        flush(run);
    }
}

/// Draws a line down the middle of a frame's column.
pub(super) fn mark(ui: &Ui, columns: &Columns, frame: usize, color: Color32) {
    if columns.frames.contains(&frame) {
        let place = columns.place(frame, frame);
        ui.painter().vline(
            place.center().x,
            columns.rect.y_range(),
            Stroke::new(2.0, color),
        );
    }
}

/// Returns the colour of a confidence: dark and cool at 1, amber at 0.5, red at 0.
pub(super) fn heat(confidence: f32) -> Color32 {
    const STOPS: [(f32, [f32; 3]); 4] = [
        (0.0, [235.0, 60.0, 50.0]),
        (0.5, [240.0, 170.0, 50.0]),
        (0.8, [110.0, 140.0, 120.0]),
        (1.0, [52.0, 92.0, 104.0]),
    ];
    let confidence = confidence.clamp(0.0, 1.0);
    let after = STOPS
        .iter()
        .position(|stop| stop.0 >= confidence)
        .unwrap_or(STOPS.len() - 1)
        .max(1);
    let ((from, a), (to, b)) = (STOPS[after - 1], STOPS[after]);
    let share = (confidence - from) / (to - from);
    let [r, g, b] = [0, 1, 2].map(|k| lerp(a[k]..=b[k], share) as u8);
    Color32::from_rgb(r, g, b)
}

/// Returns the colour of the frame that needs attention most, among frames that share a column.
fn worst(ui: &Ui, view: &ViewState, frames: Range<usize>) -> Option<Color32> {
    let mut is_confirmed = false;
    let mut least: Option<f32> = None;
    for heat in view.frames.heat.get(frames)? {
        match *heat {
            FrameHeat::Empty => {}
            FrameHeat::Confirmed => is_confirmed = true,
            FrameHeat::Stale => return Some(ui.visuals().warn_fg_color),
            FrameHeat::Confidence(confidence) => {
                least = Some(least.map_or(confidence, |least| least.min(confidence)));
            }
        }
    }
    let confirmed = is_confirmed.then_some(CONFIRMED);
    least
        .filter(|&confidence| confidence < view.prefs.flag_below)
        .map(heat)
        .or(confirmed)
        .or(least.map(heat))
}

fn tip_ui(ui: &mut Ui, session: &SessionView<'_>, view: &ViewState, frame: usize) {
    ui.strong(format!("Frame {frame}"));
    match session.project.masks.get(&frame) {
        None => drop(ui.weak("no mask")),
        Some(mask) if mask.origin == MaskOrigin::Keyframe => drop(ui.label("keyframe")),
        Some(_) => drop(ui.label("tracked")),
    }
    check_reasons_ui(ui, session, view, frame);
    if let Some(conflict) = session.conflicts.get(&frame) {
        ui.weak(format!(
            "{:.1} % in conflict with the 3-D vote",
            100.0 * conflict.share()
        ));
    }
}

/// Lists why a frame is to be checked, if it is.
pub(super) fn check_reasons_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &ViewState,
    frame: usize,
) {
    for reason in view
        .frames
        .review
        .to_check
        .get(&frame)
        .into_iter()
        .flatten()
    {
        let text = format!("To check: {}", reason.text(&session.project.labels));
        ui.colored_label(ui.visuals().warn_fg_color, text);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frame_at_inverts_place() {
        let rect = Rect::from_min_size(Pos2::new(10.0, 0.0), Vec2::new(200.0, 9.0));
        for frames in [0..7, 3..40, 0..3000] {
            let columns = Columns {
                rect,
                frames: frames.clone(),
            };
            for frame in frames.step_by(13) {
                let place = columns.place(frame, frame);
                let found = columns.frame_at(place.center()).unwrap();
                assert!(
                    found.abs_diff(frame) <= (1.0 / columns.width()) as usize,
                    "{frame} {found}"
                );
            }
            assert_eq!(
                columns.frame_at(Pos2::new(9999.0, 0.0)),
                Some(columns.frames.end - 1)
            );
        }
        assert_eq!(Columns { rect, frames: 0..0 }.frame_at(rect.center()), None);
    }

    #[test]
    fn low_confidence_is_red() {
        assert!(heat(0.1).r() > 200 && heat(0.95).r() < 80);
    }
}
