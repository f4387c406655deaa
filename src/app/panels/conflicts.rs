use std::collections::BTreeMap;

use egui::{ScrollArea, Ui};

use crate::tooltips::action_button;
use crate::{Action, SessionView, ViewState};
use ostra_cloud::conflicts::FrameConflict;

/// Number of frames visible in the list without scrolling.
const LISTED: f32 = 8.0;
/// Share of conflicting pixels from which a frame is listed. Less is noise at borders.
const LEAST: f32 = 0.01;

/// Draws the list of frames with the largest conflicts and the actions to resolve them.
pub(crate) fn conflicts_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    actions: &mut Vec<Action>,
) {
    let worst = ranked(session.conflicts);
    if worst.is_empty() {
        ui.weak("All masks agree with the 3-D vote.");
        return;
    }
    ui.weak("Share of each mask that the other views contradict:");
    let row = ui
        .text_style_height(&egui::TextStyle::Body)
        .max(ui.spacing().interact_size.y);
    let list = ScrollArea::vertical()
        .id_salt("doubtful")
        .max_height(LISTED * (row + ui.spacing().item_spacing.y));
    list.auto_shrink([false, true])
        .show_rows(ui, row, worst.len(), |ui, rows| {
            for &(frame, share) in &worst[rows] {
                let name = session
                    .project
                    .frames
                    .get(frame)
                    .map_or("", |frame| frame.name.as_str());
                let text = format!("{:>4.1} %  frame {frame}", 100.0 * share);
                if ui
                    .selectable_label(view.frame == frame, text)
                    .on_hover_text(format!("Go to {name}"))
                    .clicked()
                {
                    view.go_to(frame);
                }
            }
        });
    ui.checkbox(&mut view.prefs.mismatches, "Highlight conflicts")
        .on_hover_text("Mark pixels whose 3-D vote is another label. Using the vote changes these and some pixels at borders");
    ui.horizontal_wrapped(|ui| {
        for (action, text) in [
            (Action::NextWorst, "Next conflict"),
            (Action::AcceptVote, "Use 3-D vote"),
            (Action::AcceptLabelVote, "Only this label"),
        ] {
            let reason = action.unavailable(session, view);
            if action_button(ui, &view.prefs.shortcuts, action, text, reason).clicked() {
                actions.push(action);
            }
        }
    });
}

/// Returns `true` if a frame's conflict is large enough to be listed.
fn needs_review(conflict: &FrameConflict) -> bool {
    conflict.share() >= LEAST
}

impl ViewState {
    /// Returns `true` if the conflicting pixels of the shown frame are to be highlighted.
    pub(crate) fn shows_mismatch(&self, conflicts: &BTreeMap<usize, FrameConflict>) -> bool {
        self.prefs.mismatches
            && self.masks_shown
            && conflicts.get(&self.frame).is_some_and(needs_review)
    }
}

/// Returns the listed frames with their shares, largest first, earlier frames first among equals.
fn ranked(conflicts: &BTreeMap<usize, FrameConflict>) -> Vec<(usize, f32)> {
    let listed = conflicts
        .iter()
        .filter(|(_, conflict)| needs_review(conflict));
    let mut ranked: Vec<(usize, f32)> = listed
        .map(|(&frame, conflict)| (frame, conflict.share()))
        .collect();
    ranked.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    ranked
}

/// Returns the frame with the next smaller conflict.
///
/// Returns the frame with the largest conflict if this one is not listed or is the last in the
/// list.
pub(crate) fn next_worst(
    conflicts: &BTreeMap<usize, FrameConflict>,
    frame: usize,
) -> Option<usize> {
    let listed: Vec<usize> = ranked(conflicts)
        .into_iter()
        .map(|(frame, _)| frame)
        .collect();
    let next = listed
        .iter()
        .position(|&other| other == frame)
        .map_or(0, |at| at + 1);
    listed.get(next).or(listed.first()).copied()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Prefs;

    #[test]
    fn only_listed_frames_are_highlighted_and_only_if_enabled() {
        let conflict = |against| FrameConflict {
            compared: 1000,
            against,
        };
        let conflicts = BTreeMap::from([(0, conflict(300)), (1, conflict(3))]);
        let mut view = ViewState::new(Prefs::default());
        assert!(view.shows_mismatch(&conflicts));
        view.frame = 1;
        assert!(!view.shows_mismatch(&conflicts), "noise at borders");
        (view.frame, view.masks_shown) = (0, false);
        assert!(!view.shows_mismatch(&conflicts));
        (view.masks_shown, view.prefs.mismatches) = (true, false);
        assert!(!view.shows_mismatch(&conflicts));
    }

    #[test]
    fn next_worst_walks_down_the_list_and_wraps_around() {
        let conflict = |against| FrameConflict {
            compared: 100,
            against,
        };
        let conflicts = BTreeMap::from([
            (0, conflict(5)),
            (1, conflict(0)),
            (2, conflict(30)),
            (7, conflict(5)),
        ]);
        assert_eq!(next_worst(&conflicts, 1), Some(2));
        assert_eq!(
            [2, 0, 7].map(|frame| next_worst(&conflicts, frame)),
            [Some(0), Some(7), Some(2)]
        );
        assert_eq!(next_worst(&BTreeMap::new(), 3), None);
    }
}
