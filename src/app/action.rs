use egui::{Key, KeyboardShortcut, Modifiers};
use serde::{Deserialize, Serialize};

use super::Tool;
use super::menu_name::MenuName;
use ostra_session::Command;
use ostra_view::Side;

/// Actions available from a menu, the palette or a key.
///
/// One list feeds the menus, shortcuts, tooltips, the palette and the shortcut sheet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum Action {
    /// Opens the dialog for a new project.
    NewProject,
    /// Makes the example project, or opens the one made before.
    Example,
    /// Chooses a project folder to open.
    Open,
    /// Chooses a PLY file to view on its own.
    Inspect,
    /// Opens the dialog that adds frames.
    AddFrames,
    /// Opens the dialog for frames whose files have moved.
    Relocate,
    /// Chooses a folder of masks to import.
    ImportMasks,
    /// Opens the export dialog.
    Export,
    /// Opens the dialog that saves the 3-D view as an image or video.
    #[serde(alias = "SavePicture")]
    SaveImage,
    /// Saves the history as a recipe.
    SaveRecipe,
    /// Opens the networks dialog.
    Models,
    /// Closes the project.
    Close,
    /// Quits the program.
    Quit,
    /// Opens the preferences.
    Preferences,
    /// Undoes the last step.
    Undo,
    /// Redoes the last undone step.
    Redo,
    /// Adds a label.
    AddLabel,
    /// Selects the n-th label, 1–9.
    ChooseLabel(u8),
    /// Selects the label that was selected before.
    PreviousLabel,
    /// Adds an include click at the pointer.
    IncludeHere,
    /// Adds an exclude click at the pointer.
    ExcludeHere,
    /// Removes the selected label from the shown frame.
    ClearLabelHere,
    /// Removes all prompts and the whole mask from the shown frame.
    ClearFrame,
    /// Makes the shown frame a keyframe with its current mask.
    #[serde(alias = "MakeAnchor")]
    MakeKeyframe,
    /// Replaces the shown frame's mask by the vote of all views.
    AcceptVote,
    /// Replaces only the selected label's pixels by the vote of all views.
    AcceptLabelVote,
    /// Toggles the selection of points by drags in the 3-D view.
    ChoosePoints,
    /// Assigns the selected label to the selected points.
    AssignChosen,
    /// Clears the label of the selected points.
    ClearChosen,
    /// Gives unlabelled fragments the label of the object that they are attached to.
    #[serde(alias = "AdoptPieces")]
    AttachFragments,
    /// Starts the range at the shown frame.
    RangeFrom,
    /// Ends the range at the shown frame.
    RangeTo,
    /// Resets the range to the shown frame alone.
    DropRange,
    /// Deletes the selected label over the range.
    DeleteRange,
    /// Allows the selected label over the range again.
    RestoreRange,
    /// Deletes the selected label before the shown frame, back to the last keyframe with it.
    AppearsHere,
    /// Deletes the selected label from the shown frame on, up to the next keyframe with it.
    GoneFromHere,
    /// Locks or unlocks the selected label's pixels over the range.
    LockRange,
    /// Hides or shows the selected label over the range.
    HideRange,
    /// Merges the selected label into another one over the range.
    MergeRange,
    /// Turns the part of the label under the pointer into another label over the range.
    SplitRange,
    /// Interpolates the label's shape between the first and last frame of the range.
    InterpolateRange,
    /// Copies the selected label's mask on the shown frame.
    CopyMask,
    /// Pastes the copied mask onto the range.
    PasteMask,
    /// Fills small holes of the selected label.
    FillHoles,
    /// Removes small parts of the selected label.
    RemoveIslands,
    /// Selects a tool.
    UseTool(Tool),
    /// Decreases the brush radius, or with the click tool the size of the last answer.
    SmallerBrush,
    /// Increases the brush radius, or with the click tool the size of the last answer.
    LargerBrush,
    /// Toggles snapping of the brush to image edges.
    ToggleSnap,
    /// Goes back one frame.
    PreviousFrame,
    /// Goes forward one frame.
    NextFrame,
    /// Goes back ten frames.
    Back10,
    /// Goes forward ten frames.
    Forward10,
    /// Goes to the first frame.
    FirstFrame,
    /// Goes to the last frame.
    LastFrame,
    /// Goes to the next frame to check.
    #[serde(alias = "NextDoubtful")]
    NextUncertain,
    /// Starts or pauses playback of the frames.
    TogglePlay,
    /// Opens the dialog that goes to a frame by number or name.
    GoToFrame,
    /// Opens or closes the window of traits.
    ToggleMeasures,
    /// Inspects the point of the cloud under the pointer.
    FindInScene,
    /// Goes to the frame with the largest conflict, then to the next largest.
    NextWorst,
    /// Propagates the masks of keyframes in both directions.
    Track,
    /// Propagates masks to later frames.
    TrackForward,
    /// Propagates masks to earlier frames.
    TrackBackward,
    /// Tracks the selected label again between the neighbouring keyframes.
    Retrack,
    /// Searches for objects without a label.
    Suggest,
    /// Lists all objects that Segment Anything finds on the shown frame.
    Propose,
    /// Computes cameras and depth maps.
    Reconstruct,
    /// Sets the scale of the scene from the ruler's known length.
    SetScale,
    /// Fuses the depth maps into a labelled cloud.
    Fuse,
    /// Stops the running job.
    Stop,
    /// Drops the drawing in progress or the point selection, else closes a window. Jobs go on.
    Cancel,
    /// Fits the whole image into its pane.
    Fit,
    /// Shows one image pixel per screen pixel.
    ActualSize,
    /// Shows or hides the masks.
    ToggleMasks,
    /// Toggles between the current mask and the one before its last change.
    CompareBefore,
    /// Shows or hides the timeline, a grid of labels and frames.
    ToggleTimeline,
    /// Opens or closes the cameras and matches window.
    ToggleMatches,
    /// Cycles through image, depth, normals and confidence.
    NextLayer,
    /// Toggles the preview of a click.
    ToggleHover,
    /// Shows or hides outlines.
    ToggleOutlines,
    /// Shows the mask of the selected label only, or of all labels.
    OnlyLabel,
    /// Enlarges the selected label on the shown frame.
    ZoomToLabel,
    /// Shows the image and the 3-D view.
    ShowBoth,
    /// Shows only the image.
    #[serde(alias = "ShowPicture")]
    ShowImage,
    /// Shows only the 3-D view.
    ShowScene,
    /// Hides or shows side panel, timeline and filmstrip.
    TogglePanels,
    /// Moves the side panel to the other side.
    MovePanel,
    /// Swaps image and 3-D view.
    SwapPanes,
    /// Places image and 3-D view on top of each other, or side by side again.
    StackPanes,
    /// Shows the whole cloud in the 3-D view.
    FrameCloud,
    /// Shows all cameras in the 3-D view.
    FrameCameras,
    /// Views the scene from the shown frame's camera.
    LookThrough,
    /// Views the scene from one side.
    LookFrom(Side),
    /// Switches between orthographic and perspective projection.
    ToggleOrthographic,
    /// Starts or stops the rotation of the 3-D view about the vertical.
    ToggleTurntable,
    /// Switches between the dark and light theme.
    ToggleTheme,
    /// Gives the keyboard to the menu bar.
    FocusMenu,
    /// Opens the searchable list of actions.
    Palette,
    /// Opens the shortcut sheet.
    ShortcutSheet,
    /// Shows the guide.
    Guide,
    /// Shows the changes that users notice.
    WhatsNew,
    /// Shows what to send with a report of a problem.
    ReportProblem,
    /// Shows version, licence and what the program runs on.
    About,
}

