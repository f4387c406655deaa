use std::time::Duration;

use egui::{Align2, Rect, RichText, Ui};

/// Severity of a notice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Severity {
    /// Information only.
    Note,
    /// The operation finished, but something was left out.
    Warning,
    /// The operation failed.
    Error,
}

/// Message to the user: what happened and what to do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Notice {
    /// Severity of the message.
    pub severity: Severity,
    /// One sentence.
    pub text: String,
}

/// Notices not yet dismissed, latest last. Duplicates are shown once.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Notices {
    shown: Vec<Notice>,
    /// When each of them was first drawn, in milliseconds.
    drawn_ms: Vec<Option<u64>>,
    /// Warnings that a form showed while the user could still choose otherwise.
    read_before: Vec<String>,
    /// Whether all are drawn.
    is_expanded: bool,
}

/// Number of notices drawn until the user asks for all. More would cover what they are about.
const DRAWN: usize = 3;
/// Maximum number of notices that are kept; the oldest are dropped.
const KEPT: usize = 500;
/// Height of all notices as a share of the panes, 0–1.
const HEIGHT_SHARE: f32 = 0.7;
/// Time for which a note is shown, in milliseconds.
const NOTE_MS: u64 = 10_000;

impl Notices {
    /// Sets the warnings that the user has just read in a form; they are not shown a second time.
    pub fn set_read_before(&mut self, warnings: Vec<String>) {
        self.read_before = warnings;
    }

    /// Adds a notice, unless an equal one is already shown or was read in a form.
    pub fn tell(&mut self, severity: Severity, text: impl Into<String>) {
        let notice = Notice {
            severity,
            text: text.into(),
        };
        let read = |text: &String| severity == Severity::Warning && *text == notice.text;
        if let Some(index) = self.read_before.iter().position(read) {
            self.read_before.remove(index);
        } else if !self.shown.contains(&notice) {
            self.shown.push(notice);
            self.drawn_ms.push(None);
        }
        if self.shown.len() > KEPT {
            self.remove(0);
        }
    }

    /// Returns the number of notices that are not drawn: the oldest ones.
    fn folded(&self) -> usize {
        if self.is_expanded {
            0
        } else {
            self.shown.len().saturating_sub(DRAWN)
        }
    }

    fn remove(&mut self, index: usize) {
        self.shown.remove(index);
        self.drawn_ms.remove(index);
    }

    /// Removes notes, but not warnings and errors, that were there long enough to be read.
    ///
    /// Returns the time until the next one is removed, in milliseconds.
    fn remove_read(&mut self, now_ms: u64) -> Option<u64> {
        let mut left = None;
        for index in (self.folded()..self.shown.len()).rev() {
            let since = *self.drawn_ms[index].get_or_insert(now_ms);
            if self.shown[index].severity != Severity::Note {
                continue;
            }
            match (since + NOTE_MS)
                .checked_sub(now_ms)
                .filter(|left| *left > 0)
            {
                Some(rest) => left = Some(left.map_or(rest, |known: u64| known.min(rest))),
                None => self.remove(index),
            }
        }
        left
    }

    /// Returns the notices that were not dismissed.
    #[must_use]
    pub fn shown(&self) -> &[Notice] {
        &self.shown
    }
}

/// Draws the notices at the lower right of `panes`, each with a dismiss button.
///
/// They do not cover the side panel, where the user goes on working.
pub(super) fn notices_ui(ui: &Ui, notices: &mut Notices, panes: Rect) {
    let now_ms = (1000.0 * ui.input(|input| input.time)) as u64;
    if let Some(left) = notices.remove_read(now_ms) {
        ui.ctx().request_repaint_after(Duration::from_millis(left));
    }
    if notices.shown.is_empty() {
        notices.is_expanded = false;
        return;
    }
    let mut dismissed = None;
    egui::Area::new(egui::Id::unique("notices"))
        .pivot(Align2::RIGHT_BOTTOM)
        .fixed_pos(panes.right_bottom() - egui::vec2(12.0, 12.0))
        .order(egui::Order::Foreground)
        .show(ui.ctx(), |ui| {
            if notices.shown.len() > DRAWN {
                all_ui(ui, notices);
            }
            let folded = notices.folded();
            egui::ScrollArea::vertical()
                .max_height(HEIGHT_SHARE * panes.height())
                .stick_to_bottom(true)
                .show(ui, |ui| {
                    for (index, notice) in notices.shown.iter().enumerate().skip(folded) {
                        if notice_ui(ui, notice) {
                            dismissed = Some(index);
                        }
                        ui.add_space(6.0);
                    }
                });
        });
    if let Some(index) = dismissed {
        notices.remove(index);
    }
}

