//! The dialog that goes to a frame by its number or a part of its file name.

use egui::{Button, Key, TextEdit, Ui};

use crate::tooltips::modal;
use crate::{SessionView, ViewState};
use ostra_frames::Frame;

/// Asks for a frame and shows it.
pub(crate) fn go_to_frame_ui(ui: &Ui, session: &SessionView<'_>, view: &mut ViewState) {
    let frames = &session.project.frames;
    let mut target = None;
    let response = modal(ui, "go to frame", 340.0, |ui| {
        ui.heading("Go to frame");
        let edit = TextEdit::singleline(&mut view.frame_text)
            .hint_text("Number or part of a file name")
            .desired_width(f32::INFINITY);
        let edit = ui.add(edit).accessible_name("Frame number or name");
        let is_entered = edit.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter));
        let found = find_frame(frames, &view.frame_text, view.frame);
        let is_empty = view.frame_text.trim().is_empty();
        match found {
            Some(frame) => ui.label(frame_text(frames, frame)),
            None if is_empty => ui.weak(format!(
                "Frames are numbered from 0 to {}",
                frames.len().saturating_sub(1)
            )),
            None => ui.colored_label(
                ui.visuals().error_fg_color,
                "No frame has this number or name",
            ),
        };
        ui.add_space(6.0);
        let is_cancelled = ui
            .horizontal(|ui| {
                let go = ui
                    .add_enabled(found.is_some(), Button::new("Show"))
                    .on_hover_text("Show this frame (Enter)")
                    .on_disabled_hover_text("Type the number of a frame or a part of its name");
                if go.clicked() || is_entered {
                    target = found;
                }
                let cancel = ui.button("Cancel");
                cancel.on_hover_text("Stay at this frame (Esc)").clicked()
            })
            .inner;
        if target.is_none() && ui.memory(|memory| memory.focused().is_none()) {
            edit.request_focus();
        }
        is_cancelled
    });
    if let Some(frame) = target {
        view.go_to(frame);
    }
    if target.is_some() || response.inner || response.should_close() {
        view.dialog = None;
        view.frame_text.clear();
    }
}

/// Returns number, position and name of a frame as text.
fn frame_text(frames: &[Frame], frame: usize) -> String {
    let name = frames.get(frame).map_or("", |frame| frame.name.as_str());
    format!("Frame {frame} ({} of {}) · {name}", frame + 1, frames.len())
}

/// Returns the frame with a number, or the next one after `shown` whose name contains the text.
///
/// Digits that begin with 0, such as `0427`, are looked for in names first, because cameras number
/// their files like that. Upper and lower case are the same.
fn find_frame(frames: &[Frame], text: &str, shown: usize) -> Option<usize> {
    let text = text.trim().to_lowercase();
    if text.is_empty() {
        return None;
    }
    let number = text
        .parse::<usize>()
        .ok()
        .filter(|&number| number < frames.len());
    let is_padded = text.len() > 1 && text.starts_with('0');
    if number.is_some() && !is_padded {
        return number;
    }
    let named = (1..=frames.len())
        .map(|step| (shown + step) % frames.len())
        .find(|&frame| frames[frame].name.to_lowercase().contains(&text));
    named.or(number)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ostra_frames::{ImageSource, Orientation};

    fn frames() -> Vec<Frame> {
        let frame = |name: &str| Frame {
            name: name.into(),
            width: 4,
            height: 3,
            image: ImageSource::File {
                path: name.into(),
                orientation: Orientation(1),
            },
            depth: None,
            camera: None,
        };
        ["DSC_0425.jpg", "DSC_0426.jpg", "DSC_0427.jpg", "top.png"]
            .map(frame)
            .into()
    }

    #[test]
    fn numbers_come_before_names_unless_they_are_padded() {
        let found = |text: &str, shown| find_frame(&frames(), text, shown);
        assert_eq!([found("2", 0), found(" 3 ", 0)], [Some(2), Some(3)]);
        assert_eq!(found("0427", 0), Some(2));
        assert_eq!(found("0003", 0), Some(3), "no name contains it");
        assert_eq!(found("0", 2), Some(0));
        assert_eq!(found("427", 0), Some(2), "there is no frame 427");
        assert_eq!([found("TOP", 0), found("none", 0)], [Some(3), None]);
        assert_eq!([found("", 0), found("9", 0)], [None, None]);
    }

    #[test]
    fn names_are_searched_from_the_shown_frame_on() {
        let frames = frames();
        let found = [0, 1, 2, 3].map(|shown| find_frame(&frames, "dsc", shown));
        assert_eq!(found, [Some(1), Some(2), Some(0), Some(0)]);
        assert_eq!(find_frame(&frames, "top", 3), Some(3), "only this one");
        assert_eq!(find_frame(&[], "1", 0), None);
        assert_eq!(frame_text(&frames, 2), "Frame 2 (3 of 4) · DSC_0427.jpg");
    }
}