/// What the user requested while a frame of the window was drawn, in order.
#[derive(Default)]
pub(crate) struct Requests {
    pub commands: Vec<Command>,
    pub actions: Vec<Action>,
}

impl Action {
    /// Returns all actions, in the order of the menus and the shortcut sheet.
    pub fn all() -> impl Iterator<Item = Self> {
        LIST.iter()
            .map(|row| row.action)
            .chain((1..=9).map(Self::ChooseLabel))
    }

    /// Returns the text shown in menus and the palette.
    #[must_use]
    pub fn text(self) -> String {
        match self {
            Self::ChooseLabel(number) => format!("Select label {number}"),
            _ => row(self).map_or_else(String::new, |row| row.text.into()),
        }
    }

    /// Returns the description shown in tooltips.
    #[must_use]
    pub fn tip(self) -> &'static str {
        row(self).map_or("Select this label for clicks and brush", |row| row.tip)
    }

    /// Returns the menu that contains the action, if any.
    #[must_use]
    pub fn menu(self) -> Option<MenuName> {
        row(self).and_then(|row| row.menu)
    }

    /// Returns `true` if a separator is drawn above the action, or above the submenu that it begins.
    #[must_use]
    pub fn starts_group(self) -> bool {
        row(self).is_some_and(|row| row.line)
    }

    /// Returns the default shortcut.
    #[must_use]
    pub fn default_keys(self) -> Option<KeyboardShortcut> {
        match self {
            Self::ChooseLabel(number) => Key::from_name(&number.to_string())
                .map(|key| KeyboardShortcut::new(Modifiers::NONE, key)),
            _ => row(self)?.keys,
        }
    }
}

