//! What actions are now: available or not, switched on or off.

use egui::{Context, Theme};
use ostra_project::{EngineName, MaskOrigin, SegmenterId};
use ostra_session::{EngineKind, JobTask, RangeChange};

use super::canvas::label_extent;
use super::panels::{has_chosen, scale_refusal};
use super::ranges::{is_range_change, range_request, split_at};
use super::{Action, Panes, SessionView, ViewState};

const NOTHING_OPEN: &str = "Nothing is open";
const NO_PROJECT: &str = "Open or create a project first";
const NO_FRAMES: &str = "Add frames to the project first";
const NO_LABEL: &str = "Select a label first";
const NOT_HERE: &str = "The selected label is not on this frame";
const ONE_LABEL: &str = "There is no other label";
const NO_MASK: &str = "This frame has no mask; click an object first";
const NO_KEYFRAME: &str = "There is no keyframe; click an object first";
const NO_CLOUD: &str = "There is no cloud; fuse first";
const NO_VOTES: &str = "Needs the votes of a cloud that this project fused; fuse first";
const NO_CAMERAS: &str = "No frame has a camera; reconstruct first";
const NO_POINTER: &str = "Point at the image and press the key";
const NO_CONFLICTS: &str = "This frame was not compared with the 3-D vote; fuse first";

