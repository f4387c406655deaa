use std::ops::Range;

use egui::{Color32, Pos2, Rect, Role, Sense, Stroke, Ui, Vec2, WidgetInfo, lerp};

use crate::ranges::lost_on;
use crate::{SessionView, ViewState};
use ostra_masks::LabelId;
use ostra_project::{FrameMask, MaskOrigin};

/// Height of the strip in points.
pub(crate) const HEAT_HEIGHT: f32 = 9.0;

/// Share of conflicting pixels at which a frame gets confidence 0.
const WORST_SHARE: f32 = 0.2;

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
    columns.paint(ui, |frames| worst(ui, session, view, frames));
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

fn worst(
    ui: &Ui,
    session: &SessionView<'_>,
    view: &ViewState,
    frames: Range<usize>,
) -> Option<Color32> {
    let mut keyframe = None;
    let mut least: Option<f32> = None;
    for (&frame, mask) in session.project.masks.range(frames) {
        match sureness(session, view, frame, mask) {
            Some(confidence) => {
                least = Some(least.map_or(confidence, |least| least.min(confidence)));
            }
            None => keyframe = Some(Color32::from_rgb(80, 190, 110)),
        }
    }
    let stale = |confidence: f32| {
        if confidence < 0.0 {
            ui.visuals().warn_fg_color
        } else {
            heat(confidence)
        }
    };
    least
        .filter(|&confidence| confidence < view.prefs.flag_below)
        .map(stale)
        .or(keyframe)
        .or(least.map(stale))
}

/// Returns the lowest confidence on a frame: 0 if a label was lost, negative if it is stale.
///
/// Returns `None` for a keyframe without a notable conflict with the vote.
fn sureness(
    session: &SessionView<'_>,
    view: &ViewState,
    frame: usize,
    mask: &FrameMask,
) -> Option<f32> {
    let by_vote = session.conflicts.get(&frame).map_or(1.0, |conflict| {
        (1.0 - conflict.share() / WORST_SHARE).max(0.0)
    });
    if mask.origin == MaskOrigin::Keyframe {
        return Some(by_vote).filter(|&confidence| confidence < view.prefs.flag_below);
    }
    let least = mask.confidence.values().copied().fold(by_vote, f32::min);
    let lost = lost_on(session.project, view, frame).next().is_some();
    Some(if mask.stale {
        -1.0
    } else if lost {
        0.0
    } else {
        least
    })
}

fn tip_ui(ui: &mut Ui, session: &SessionView<'_>, view: &ViewState, frame: usize) {
    ui.strong(format!("Frame {frame}"));
    if let Some(conflict) = session.conflicts.get(&frame) {
        ui.label(format!(
            "{:.1} % in conflict with the 3-D vote",
            100.0 * conflict.share()
        ));
    }
    let name = |label: LabelId| {
        session
            .project
            .labels
            .get(label)
            .map_or("?", |label| label.name.as_str())
    };
    match session.project.masks.get(&frame) {
        None => drop(ui.weak("no mask")),
        Some(mask) if mask.origin == MaskOrigin::Keyframe => drop(ui.label("keyframe")),
        Some(mask) => {
            if mask.stale {
                ui.colored_label(ui.visuals().warn_fg_color, "stale");
            }
            for (&label, confidence) in &mask.confidence {
                ui.label(format!(
                    "{}: {:.0} % confidence",
                    name(label),
                    confidence * 100.0
                ));
            }
            for label in lost_on(session.project, view, frame) {
                ui.colored_label(ui.visuals().warn_fg_color, format!("{}: lost", name(label)));
            }
        }
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