struct Row {
    action: Action,
    menu: Option<MenuName>,
    line: bool,
    text: &'static str,
    tip: &'static str,
    keys: Option<KeyboardShortcut>,
}

const fn plain(key: Key) -> Option<KeyboardShortcut> {
    Some(KeyboardShortcut::new(Modifiers::NONE, key))
}

const fn shift(key: Key) -> Option<KeyboardShortcut> {
    Some(KeyboardShortcut::new(Modifiers::SHIFT, key))
}

const fn alt(key: Key) -> Option<KeyboardShortcut> {
    Some(KeyboardShortcut::new(Modifiers::ALT, key))
}

const fn ctrl(key: Key) -> Option<KeyboardShortcut> {
    Some(KeyboardShortcut::new(Modifiers::COMMAND, key))
}

const fn ctrl_shift(key: Key) -> Option<KeyboardShortcut> {
    Some(KeyboardShortcut::new(
        Modifiers::COMMAND.plus(Modifiers::SHIFT),
        key,
    ))
}

fn row(action: Action) -> Option<&'static Row> {
    LIST.iter().find(|row| row.action == action)
}

macro_rules! list {
    ($( $action:expr, $menu:expr, $line:literal, $text:literal, $tip:literal, $keys:expr; )*) => {
        &[ $( Row { action: $action, menu: $menu, line: $line, text: $text, tip: $tip, keys: $keys } ),* ]
    };
}

const FILE: Option<MenuName> = Some(MenuName::File);
const EDIT: Option<MenuName> = Some(MenuName::Edit);
const RANGE: Option<MenuName> = Some(MenuName::Range);
const VIEW: Option<MenuName> = Some(MenuName::View);
const TOOLS: Option<MenuName> = Some(MenuName::Tools);
const POINTS: Option<MenuName> = Some(MenuName::Points);
const VOTE: Option<MenuName> = Some(MenuName::Vote);
const LAYOUT: Option<MenuName> = Some(MenuName::Layout);
const SCENE: Option<MenuName> = Some(MenuName::Viewpoint);
const GO: Option<MenuName> = Some(MenuName::Go);
const RUN: Option<MenuName> = Some(MenuName::Run);
const HELP: Option<MenuName> = Some(MenuName::Help);

