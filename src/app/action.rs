use egui::{Key, KeyboardShortcut, Modifiers};
use serde::{Deserialize, Serialize};

use super::Tool;
use ostra_view::Side;

/// Everything that can be done from a menu, the palette or a key: one list feeds menus, shortcuts, tooltips, the
/// palette and the shortcut sheet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum Action {
    /// Dialog for a new project.
    NewProject,
    /// Chooses a project folder.
    Open,
    /// Chooses a PLY to look at alone.
    Inspect,
    /// Dialog for more frames.
    AddFrames,
    /// Dialog for frames whose files were moved.
    Relocate,
    /// Chooses a folder of masks.
    ImportMasks,
    /// Dialog for exports.
    Export,
    /// Dialog for a picture or film of the 3-D view.
    SavePicture,
    /// Writes the history as a recipe.
    SaveRecipe,
    /// The networks that are known, and getting them.
    Models,
    /// Closes the project.
    Close,
    /// Ends the program.
    Quit,
    /// Takes back the last step.
    Undo,
    /// Does it again.
    Redo,
    /// Makes a label.
    AddLabel,
    /// Chooses the n-th label, 1–9.
    ChooseLabel(u8),
    /// Include click at the pointer.
    IncludeHere,
    /// Exclude click at the pointer.
    ExcludeHere,
    /// Takes the chosen label off this frame.
    ClearLabelHere,
    /// Takes the whole mask off this frame.
    ClearFrame,
    /// Accepts a tracked mask as it is.
    MakeAnchor,
    /// The vote of all frames becomes this frame's mask.
    AcceptVote,
    /// The same for the chosen label.
    AcceptLabelVote,
    /// Drags in the 3-D view choose points, or no longer.
    ChoosePoints,
    /// The chosen points become the chosen label's.
    AssignChosen,
    /// The chosen points become nothing's.
    ClearChosen,
    /// Pieces without a label go to what they hang on.
    AdoptPieces,
    /// The range of frames begins at the shown one.
    RangeFrom,
    /// The range of frames ends at the shown one.
    RangeTo,
    /// The range is the shown frame alone again.
    DropRange,
    /// The chosen label is not there over the range.
    DeleteRange,
    /// It may be there again.
    RestoreRange,
    /// It was not there before the shown frame.
    AppearsHere,
    /// It is not there from the shown frame on.
    GoneFromHere,
    /// Its pixels over the range stay as they are, or no longer.
    LockRange,
    /// Its pixels over the range are out of play, or no longer.
    HideRange,
    /// It becomes another label over the range.
    MergeRange,
    /// Its piece under the pointer becomes another label over the range.
    SplitRange,
    /// Shapes between those of the range's ends.
    InterpolateRange,
    /// Remembers the chosen label's mask on this frame.
    CopyMask,
    /// Puts the remembered mask onto the range.
    PasteMask,
    /// Fills small holes of the chosen label.
    FillHoles,
    /// Removes small islands of the chosen label.
    RemoveIslands,
    /// Chooses a tool.
    UseTool(Tool),
    /// Smaller brush.
    SmallerBrush,
    /// Larger brush.
    LargerBrush,
    /// Brush that stops at edges, on and off.
    ToggleSnap,
    /// One frame back.
    PreviousFrame,
    /// One frame on.
    NextFrame,
    /// Ten frames back.
    Back10,
    /// Ten frames on.
    Forward10,
    /// First frame.
    FirstFrame,
    /// Last frame.
    LastFrame,
    /// Next frame whose mask is stale or uncertain.
    NextDoubtful,
    /// Window of what was measured of each label.
    ToggleMeasures,
    /// The point of the cloud under the pointer.
    FindInScene,
    /// To the frame that contradicts the vote of all most, then down that list.
    NextWorst,
    /// Carries masks both ways.
    Track,
    /// Carries masks to later frames.
    TrackForward,
    /// Carries masks to earlier frames.
    TrackBackward,
    /// Carries the chosen label anew between the anchors next to this one.
    Retrack,
    /// Looks for things that no label explains.
    Suggest,
    /// Offers all things that the segmenter sees on the shown frame.
    Propose,
    /// Makes cameras and depths.
    Reconstruct,
    /// Gives the scene a unit by the ruler's length.
    SetScale,
    /// Makes the labelled cloud.
    Fuse,
    /// Stops what runs.
    Stop,
    /// Drops the half-made prompt, else stops what runs.
    Cancel,
    /// Whole picture in the canvas.
    Fit,
    /// One picture pixel = one screen pixel.
    ActualSize,
    /// Mask overlay on and off.
    ToggleMasks,
    /// The masks before the last change, and back.
    CompareBefore,
    /// Labels × frames below the picture, or not.
    ToggleTimeline,
    /// The window of cameras and matches, or not.
    ToggleMatches,
    /// Photo, depth, normals, confidence, and round again.
    NextLayer,
    /// Preview of a click on and off.
    ToggleHover,
    /// Outlines on and off.
    ToggleOutlines,
    /// Picture and 3-D.
    ShowBoth,
    /// Picture alone.
    ShowPicture,
    /// 3-D alone.
    ShowScene,
    /// Whole cloud in the 3-D view.
    FrameCloud,
    /// 3-D view from this frame's camera.
    LookThrough,
    /// 3-D view from a side.
    LookFrom(Side),
    /// Orthographic and perspective.
    ToggleOrthographic,
    /// The 3-D view turns by itself, or not.
    ToggleTurntable,
    /// Dark and light.
    ToggleTheme,
    /// List of actions to type into.
    Palette,
    /// Shortcut sheet.
    ShortcutSheet,
}