/// Returns `reason` unless `is_met`.
fn needs(is_met: bool, reason: &'static str) -> Option<&'static str> {
    (!is_met).then_some(reason)
}

/// Returns why there are no frames; `None` if there are some.
fn without_frames(session: &SessionView<'_>) -> Option<&'static str> {
    let reason = if session.root.is_some() {
        NO_FRAMES
    } else {
        NO_PROJECT
    };
    needs(session.has_frames(), reason)
}

impl Action {
    /// Returns why the action cannot be performed now; `None` if it can.
    ///
    /// Menus, palette, keys and buttons all ask here, so that a disabled control always has the
    /// reason for which it is disabled.
    #[must_use]
    pub fn unavailable(self, session: &SessionView<'_>, view: &ViewState) -> Option<&'static str> {
        use Action as A;
        match self {
            A::AddFrames | A::ImportMasks | A::SaveRecipe | A::AddLabel => {
                needs(session.root.is_some(), NO_PROJECT)
            }
            A::Example if session.running(&JobTask::Example).is_some() => {
                Some("The example is being made")
            }
            A::Example => needs(
                view.has_example,
                "This system has no folder for the example",
            ),
            A::Relocate
            | A::RangeFrom
            | A::RangeTo
            | A::CompareBefore
            | A::ToggleTimeline
            | A::ToggleMatches
            | A::Reconstruct
            | A::Fit
            | A::ActualSize
            | A::PreviousFrame
            | A::NextFrame
            | A::Back10
            | A::Forward10
            | A::FirstFrame
            | A::LastFrame
            | A::GoToFrame => without_frames(session),
            A::TogglePlay => without_frames(session).or(needs(
                session.project.frames.len() > 1,
                "Needs at least two frames",
            )),
            A::NextUncertain => without_frames(session).or(needs(
                view.frames.review.next_after(view.frame).is_some(),
                "No frame needs a check",
            )),
            A::Close => needs(
                session.root.is_some() || session.inspected.is_some(),
                NOTHING_OPEN,
            ),
            A::TogglePanels | A::SwapPanes | A::StackPanes | A::MovePanel => needs(
                session.has_frames() || session.inspected.is_some(),
                NOTHING_OPEN,
            ),
            A::SaveImage => needs(session.points().is_some(), "The 3-D view is empty"),
            A::Export => needs(
                session.root.is_some() || session.cloud.is_some(),
                NO_PROJECT,
            ),
            A::Stop => needs(!session.jobs.is_empty(), "No job is running"),
            A::Undo => needs(session.undo.is_some(), "There is no step to undo"),
            A::Redo => needs(session.redo.is_some(), "There is no undone step to redo"),
            A::ToggleMeasures => needs(session.cloud.is_some() || view.measures.open, NO_CLOUD),
            other => other.unavailable_on_label(session, view),
        }
    }

    /// Returns why an action on labels, masks or points cannot be performed now.
    fn unavailable_on_label(
        self,
        session: &SessionView<'_>,
        view: &ViewState,
    ) -> Option<&'static str> {
        use Action as A;
        let labels = &session.project.labels;
        let label = || needs(view.label.is_some(), NO_LABEL);
        let mask = || needs(session.project.masks.contains_key(&view.frame), NO_MASK);
        let conflict = || needs(session.conflicts.contains_key(&view.frame), NO_CONFLICTS);
        let points = || needs(has_chosen(session, view), "Select points in 3-D first");
        match self {
            A::ChooseLabel(number) => needs(
                labels.iter().count() >= usize::from(number),
                "There are fewer labels",
            ),
            A::PreviousLabel => needs(
                view.labels.previous(labels).is_some(),
                "No other label was selected before",
            ),
            A::FillHoles | A::RemoveIslands => label().or_else(mask),
            A::ZoomToLabel => without_frames(session).or_else(label).or_else(|| {
                let is_here = label_extent(session, view).is_some();
                needs(is_here, NOT_HERE)
            }),
            A::MakeKeyframe | A::ClearFrame => mask(),
            A::AcceptVote => conflict(),
            A::AcceptLabelVote => label().or_else(conflict),
            A::NextWorst => needs(
                session.conflicts.values().any(|found| found.against > 0),
                "No mask conflicts with a 3-D vote",
            ),
            A::FindInScene => needs(session.cloud.is_some(), NO_CLOUD)
                .or(needs(session.votes.is_some(), NO_VOTES))
                .or(needs(view.pointer_px.is_some(), NO_POINTER)),
            A::IncludeHere | A::ExcludeHere => {
                without_frames(session).or(needs(view.pointer_px.is_some(), NO_POINTER))
            }
            A::ClearLabelHere | A::OnlyLabel => without_frames(session).or_else(label),
            A::ChoosePoints | A::AttachFragments => needs(session.votes.is_some(), NO_VOTES),
            A::AssignChosen => points().or_else(label),
            A::ClearChosen => points(),
            other => other.unavailable_in_range(session, view),
        }
    }

    /// Returns why a change over a range of frames cannot be performed now.
    fn unavailable_in_range(
        self,
        session: &SessionView<'_>,
        view: &ViewState,
    ) -> Option<&'static str> {
        use Action as A;
        let label = needs(view.label.is_some(), NO_LABEL);
        let other = needs(session.project.labels.iter().nth(1).is_some(), ONE_LABEL);
        match self {
            A::DropRange => needs(view.range.is_some(), "No range is selected"),
            A::MergeRange => label.or(other),
            A::SplitRange => label.or(other).or(needs(
                split_at(session, view).is_some(),
                "Point at the part of the selected label and press the key",
            )),
            A::CopyMask => {
                let is_here = |label| view.frames.presence.on_frame(view.frame).contains(&label);
                let has_mask = view.label.is_some_and(is_here);
                label.or(needs(has_mask, NOT_HERE))
            }
            change if is_range_change(change) => {
                let reason = match change {
                    A::PasteMask if view.copied.is_none() => "Copy the mask of a label first",
                    A::PasteMask => "Go to another frame or select a range first",
                    A::InterpolateRange => {
                        "Go between two keyframes of the label that are apart, or select a range"
                    }
                    A::AppearsHere => {
                        "No frame lies between this one and the last keyframe with the label"
                    }
                    A::GoneFromHere => "The label is on a keyframe here",
                    _ => NO_LABEL,
                };
                let possible = range_request(change, session, view).is_some();
                label.or(needs(possible, reason))
            }
            other => other.unavailable_job(session, view),
        }
    }

    /// Returns why a job cannot be started now.
    fn unavailable_job(self, session: &SessionView<'_>, view: &ViewState) -> Option<&'static str> {
        use Action as A;
        let is_running = |task: &JobTask| session.running(task).is_some();
        match self {
            A::Track | A::TrackForward | A::TrackBackward => {
                let mut masks = session.project.masks.values();
                let has_keyframe = masks.any(|mask| mask.origin == MaskOrigin::Keyframe);
                needs(has_keyframe, NO_KEYFRAME)
            }
            A::Retrack if is_running(&JobTask::Track) => Some("Tracking is running"),
            A::Retrack => needs(view.label.is_some(), NO_LABEL).or(needs(
                view.retracking(session).is_some(),
                "Correct the label on a tracked frame first; it is then tracked again up to the next keyframes",
            )),
            A::Suggest | A::Propose
                if is_running(&JobTask::Suggest) || is_running(&JobTask::Propose) =>
            {
                Some("A search for objects is running")
            }
            A::Suggest => needs(
                !session.project.masks.is_empty(),
                "No frame has a mask; click an object first",
            ),
            A::Propose => without_frames(session).or(needs(
                is_sam_installed(session),
                "Needs Segment Anything; install it in File › Networks",
            )),
            A::Fuse | A::LookThrough | A::FrameCameras => {
                let mut frames = session.project.frames.iter();
                needs(frames.any(|frame| frame.posed_camera().is_some()), NO_CAMERAS)
            }
            A::SetScale => scale_refusal(session, &view.ruler),
            _ => None,
        }
    }

    /// Returns `true` if the action can be performed now.
    #[must_use]
    pub fn is_available(self, session: &SessionView<'_>, view: &ViewState) -> bool {
        self.unavailable(session, view).is_none()
    }

    /// Returns whether a switch is on; `None` for an action that is no switch.
    #[must_use]
    pub fn is_on(self, ctx: &Context, session: &SessionView<'_>, view: &ViewState) -> Option<bool> {
        use Action as A;
        let prefs = &view.prefs;
        let undoes = |change: &RangeChange| {
            range_request(self, session, view).is_some_and(|request| request.change == *change)
        };
        Some(match self {
            A::UseTool(tool) => view.tool == tool,
            A::ToggleSnap => prefs.snap,
            A::ChoosePoints => view.scene_select.in_hand,
            A::LockRange => undoes(&RangeChange::Unlock),
            A::HideRange => undoes(&RangeChange::Show),
            A::ShowBoth => prefs.panes == Panes::Both,
            A::ShowImage => prefs.panes == Panes::Image,
            A::ShowScene => prefs.panes == Panes::Scene,
            A::TogglePanels => view.steps.is_bare,
            A::StackPanes => prefs.arrangement.is_stacked(),
            A::MovePanel => prefs.panel_on_left,
            A::CompareBefore => view.compare,
            A::ToggleMasks => view.masks_shown,
            A::ToggleOutlines => prefs.outlines,
            A::OnlyLabel => view.only_label,
            A::ToggleHover => prefs.hover_preview,
            A::ToggleOrthographic => prefs.scene.orthographic,
            A::ToggleTurntable => view.scene.turning,
            A::ToggleTimeline => prefs.timeline,
            A::ToggleMatches => view.matches.open,
            A::ToggleMeasures => view.measures.open,
            A::ToggleTheme => ctx.theme() == Theme::Dark,
            _ => return None,
        })
    }

    /// Returns the current text. Undo and redo include the name of the step.
    pub(crate) fn text_now(self, session: &SessionView<'_>) -> String {
        let step = match self {
            Self::Undo => session.undo,
            Self::Redo => session.redo,
            _ => None,
        };
        step.map_or_else(|| self.text(), |step| format!("{} {step}", self.text()))
    }
}

/// Returns `true` if Segment Anything is installed.
fn is_sam_installed(session: &SessionView<'_>) -> bool {
    session
        .engines_of(EngineKind::Segmenter)
        .any(|engine| engine.name == SegmenterId::Sam.name() && engine.installed)
}
