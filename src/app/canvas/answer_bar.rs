use egui::{Align2, Area, Button, Frame, Rect, Ui};

use super::draft::Tool;
use super::prompts::{answer_again, resized, set_size};
use crate::network_offer::{ClickOffer, click_offer, click_offer_ui};
use crate::tooltips::icon_button;
use crate::{Action, SessionView, ViewState};
use ostra_masks::{AnswerSize, LabelId, RunMask};
use ostra_session::Command;

/// Share of the image above which the answer to a click is probably too large.
const MUCH: f64 = 0.25;
/// Number of image borders that a probably too large answer touches.
const MANY_BORDERS: usize = 3;

/// Hint at the answer to one click on a frame without depth, where it is often wrong.
const WITHOUT_DEPTH: &str =
    "Right size? Alt+wheel makes the answer smaller or larger. For a stem, use Stem & wire.";

/// Height of a bar of three rows with its margins.
const BAR_HEIGHT: f32 = 110.0;
/// Distance of the bar from the edge of the image pane.
const BAR_MARGIN: f32 = 8.0;

/// How far a label extends on a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
struct LabelSpread {
    /// Share of the image.
    share: f64,
    /// Number of image borders that it touches.
    borders: usize,
}

impl LabelSpread {
    fn of(mask: &RunMask, label: LabelId) -> Self {
        let (width, height) = (u64::from(mask.width), u64::from(mask.height));
        let (mut area, mut at) = (0, 0);
        let mut touched = [false; 4];
        for &(id, length) in &mask.runs {
            let (first, end) = (at, at + u64::from(length));
            at = end;
            if id != label || first == end {
                continue;
            }
            area += end - first;
            let (column, last) = (first % width, (end - 1) % width);
            let spans_rows = first / width != (end - 1) / width;
            touched[0] |= first < width;
            touched[1] |= end > width * (height - 1);
            touched[2] |= column == 0 || spans_rows;
            touched[3] |= last + 1 == width || spans_rows;
        }
        Self {
            share: area as f64 / (width * height).max(1) as f64,
            borders: touched.into_iter().filter(|&touched| touched).count(),
        }
    }

    fn is_much(self) -> bool {
        self.share > MUCH || self.borders >= MANY_BORDERS
    }
}

/// Returns the message of the bar, or `None` if the last answer needs none.
fn message(session: &SessionView<'_>, view: &ViewState) -> Option<String> {
    if let Some((frame, text)) = &view.answer.unchanged {
        return (*frame == view.frame).then(|| text.clone());
    }
    let (frame, label) = session.last_prompt?;
    if frame != view.frame || view.tool != Tool::Click || view.answer.closed == Some((frame, label))
    {
        return None;
    }
    let prompt = session.project.prompts.get(&(frame, label))?;
    let size = view.draft.prompt(session.project, frame, label).size;
    let mask = &session.project.masks.get(&frame)?.runs;
    let is_include = prompt.clicks.last().is_some_and(|click| click.include);
    if is_include && LabelSpread::of(mask, label).is_much() {
        return Some(
            "Too much? Right-click what does not belong, or drag a box. For a stem, use Stem & wire."
                .into(),
        );
    }
    let is_first = session.project.prompts.len() == 1 && session.project.masks.len() == 1;
    if is_include && is_first && prompt.clicks.len() == 1 && size == AnswerSize::Automatic {
        let name = &session.project.labels.get(label)?.name;
        return Some(format!(
            "Labelled as '{name}'. Ctrl+click labels another object."
        ));
    }
    if size != AnswerSize::Automatic {
        return Some(format!("Answer to the last click: {}", size.name()));
    }
    let has_depth = session.project.frames.get(frame)?.depth.is_some();
    let is_one_click = prompt.clicks.len() == 1 && prompt.boxes.is_empty();
    (is_include && is_one_click && !has_depth).then(|| WITHOUT_DEPTH.into())
}