/// The menus, from left to right.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MenuName {
    /// Projects and files.
    File,
    /// Undo, labels, masks.
    Edit,
    /// Labels over a range of frames.
    Range,
    /// What is shown, and how.
    View,
    /// From frame to frame.
    Go,
    /// Long work.
    Run,
    /// Where to find things.
    Help,
}

impl MenuName {
    /// All menus, from left to right.
    pub const ALL: [Self; 7] = [
        Self::File,
        Self::Edit,
        Self::Range,
        Self::View,
        Self::Go,
        Self::Run,
        Self::Help,
    ];

    /// What the menu bar shows.
    #[must_use]
    pub fn text(self) -> &'static str {
        match self {
            Self::File => "File",
            Self::Edit => "Edit",
            Self::Range => "Range",
            Self::View => "View",
            Self::Go => "Go",
            Self::Run => "Run",
            Self::Help => "Help",
        }
    }
}

impl Action {
    /// All actions in the order of menus and sheet.
    pub fn all() -> impl Iterator<Item = Self> {
        LIST.iter()
            .map(|row| row.action)
            .chain((1..=9).map(Self::ChooseLabel))
    }

    /// What menus and palette show.
    #[must_use]
    pub fn text(self) -> String {
        match self {
            Self::ChooseLabel(number) => format!("Choose label {number}"),
            _ => row(self).map_or_else(String::new, |row| row.text.into()),
        }
    }

    /// What it does, for tooltips.
    #[must_use]
    pub fn tip(self) -> &'static str {
        row(self).map_or(
            "Chooses that label of the list for clicks and brush",
            |row| row.tip,
        )
    }

    /// The menu it stands in, where it stands in one.
    #[must_use]
    pub fn menu(self) -> Option<MenuName> {
        row(self).and_then(|row| row.menu)
    }

    /// Whether a line is drawn above it in its menu.
    #[must_use]
    pub fn starts_group(self) -> bool {
        row(self).is_some_and(|row| row.line)
    }

    /// The keys it has until the user changes them.
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
const GO: Option<MenuName> = Some(MenuName::Go);
const RUN: Option<MenuName> = Some(MenuName::Run);
const HELP: Option<MenuName> = Some(MenuName::Help);