/// Draws the number of notices, and buttons for all of them.
fn all_ui(ui: &mut Ui, notices: &mut Notices) {
    let frame = egui::Frame::popup(ui.style()).inner_margin(6.0);
    frame.show(ui, |ui| {
        ui.set_width(388.0);
        ui.horizontal(|ui| {
            ui.label(format!("{} messages", notices.shown.len()));
            let (text, tip) = if notices.is_expanded {
                ("Show the last ones", "Show only the last messages")
            } else {
                ("Show all", "Show the earlier messages, too")
            };
            if ui.button(text).on_hover_text(tip).clicked() {
                notices.is_expanded = !notices.is_expanded;
            }
            let all = ui.button("Dismiss all");
            if all.on_hover_text("Dismiss all messages").clicked() {
                notices.shown.clear();
                notices.drawn_ms.clear();
            }
        });
    });
    ui.add_space(6.0);
}

fn notice_ui(ui: &mut Ui, notice: &Notice) -> bool {
    let (title, color) = match notice.severity {
        Severity::Note => ("Note", ui.visuals().hyperlink_color),
        Severity::Warning => ("Warning", ui.visuals().warn_fg_color),
        Severity::Error => ("Error", ui.visuals().error_fg_color),
    };
    let frame = egui::Frame::popup(ui.style())
        .stroke(egui::Stroke::new(1.0, color))
        .inner_margin(10.0);
    frame
        .show(ui, |ui| {
            ui.set_width(380.0);
            ui.horizontal_top(|ui| {
                ui.vertical(|ui| {
                    ui.set_width(345.0);
                    ui.label(RichText::new(title).color(color).strong());
                    ui.label(&notice.text);
                });
                ui.button("×")
                    .on_hover_text("Dismiss")
                    .accessible_name(format!("Dismiss {title}: {}", notice.text))
                    .clicked()
            })
            .inner
        })
        .inner
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn duplicates_are_kept_once_and_notes_that_were_not_drawn_stay() {
        let mut notices = Notices::default();
        notices.tell(Severity::Note, "a");
        notices.tell(Severity::Note, "a");
        assert_eq!(notices.shown().len(), 1);
        for n in 0..DRAWN {
            notices.tell(Severity::Warning, n.to_string());
        }
        assert_eq!(notices.folded(), 1);
        assert_eq!(notices.remove_read(0), None);
        assert_eq!(notices.remove_read(2 * NOTE_MS), None);
        assert_eq!(notices.shown().len(), DRAWN + 1);
        notices.is_expanded = true;
        assert_eq!(notices.remove_read(3 * NOTE_MS), Some(NOTE_MS));
        for n in 0..2 * KEPT {
            notices.tell(Severity::Warning, n.to_string());
        }
        assert_eq!(notices.shown().len(), KEPT);
        assert_eq!(notices.shown()[KEPT - 1].text, (2 * KEPT - 1).to_string());
    }

    #[test]
    fn only_notes_go_by_themselves() {
        let mut notices = Notices::default();
        notices.tell(Severity::Note, "a");
        notices.tell(Severity::Warning, "b");
        assert_eq!(notices.remove_read(500), Some(NOTE_MS));
        notices.tell(Severity::Note, "c");
        assert_eq!(notices.remove_read(1500), Some(NOTE_MS - 1000));
        assert_eq!(notices.remove_read(500 + NOTE_MS), Some(1000));
        let texts = |notices: &Notices| {
            let shown = notices.shown().iter();
            shown.map(|notice| notice.text.clone()).collect::<Vec<_>>()
        };
        assert_eq!(texts(&notices), ["b", "c"]);
        assert_eq!(notices.remove_read(1500 + NOTE_MS), None);
        assert_eq!(texts(&notices), ["b"]);
    }

    #[test]
    fn warning_that_was_read_in_a_form_is_not_shown_again() {
        let mut notices = Notices::default();
        notices.set_read_before(vec!["a".into()]);
        notices.tell(Severity::Error, "a");
        assert_eq!(notices.shown().len(), 1, "an error is another matter");
        notices.tell(Severity::Warning, "a");
        assert_eq!(notices.shown().len(), 1);
        notices.tell(Severity::Warning, "a");
        assert_eq!(notices.shown().len(), 2, "it happened a second time");
    }
}