#[rustfmt::skip] // A table is easiest to read with one action per line.
const LIST: &[Row] = {
    use Action as A;
    list! {
        A::NewProject, FILE, false, "New project…", "Create a project from photos, a video or an RGB-D recording", ctrl(Key::N);
        A::Example, FILE, false, "Try the example plant", "Make an example project of a synthetic plant with cameras and depth, and open it", None;
        A::Open, FILE, false, "Open project…", "Open a project folder", ctrl(Key::O);
        A::Inspect, FILE, false, "View a point cloud…", "View a labelled PLY on its own in 3-D", ctrl_shift(Key::O);
        A::AddFrames, FILE, true, "Add frames…", "Append frames to the project", None;
        A::Relocate, FILE, false, "Locate missing frames…", "Locate frames whose files have moved", None;
        A::ImportMasks, FILE, false, "Import masks…", "Read masks from a folder; their frames become keyframes", None;
        A::Export, FILE, true, "Export…", "Write cloud, mesh, traits, cameras, masks or depth maps to files", ctrl(Key::E);
        A::SaveImage, FILE, false, "Save 3-D view…", "Save the 3-D view as an image or a turntable video", ctrl_shift(Key::E);
        A::SaveRecipe, FILE, false, "Save history as recipe…", "Save the steps so far as a recipe for 'ostra run'", None;
        A::Models, FILE, true, "Networks…", "Install, add and check neural networks", None;
        A::Close, FILE, true, "Close project", "Close the project; everything is already saved", ctrl(Key::W);
        A::Quit, FILE, false, "Quit", "Quit OSTRA; everything is already saved", ctrl(Key::Q);
        A::Undo, EDIT, false, "Undo", "Undo the last step", ctrl(Key::Z);
        A::Redo, EDIT, false, "Redo", "Redo the last undone step", ctrl_shift(Key::Z);
        A::AddLabel, EDIT, true, "Add label", "Add a label and select it", plain(Key::N);
        A::PreviousLabel, EDIT, false, "Previous label", "Select the label that was selected before this one", plain(Key::Minus);
        A::IncludeHere, EDIT, true, "Include at pointer", "Include the pixel under the pointer in the label", plain(Key::Q);
        A::ExcludeHere, EDIT, false, "Exclude at pointer", "Exclude the pixel under the pointer from the label", plain(Key::E);
        A::ClearLabelHere, EDIT, false, "Remove label from this frame", "Remove the selected label's prompts and pixels from this frame", plain(Key::Delete);
        A::ClearFrame, EDIT, false, "Clear this frame", "Remove all prompts and the whole mask from this frame", shift(Key::Delete);
        A::MakeKeyframe, EDIT, false, "Make this frame a keyframe", "Confirm the mask as it is; trackers no longer change it", plain(Key::C);
        A::FillHoles, EDIT, true, "Fill holes of label", "Fill holes of the selected label on this frame that are smaller than the size in the menu of tools", shift(Key::H);
        A::RemoveIslands, EDIT, false, "Remove specks of label", "Remove parts of the selected label on this frame that are smaller than the size in the menu of tools; the largest part is kept", shift(Key::K);
        A::AcceptVote, VOTE, true, "Use the 3-D vote on this frame", "Replace this frame's mask by the vote of all views and make it a keyframe", shift(Key::A);
        A::AcceptLabelVote, VOTE, false, "Use the 3-D vote for this label", "Replace only the selected label's pixels by the vote of all views", ctrl_shift(Key::A);
        A::ChoosePoints, POINTS, false, "Select points in 3-D", "Drag in the 3-D view to select visible points and correct their label in all masks", shift(Key::S);
        A::AssignChosen, POINTS, false, "Assign label to selected points", "Give the selected points the selected label, in every mask that shows them", shift(Key::Enter);
        A::ClearChosen, POINTS, false, "Clear label of selected points", "Remove the label of the selected points, in every mask that shows them", shift(Key::Backspace);
        A::AttachFragments, POINTS, false, "Attach loose fragments", "Give unlabelled fragments the label of the object that they are attached to, in every mask that shows them", None;
        A::UseTool(Tool::Click), TOOLS, false, "Click and box tool", "Left click to include, right click to exclude, drag for a box; with Ctrl, a new object. Alt+wheel makes the answer smaller or larger", plain(Key::V);
        A::UseTool(Tool::Brush), TOOLS, false, "Brush tool", "Paint the selected label; Ctrl or right button erases, Shift+wheel sets the size", plain(Key::P);
        A::UseTool(Tool::Eraser), TOOLS, false, "Eraser tool", "Erase the selected label; Shift+wheel sets the size", plain(Key::X);
        A::UseTool(Tool::Polygon), TOOLS, false, "Polygon tool", "Click corners or draw an outline; Enter or double-click fills it (with Ctrl erases), Backspace or right click removes the last corner", plain(Key::G);
        A::UseTool(Tool::Border), TOOLS, false, "Move border tool", "Press on the border of the selected label and drag it to the right place", shift(Key::G);
        A::UseTool(Tool::Stem), TOOLS, false, "Stem and wire tool", "Click two or more points along a stem or wire; Enter or double-click traces it, Backspace or right click removes the last point", plain(Key::W);
        A::SmallerBrush, TOOLS, true, "Smaller brush or answer", "Make the brush smaller; with the click tool, give the last click a smaller answer", plain(Key::OpenBracket);
        A::LargerBrush, TOOLS, false, "Larger brush or answer", "Make the brush larger; with the click tool, give the last click a larger answer", plain(Key::CloseBracket);
        A::ToggleSnap, TOOLS, false, "Snap brush to edges", "Stop the brush at image edges that the inner half of its radius does not cross", plain(Key::S);
        A::Preferences, EDIT, true, "Preferences…", "Set theme, size of the interface, previews, processor and shortcuts", ctrl(Key::Comma);
        A::RangeFrom, RANGE, false, "Start range here", "Make this frame the first frame of the range", plain(Key::I);
        A::RangeTo, RANGE, false, "End range here", "Make this frame the last frame of the range", shift(Key::I);
        A::DropRange, RANGE, false, "Clear range", "Apply changes to the current frame only", ctrl(Key::I);
        A::DeleteRange, RANGE, true, "Delete label in range", "Remove the label in this range; tracking will not add it again", ctrl(Key::Delete);
        A::RestoreRange, RANGE, false, "Restore label in range", "Let tracking add the label again in this range", ctrl_shift(Key::Delete);
        A::AppearsHere, RANGE, false, "Label appears here", "Remove the label before this frame, back to the last keyframe that shows it", plain(Key::Comma);
        A::GoneFromHere, RANGE, false, "Label disappears here", "Remove the label from this frame on, up to the next keyframe that shows it", plain(Key::Period);
        A::LockRange, RANGE, true, "Lock label in range", "Protect the label's pixels from tracking and from every edit", plain(Key::K);
        A::HideRange, RANGE, false, "Hide label in range", "Keep the label's pixels but leave them out of display, votes and exports", plain(Key::H);
        A::MergeRange, RANGE, true, "Merge label in range…", "Turn the label's pixels and prompts into another label", plain(Key::J);
        A::SplitRange, RANGE, false, "Split label in range…", "Turn the part under the pointer into another label, followed through the range", shift(Key::J);
        A::InterpolateRange, RANGE, false, "Interpolate label in range", "Interpolate the label's shape between the first and the last frame of the range", plain(Key::Y);
        A::CopyMask, RANGE, true, "Copy mask of label", "Copy the selected label's mask on this frame", shift(Key::C);
        A::PasteMask, RANGE, false, "Paste mask of label", "Paste the copied mask onto the range; its frames become keyframes", shift(Key::V);
        A::ShowBoth, LAYOUT, false, "Image and 3-D", "Show image and 3-D view next to each other", ctrl(Key::Num1);
        A::ShowImage, LAYOUT, false, "Image only", "Show only the image", ctrl(Key::Num2);
        A::ShowScene, LAYOUT, false, "3-D only", "Show only the 3-D view", ctrl(Key::Num3);
        A::TogglePanels, LAYOUT, true, "Hide panels", "Hide or show side panel, timeline and filmstrip", plain(Key::Tab);
        A::SwapPanes, LAYOUT, true, "Swap panes", "Swap the places of image and 3-D view", None;
        A::StackPanes, LAYOUT, false, "Stack panes", "Place image and 3-D view on top of each other, or side by side again", None;
        A::MovePanel, LAYOUT, false, "Side panel on the left", "Move labels and steps to the other side of the window", None;
        A::Fit, VIEW, true, "Fit image", "Show the whole image", plain(Key::Num0);
        A::ActualSize, VIEW, false, "Image at 100 %", "Show one image pixel per screen pixel", shift(Key::Num0);
        A::ZoomToLabel, VIEW, false, "Zoom to label", "Enlarge the selected label and its child labels on this frame", shift(Key::Z);
        A::NextLayer, VIEW, false, "Next layer", "Switch between image, depth, normals and confidence", plain(Key::F7);
        A::CompareBefore, VIEW, false, "Compare with previous mask", "Show the frame's mask before its last change, or the current one", plain(Key::F4);
        A::ToggleMasks, VIEW, true, "Show masks", "Show or hide the masks over the image", plain(Key::M);
        A::ToggleOutlines, VIEW, false, "Show outlines", "Draw a line around every label", plain(Key::O);
        A::OnlyLabel, VIEW, false, "Show only this label", "Show the mask of the selected label and its child labels, and hide the others on the image", shift(Key::M);
        A::ToggleHover, VIEW, false, "Preview a click", "Show the mask that a click at the pointer would give", plain(Key::F3);
        A::FrameCloud, SCENE, true, "Show whole cloud", "Bring the whole cloud into view", plain(Key::A);
        A::FrameCameras, SCENE, false, "Show cameras", "Bring all cameras into view", shift(Key::L);
        A::LookThrough, SCENE, false, "Look through this frame's camera", "View the scene from where this frame was taken", plain(Key::L);
        A::LookFrom(Side::Front), SCENE, true, "From the front", "View from the side of most cameras", alt(Key::Num1);
        A::LookFrom(Side::Back), SCENE, false, "From behind", "View from behind", alt(Key::Num2);
        A::LookFrom(Side::Left), SCENE, false, "From the left", "View from the left", alt(Key::Num3);
        A::LookFrom(Side::Right), SCENE, false, "From the right", "View from the right", alt(Key::Num4);
        A::LookFrom(Side::Top), SCENE, false, "From above", "View from above", alt(Key::Num5);
        A::LookFrom(Side::Bottom), SCENE, false, "From below", "View from below", alt(Key::Num6);
        A::ToggleOrthographic, SCENE, true, "Orthographic", "Switch between orthographic and perspective projection", alt(Key::O);
        A::ToggleTurntable, SCENE, false, "Turntable", "Rotate the view about the vertical axis until you click or drag in it", alt(Key::T);
        A::ToggleTimeline, VIEW, true, "Show timeline", "Show or hide the grid of labels and frames above the filmstrip", plain(Key::F2);
        A::ToggleMatches, VIEW, false, "Cameras and matches", "Show matches between frames, reprojection errors, and why frames have no camera", plain(Key::F6);
        A::ToggleMeasures, VIEW, false, "Traits", "Show a table of traits per label: lengths, widths, areas, volumes, heights, angles", plain(Key::F8);
        A::ToggleTheme, VIEW, true, "Dark theme", "Switch between dark and light theme", plain(Key::F9);
        A::PreviousFrame, GO, false, "Previous frame", "Go to the previous frame", plain(Key::ArrowLeft);
        A::NextFrame, GO, false, "Next frame", "Go to the next frame", plain(Key::ArrowRight);
        A::Back10, GO, false, "10 frames back", "Go back 10 frames", shift(Key::ArrowLeft);
        A::Forward10, GO, false, "10 frames forward", "Go forward 10 frames", shift(Key::ArrowRight);
        A::FirstFrame, GO, false, "First frame", "Go to the first frame", plain(Key::Home);
        A::LastFrame, GO, false, "Last frame", "Go to the last frame", plain(Key::End);
        A::GoToFrame, GO, false, "Go to frame…", "Go to a frame by its number or a part of its file name", ctrl(Key::G);
        A::TogglePlay, GO, true, "Play or pause", "Play the frames with their masks, or pause", plain(Key::Space);
        A::NextUncertain, GO, false, "Next frame to check", "Go to the next frame whose mask is stale, uncertain, in conflict with the 3-D vote, or lost an object", plain(Key::D);
        A::NextWorst, GO, false, "Next conflict", "Go to the frame with the largest conflict, then to the next largest", shift(Key::D);
        A::FindInScene, GO, false, "Find in 3-D", "Show the votes of the point under the pointer and centre it in the 3-D view", plain(Key::Z);
        A::Track, RUN, false, "Track both ways", "Propagate the masks of keyframes to all frames", plain(Key::T);
        A::TrackForward, RUN, false, "Track forward from here", "Propagate masks from this frame to later frames", plain(Key::F);
        A::TrackBackward, RUN, false, "Track backward from here", "Propagate masks from this frame to earlier frames", plain(Key::B);
        A::Retrack, RUN, false, "Re-track this label around this frame", "Track the selected label again up to the next keyframes on both sides; other labels are kept", shift(Key::T);
        A::Suggest, RUN, false, "Find unlabelled objects", "List unlabelled regions that are likely objects", ctrl(Key::L);
        A::Propose, RUN, false, "Propose objects on this frame", "List every object that Segment Anything finds on this frame", ctrl_shift(Key::L);
        A::Reconstruct, RUN, true, "Reconstruct", "Compute cameras and depth maps with the settings of the step Cameras & depth", plain(Key::R);
        A::SetScale, RUN, false, "Set scale by ruler", "Scale cameras, depth maps, cloud and mesh so that the ruler shows the known length", None;
        A::Fuse, RUN, false, "Fuse", "Fuse the depth maps into a cloud and label each point by a vote of all views", plain(Key::U);
        A::Stop, RUN, true, "Stop", "Stop the running job; finished parts are kept", ctrl(Key::Period);
        A::Cancel, RUN, false, "Drop unfinished drawing", "Discard the unfinished box, stroke, polygon or trace, else clear selected points or close the matches or traits window. Jobs go on", plain(Key::Escape);
        A::FocusMenu, HELP, false, "Go to the menu bar", "Give the keyboard to the menu bar; Enter opens a menu, arrow keys move in it", plain(Key::F10);
        A::Palette, HELP, false, "Find action…", "List all actions; type to filter", ctrl(Key::P);
        A::ShortcutSheet, HELP, false, "Shortcuts…", "Show and change shortcuts", plain(Key::Questionmark);
        A::Guide, HELP, true, "Guide…", "Show the tutorials and how-to pages", plain(Key::F1);
        A::WhatsNew, HELP, false, "What's new…", "Show the changes in this version", None;
        A::ReportProblem, HELP, false, "Report a problem…", "Show what to send with a report", None;
        A::About, HELP, true, "About OSTRA…", "Show version, licence, graphics adapter and ONNX Runtime", None;
    }
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_action_has_text_and_tooltip() {
        for action in Action::all() {
            assert!(!action.text().is_empty(), "{action:?}");
            assert!(action.tip().len() > 8, "{action:?}");
        }
        assert_eq!(Action::ChooseLabel(3).default_keys(), plain(Key::Num3));
    }
}