#[rustfmt::skip] // a table: one action a line reads best
const LIST: &[Row] = {
    use Action as A;
    list! {
        A::NewProject, FILE, false, "New project from frames…", "Makes a project from photos, a film or an RGB-D recording", ctrl(Key::N);
        A::Open, FILE, false, "Open project…", "Opens a project folder", ctrl(Key::O);
        A::Inspect, FILE, false, "Inspect PLY…", "Shows a labelled point cloud alone in 3-D", ctrl_shift(Key::O);
        A::AddFrames, FILE, true, "Add frames…", "Puts more frames at the end; nothing that is there changes", None;
        A::Relocate, FILE, false, "Frames were moved…", "Says where the files of frames are now that were moved", None;
        A::ImportMasks, FILE, false, "Import masks…", "Reads masks from a folder; their frames become anchors", None;
        A::Export, FILE, true, "Export…", "Writes cloud, mesh, traits, cameras, masks or depths to files", ctrl(Key::E);
        A::SavePicture, FILE, false, "Picture of the 3-D view…", "Writes what the 3-D view shows as a picture of any size, or as a film of one turn", ctrl_shift(Key::E);
        A::SaveRecipe, FILE, false, "Save history as recipe…", "Writes the steps so far as a recipe for 'ostra run'", None;
        A::Models, FILE, true, "Networks…", "Shows which networks are installed, gets, adds and checks them", None;
        A::Close, FILE, true, "Close project", "Closes the project; everything is already saved", ctrl(Key::W);
        A::Quit, FILE, false, "Quit", "Ends OSTRA; everything is already saved", ctrl(Key::Q);
        A::Undo, EDIT, false, "Undo", "Takes back the last step", ctrl(Key::Z);
        A::Redo, EDIT, false, "Redo", "Does the step taken back again", ctrl_shift(Key::Z);
        A::AddLabel, EDIT, true, "Add label", "Makes a new label and chooses it", plain(Key::N);
        A::IncludeHere, EDIT, true, "Include at pointer", "Says that the pixel under the pointer belongs to the label", plain(Key::Q);
        A::ExcludeHere, EDIT, false, "Exclude at pointer", "Says that the pixel under the pointer does not belong to the label", plain(Key::E);
        A::ClearLabelHere, EDIT, false, "Remove label from this frame", "Takes the chosen label's clicks and pixels off this frame", plain(Key::Delete);
        A::ClearFrame, EDIT, false, "Clear this frame", "Takes all clicks and the whole mask off this frame", shift(Key::Delete);
        A::MakeAnchor, EDIT, false, "Make this frame an anchor", "Accepts the tracked mask as it is; trackers keep it from now on", plain(Key::C);
        A::AcceptVote, EDIT, false, "Accept the 3-D vote on this frame", "Gives this frame the mask that all frames voted for; it becomes an anchor", shift(Key::A);
        A::AcceptLabelVote, EDIT, false, "Accept the 3-D vote for this label", "The same for the chosen label alone", ctrl_shift(Key::A);
        A::ChoosePoints, EDIT, true, "Select points in 3-D", "Drags in the 3-D view choose the points that are seen there, to correct their label in all masks", shift(Key::S);
        A::AssignChosen, EDIT, false, "Assign label to selected points", "The points get the chosen label, in every mask that sees them", shift(Key::Enter);
        A::ClearChosen, EDIT, false, "Clear label of selected points", "The points get no label, in every mask that sees them", shift(Key::Backspace);
        A::AdoptPieces, EDIT, false, "Adopt hanging pieces", "Pieces of the cloud without a label that hang on one labelled thing get its label, in every mask that sees them", None;
        A::RangeFrom, RANGE, false, "Range begins here", "Changes of the chosen label go over frames from this one on", plain(Key::I);
        A::RangeTo, RANGE, false, "Range ends here", "Changes of the chosen label go over frames up to this one", shift(Key::I);
        A::DropRange, RANGE, false, "Drop range", "Changes go over the shown frame alone again", ctrl(Key::I);
        A::DeleteRange, RANGE, true, "Delete label over range", "It is not there: its pixels go, and no tracker brings them back", ctrl(Key::Delete);
        A::RestoreRange, RANGE, false, "Restore label over range", "Trackers may find it there again", ctrl_shift(Key::Delete);
        A::AppearsHere, RANGE, false, "Label appears here", "It was not there before this frame (back to the last anchor that shows it)", plain(Key::Comma);
        A::GoneFromHere, RANGE, false, "Label is gone from here", "It is not there from this frame on (up to the next anchor that shows it)", plain(Key::Period);
        A::LockRange, RANGE, true, "Lock or unlock label over range", "Its pixels stay as they are, whoever tracks, clicks or paints", plain(Key::K);
        A::HideRange, RANGE, false, "Hide or show label over range", "Its pixels are kept, but neither drawn, voted nor exported", plain(Key::H);
        A::MergeRange, RANGE, true, "Merge label over range…", "Its pixels and clicks become another label's", plain(Key::J);
        A::SplitRange, RANGE, false, "Split label over range…", "The piece under the pointer becomes another label, followed over the range", shift(Key::J);
        A::InterpolateRange, RANGE, false, "Interpolate label over range", "Puts shapes between those on the first and the last frame of the range", plain(Key::Y);
        A::CopyMask, RANGE, true, "Copy label's mask", "Remembers the chosen label's mask on this frame", shift(Key::C);
        A::PasteMask, RANGE, false, "Paste label's mask", "Puts the remembered mask onto the range; its frames become anchors", shift(Key::V);
        A::FillHoles, EDIT, true, "Fill holes of label", "Fills the chosen label's holes on this frame that are smaller than the size in the tool bar", shift(Key::H);
        A::RemoveIslands, EDIT, false, "Remove islands of label", "Removes the chosen label's islands on this frame that are smaller than the size in the tool bar; the largest piece stays", shift(Key::K);
        A::UseTool(Tool::Click), EDIT, true, "Click and box tool", "Left click includes, right click excludes, dragging makes a box", plain(Key::V);
        A::UseTool(Tool::Brush), EDIT, false, "Brush tool", "Paints the chosen label; Ctrl or right button erases, Shift+wheel sets the size", plain(Key::P);
        A::UseTool(Tool::Eraser), EDIT, false, "Eraser tool", "Takes the chosen label away; Shift+wheel sets the size", plain(Key::X);
        A::UseTool(Tool::Polygon), EDIT, false, "Polygon tool", "Click corners, or draw around with the button held; Enter or a double click fills the polygon (with Ctrl takes the label away), Backspace or right click takes the last corner", plain(Key::G);
        A::UseTool(Tool::Pull), EDIT, false, "Pull tool", "Press on the border of the chosen label and drag it to where it belongs", shift(Key::G);
        A::UseTool(Tool::Thin), EDIT, false, "Thin-structure tool", "Click two or more points along a stem or wire; Enter or a double click traces it, Backspace or right click takes the last one", plain(Key::W);
        A::SmallerBrush, EDIT, false, "Smaller brush", "Makes the brush smaller", plain(Key::OpenBracket);
        A::LargerBrush, EDIT, false, "Larger brush", "Makes the brush larger", plain(Key::CloseBracket);
        A::ToggleSnap, EDIT, false, "Snap brush to edges", "The brush stops at edges of the picture that the inner half of its radius does not cross", plain(Key::S);
        A::ShowBoth, VIEW, false, "Picture and 3-D", "Shows picture and 3-D view side by side", ctrl(Key::Num1);
        A::ShowPicture, VIEW, false, "Picture alone", "Shows only the picture", ctrl(Key::Num2);
        A::ShowScene, VIEW, false, "3-D alone", "Shows only the 3-D view", ctrl(Key::Num3);
        A::Fit, VIEW, true, "Fit picture", "Shows the whole picture", plain(Key::Num0);
        A::ActualSize, VIEW, false, "Picture at 100 %", "One picture pixel takes one screen pixel", shift(Key::Num0);
        A::ToggleMasks, VIEW, false, "Show masks", "Shows or hides the masks over the picture", plain(Key::M);
        A::ToggleOutlines, VIEW, false, "Show outlines", "Draws a line around every label", plain(Key::O);
        A::CompareBefore, VIEW, false, "Compare with before", "Shows this frame's masks before the last step that changed them, and back", plain(Key::F4);
        A::ToggleTimeline, VIEW, false, "Show timeline", "Shows or hides the grid of labels and frames above the filmstrip", plain(Key::F2);
        A::ToggleMatches, VIEW, false, "Cameras and matches", "Shows what the cameras were found with: matches between two frames, errors, and why frames have no camera", plain(Key::F6);
        A::ToggleMeasures, VIEW, false, "Measures", "Shows a table of what was measured of each label in 3-D: lengths, widths, areas, volumes, heights, angles", plain(Key::F8);
        A::NextLayer, VIEW, false, "Next layer", "Shows depth, normals and confidence in the photo's place, one after the other", plain(Key::F7);
        A::ToggleHover, VIEW, false, "Preview a click", "Shows lightly what a click would give where the pointer rests", plain(Key::F3);
        A::FrameCloud, VIEW, true, "Show whole cloud", "Brings the whole cloud into the 3-D view", plain(Key::A);
        A::LookThrough, VIEW, false, "Look through this frame's camera", "Puts the 3-D view where this frame was taken", plain(Key::L);
        A::LookFrom(Side::Front), VIEW, true, "From the front", "Looks at the scene from where most cameras stood", alt(Key::Num1);
        A::LookFrom(Side::Back), VIEW, false, "From behind", "Looks at the scene from behind", alt(Key::Num2);
        A::LookFrom(Side::Left), VIEW, false, "From the left", "Looks at the scene from the left", alt(Key::Num3);
        A::LookFrom(Side::Right), VIEW, false, "From the right", "Looks at the scene from the right", alt(Key::Num4);
        A::LookFrom(Side::Top), VIEW, false, "From above", "Looks at the scene from above", alt(Key::Num5);
        A::LookFrom(Side::Bottom), VIEW, false, "From below", "Looks at the scene from below", alt(Key::Num6);
        A::ToggleOrthographic, VIEW, false, "Orthographic or perspective", "In orthographic views things do not shrink with distance", alt(Key::O);
        A::ToggleTurntable, VIEW, false, "Turntable", "Turns the 3-D view about the vertical until you click or turn it yourself", alt(Key::T);
        A::ToggleTheme, VIEW, true, "Dark or light", "Changes between the dark and the light look", plain(Key::F9);
        A::PreviousFrame, GO, false, "Previous frame", "One frame back", plain(Key::ArrowLeft);
        A::NextFrame, GO, false, "Next frame", "One frame on", plain(Key::ArrowRight);
        A::Back10, GO, false, "10 frames back", "Ten frames back", shift(Key::ArrowLeft);
        A::Forward10, GO, false, "10 frames on", "Ten frames on", shift(Key::ArrowRight);
        A::FirstFrame, GO, false, "First frame", "To the first frame", plain(Key::Home);
        A::LastFrame, GO, false, "Last frame", "To the last frame", plain(Key::End);
        A::NextDoubtful, GO, true, "Next frame to check", "To the next frame whose mask is stale or uncertain", plain(Key::D);
        A::NextWorst, GO, false, "Next worst frame", "To the frame whose mask contradicts the 3-D vote most, then to the next after it", shift(Key::D);
        A::FindInScene, GO, false, "Find in 3-D", "Asks about the point of the cloud under the pointer and brings it into the middle of the 3-D view", plain(Key::Z);
        A::Track, RUN, false, "Track both ways", "Carries the anchors' masks to all frames", plain(Key::T);
        A::TrackForward, RUN, false, "Track forward from here", "Carries masks from this frame to later ones", plain(Key::F);
        A::TrackBackward, RUN, false, "Track backward from here", "Carries masks from this frame to earlier ones", plain(Key::B);
        A::Retrack, RUN, false, "Re-track this label around this frame", "Carries the chosen label anew up to the anchors next to this one; other labels stay", shift(Key::T);
        A::Suggest, RUN, false, "Look for unlabelled objects", "Offers areas without a label that move or stand apart", ctrl(Key::L);
        A::Propose, RUN, false, "Propose things on this frame", "Offers all that Segment Anything takes for a thing on this frame", ctrl_shift(Key::L);
        A::Reconstruct, RUN, true, "Reconstruct", "Makes cameras and depths with the settings of the Reconstruct panel", plain(Key::R);
        A::SetScale, RUN, false, "Set scale by ruler", "Scales cameras, depths, cloud and surface together until the ruler's two points are as far apart as they really are", None;
        A::Fuse, RUN, false, "Fuse", "Makes the labelled cloud: every point takes the label most views vote for", plain(Key::U);
        A::Stop, RUN, true, "Stop", "Stops what is running; what is finished is kept", ctrl(Key::Period);
        A::Cancel, RUN, false, "Cancel", "Drops the half-made box, stroke, polygon or thin structure; otherwise takes back chosen points, or closes the window of matches or measures. Work goes on", plain(Key::Escape);
        A::Palette, HELP, false, "Find action…", "Lists all actions; type to narrow the list", ctrl(Key::P);
        A::ShortcutSheet, HELP, false, "Shortcuts…", "Shows all shortcuts and lets you change them", plain(Key::Questionmark);
    }
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_action_has_text_and_tip() {
        for action in Action::all() {
            assert!(!action.text().is_empty(), "{action:?}");
            assert!(action.tip().len() > 8, "{action:?}");
        }
        assert_eq!(Action::ChooseLabel(3).default_keys(), plain(Key::Num3));
    }
}