/// Draws a bar over the lower edge of the image if the last answer is probably not what was meant,
/// or if a network would answer better.
///
/// It covers the image instead of moving it, but not the last click: near that, it is over the upper
/// edge.
pub(super) fn answer_bar_ui(
    ui: &Ui,
    pane: Rect,
    session: &SessionView<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
) {
    let mut offer = click_offer(ui.ctx(), session, view, out);
    if matches!(offer, Some(ClickOffer::Installed)) {
        offer = None;
        answer_again(session, view, out);
    }
    let text = message(session, view);
    if view.dialog.is_some() || (text.is_none() && offer.is_none()) {
        return;
    }
    let (pivot, at) = if last_click_is_low(pane, session, view) {
        let at = pane.center_top() + egui::vec2(0.0, BAR_MARGIN);
        (Align2::CENTER_TOP, at)
    } else {
        let at = pane.center_bottom() - egui::vec2(0.0, BAR_MARGIN);
        (Align2::CENTER_BOTTOM, at)
    };
    Area::new(ui.scope_id().with("answer"))
        .pivot(pivot)
        .fixed_pos(at)
        .constrain_to(pane)
        .show(ui.ctx(), |ui| {
            Frame::popup(ui.style()).show(ui, |ui| {
                ui.set_max_width((pane.width() - 40.0).max(80.0));
                if let Some(text) = text {
                    ui.horizontal_wrapped(|ui| {
                        ui.label(text);
                        size_buttons_ui(ui, session, view, out);
                        if icon_button(ui, "×", "Close hint", "Close this hint").clicked() {
                            view.answer.unchanged = None;
                            view.answer.closed = session.last_prompt;
                        }
                    });
                }
                if let Some(offer) = offer {
                    click_offer_ui(ui, &offer, session, view, out);
                }
            });
        });
}

/// Returns whether a bar over the lower edge would cover the last click.
fn last_click_is_low(pane: Rect, session: &SessionView<'_>, view: &ViewState) -> bool {
    let last_click = || {
        let (frame, label) = session.last_prompt?;
        let prompt = session.project.prompts.get(&(frame, label))?;
        let click = prompt.clicks.last().filter(|_| frame == view.frame)?;
        Some(view.canvas_map?.to_screen(click.at_px))
    };
    last_click().is_some_and(|at| pane.contains(at) && at.y > pane.bottom() - BAR_HEIGHT)
}

fn size_buttons_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
) {
    if resized(session, view).is_none() {
        return;
    }
    let sizes = [
        ("Smaller", false, Action::SmallerBrush),
        ("Larger", true, Action::LargerBrush),
    ];
    for (text, up, action) in sizes {
        let next = resized(session, view).and_then(|answer| answer.size.stepped(up));
        let keys = view.prefs.shortcuts.text(ui.ctx(), action);
        let tip = format!(
            "Give the last click a {} answer (Alt+wheel over the image, or {keys})",
            text.to_lowercase()
        );
        let button = ui
            .add_enabled(next.is_some(), Button::new(text))
            .on_hover_text(tip)
            .on_disabled_hover_text("There is no further size");
        if button.clicked()
            && let Some(size) = next
        {
            set_size(session, view, size, out);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ostra_masks::LabelMask;

    fn spread(inside: impl Fn(u32, u32) -> bool) -> LabelSpread {
        let mut mask = LabelMask::empty(10, 8);
        for at in 0..80 {
            if inside(at % 10, at / 10) {
                mask.ids[at as usize] = LabelId(2);
            }
        }
        LabelSpread::of(&RunMask::encode(&mask), LabelId(2))
    }

    #[test]
    fn spread_counts_pixels_and_borders() {
        let middle = spread(|x, y| (2..5).contains(&x) && (2..5).contains(&y));
        assert_eq!((middle.borders, middle.is_much()), (0, false));
        assert!((middle.share - 9.0 / 80.0).abs() < 1e-9);
        let column = spread(|x, _| x == 0);
        assert_eq!(column.borders, 3, "left, top and bottom");
        let corner = spread(|x, y| x == 9 && y == 0);
        assert_eq!((corner.borders, corner.is_much()), (2, false));
        let rows = spread(|_, y| (2..6).contains(&y));
        assert_eq!(
            (rows.borders, rows.is_much()),
            (2, true),
            "half of the image"
        );
        let all = spread(|_, _| true);
        assert_eq!(all.borders, 4);
        assert_eq!(spread(|_, _| false).borders, 0);
    }
}
