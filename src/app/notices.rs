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
    /// Warnings that a form showed while the user could still choose otherwise.
    read_before: Vec<String>,
}

/// Maximum number of notices. More would cover the window, so the oldest are dropped.
const MOST: usize = 5;

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
        }
        if self.shown.len() > MOST {
            self.shown.remove(0);
        }
    }

    /// Returns the notices currently shown.
    #[must_use]
    pub fn shown(&self) -> &[Notice] {
        &self.shown
    }
}

/// Draws the notices at the lower right of `panes`, each with a dismiss button.
///
/// They do not cover the side panel, where the user goes on working.
pub(super) fn notices_ui(ui: &Ui, notices: &mut Notices, panes: Rect) {
    if notices.shown.is_empty() {
        return;
    }
    let mut dismissed = None;
    egui::Area::new(egui::Id::unique("notices"))
        .pivot(Align2::RIGHT_BOTTOM)
        .fixed_pos(panes.right_bottom() - egui::vec2(12.0, 12.0))
        .order(egui::Order::Foreground)
        .show(ui.ctx(), |ui| {
            for (index, notice) in notices.shown.iter().enumerate() {
                if notice_ui(ui, notice) {
                    dismissed = Some(index);
                }
                ui.add_space(6.0);
            }
        });
    if let Some(index) = dismissed {
        notices.shown.remove(index);
    }
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
    fn duplicates_are_shown_once_and_oldest_notices_are_dropped() {
        let mut notices = Notices::default();
        notices.tell(Severity::Error, "a");
        notices.tell(Severity::Error, "a");
        assert_eq!(notices.shown().len(), 1);
        for n in 0..9 {
            notices.tell(Severity::Warning, n.to_string());
        }
        assert_eq!(notices.shown().len(), MOST);
        assert_eq!(notices.shown()[MOST - 1].text, "8");
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
