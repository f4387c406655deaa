use egui::{Align2, RichText, Ui};

/// How bad it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Severity {
    /// Good to know.
    Note,
    /// It went on, but something was left out.
    Warning,
    /// It did not work.
    Error,
}

/// Something to tell the user: what happened and what to do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Notice {
    /// How bad it is.
    pub severity: Severity,
    /// One sentence.
    pub text: String,
}

/// What was told and not yet dismissed, latest last; the same sentence is shown once.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Notices {
    shown: Vec<Notice>,
}

/// More than this would cover the window: the oldest go.
const MOST: usize = 5;

impl Notices {
    /// Tells something.
    pub fn tell(&mut self, severity: Severity, text: impl Into<String>) {
        let notice = Notice {
            severity,
            text: text.into(),
        };
        if !self.shown.contains(&notice) {
            self.shown.push(notice);
        }
        if self.shown.len() > MOST {
            self.shown.remove(0);
        }
    }

    /// What is shown now.
    #[must_use]
    pub fn shown(&self) -> &[Notice] {
        &self.shown
    }
}

/// Draws the notices at the lower right, above the filmstrip, each with a button to dismiss it.
pub(super) fn notices_ui(ui: &Ui, notices: &mut Notices) {
    if notices.shown.is_empty() {
        return;
    }
    let mut dismissed = None;
    egui::Area::new(egui::Id::unique("notices"))
        .anchor(Align2::RIGHT_BOTTOM, [-12.0, -152.0])
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
    fn the_same_error_is_shown_once_and_old_ones_go() {
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
}
