use ostra_project::SegmenterId;
use std::collections::BTreeSet;
use std::path::PathBuf;

use super::canvas::{AnswerBar, CanvasMap, Draft, KeyPointer, PreviewOutline, Tool, ZoomState};
use super::dialogs::{
    ExportForm, HelpPage, ImageForm, IntoRequest, ModelsForm, NewProjectForm, PaletteState,
    PathPicker, PathRequest, RecipeTarget, RelocateForm, ScreenshotRequest, SheetState,
};
use super::frame_review::FrameReview;
use super::panel_state::{LabelEditing, MatchView, PointCounts, TextPrompt};
use super::panels::{InspectedPoint, MeasureView, Ruler, SceneSelect};
use super::playback::Playback;
use super::pointer::HoverDwell;
use super::steps_state::StepsState;
use super::{Notices, Panes, Prefs, SceneLook, SessionView, Tone};
use ostra_masks::{Direction, LabelId, MaskFormat};
use ostra_project::{FuseRequest, ReconstructRequest};
use ostra_session::{ExportedItem, InstancesRequest, PromptRequest, SurfaceKind, TrackSettings};
use ostra_view::{Coloring, Layer, OverlayStyle, RenderRequest, Side};

/// State of the window that is not part of the project, such as the shown frame and tool.
///
/// It is never saved with a project.
pub struct ViewState {
    /// Index of the shown frame.
    pub frame: usize,
    /// Active tool.
    pub tool: Tool,
    /// Selected label, which clicks and the brush apply to.
    pub label: Option<LabelId>,
    /// Whether masks are shown.
    pub masks_shown: bool,
    /// Hidden labels. Their descendants are hidden too.
    pub hidden: BTreeSet<LabelId>,
    /// Whether the image shows the mask of the selected label only.
    pub only_label: bool,
    /// What the point colours encode.
    pub coloring: Coloring,
    /// Clipping, isolation and label level of the 3-D view.
    pub scene: SceneLook,
    /// Which result the 3-D view shows.
    pub shown: Shown,
    /// Preferences, kept between sessions.
    pub prefs: Prefs,
    /// Zoom and position of the image.
    pub zoom: ZoomState,
    /// Drawing in progress, not yet sent as a command.
    pub draft: Draft,
    /// Playback of the frames.
    pub playback: Playback,
    /// Segmenter to use.
    pub segmenter: SegmenterId,
    /// First and last frame of the selected range; `None` means the shown frame only.
    pub range: Option<(usize, usize)>,
    /// Label and frame of the copied mask.
    pub copied: Option<(LabelId, usize)>,
    /// Whether the mask before the last change is shown.
    pub compare: bool,
    /// Rows of the timeline that were visible when the project was first drawn.
    pub timeline_rows: Option<usize>,
    /// Frame at which a drag over the timeline started.
    pub range_from: Option<usize>,
    /// Settings of the Track panel.
    pub track: TrackSettings,
    /// Settings of the Reconstruct panel.
    pub reconstruct: ReconstructRequest,
    /// Text typed in the Reconstruct panel for the image pairs to match.
    pub pairs_text: String,
    /// Settings of the Fuse panel.
    pub fuse: FuseRequest,
    /// Path typed in the Fuse panel of a cloud to vote on.
    pub onto_text: String,
    /// Open dialog.
    pub dialog: Option<Dialog>,
    /// Form of the new-project dialog. It survives a change of project.
    pub new_project: NewProjectForm,
    /// Whether an example project can be made.
    pub has_example: bool,
    /// Whether the user requested the example project.
    pub wants_example: bool,
    /// Name of the graphics adapter; `None` without one.
    pub adapter: Option<String>,
    /// Page of the guide.
    pub guide_page: usize,
    /// Form of the export dialog.
    pub export: ExportForm,
    /// Files and folders that the last export wrote.
    pub exported: Vec<ExportedItem>,
    /// Folder to open in the file manager of the system.
    pub folder_to_show: Option<PathBuf>,
    /// Form of the dialog that saves the 3-D view.
    pub image: ImageForm,
    /// Requested image or video of the 3-D view.
    pub screenshot_request: Option<ScreenshotRequest>,
    /// Content of the 3-D view for the screenshot request, ready to be rendered.
    pub portrait: Option<(ScreenshotRequest, RenderRequest)>,
    /// Form of the dialog for moved frames.
    pub relocate: RelocateForm,
    /// Form of the networks dialog.
    pub models: ModelsForm,
    /// File format for importing masks.
    pub mask_format: MaskFormat,
    /// Native file chooser and the field that it was opened for.
    pub picker: PathPicker,
    /// Path typed in a dialog with a single path field.
    pub path_text: String,
    /// File of that dialog for which the file chooser asked before replacing an existing one.
    pub confirmed_path: Option<PathBuf>,
    /// File to write the history to as a recipe.
    pub recipe_to: Option<RecipeTarget>,
    /// Whether the offer to continue interrupted work was dismissed.
    pub dismisses_unfinished: bool,
    /// State of the shortcut sheet.
    pub sheet: SheetState,
    /// Text and minimum score of the search by text.
    pub text_prompt: TextPrompt,
    /// State of the palette.
    pub palette: PaletteState,
    /// Whether the menu bar takes the keyboard on its next draw.
    pub focuses_menu: bool,
    /// Text typed in the dialog that goes to a frame.
    pub frame_text: String,
    /// Edits in progress in the label list.
    pub labels: LabelEditing,
    /// Labels on each frame, confirmed frames and frames to check.
    pub frames: FrameReview,
    /// Settings of the instances that are previewed but not yet created.
    pub instances: Option<InstancesRequest>,
    /// Points per label of the cloud.
    pub point_counts: PointCounts,
    /// Errors and warnings not yet dismissed.
    pub notices: Notices,
    /// Last event, shown in the status line.
    pub note: String,
    /// Whether the filmstrip scrolls to the shown frame on its next draw.
    pub reveal_frame: bool,
    /// Inspected point of the cloud.
    pub inspected_point: Option<InspectedPoint>,
    /// One-time action for the 3-D view to perform on its next draw.
    pub scene_action: Option<SceneAction>,
    /// Selection of points in the 3-D view.
    pub scene_select: SceneSelect,
    /// Ruler along a known length in the 3-D view.
    pub ruler: Ruler,
    /// State of the cameras and matches window.
    pub matches: MatchView,
    /// State of the traits window.
    pub measures: MeasureView,
    /// Which step of the way from frames to measures is open.
    pub steps: StepsState,
    /// Whether a cloud with labels was shown, so that its colours were chosen.
    has_shown_labels: bool,
    /// Layer of the frame to show: image, depth, normals or confidence.
    pub layer: Layer,
    /// Brightness and contrast of the shown image.
    pub tone: Tone,
    /// Place where the pointer rests over the image.
    pub rest: Option<HoverDwell>,
    /// Prompt that a click at the pointer would send, for the preview.
    pub hover_request: Option<PromptRequest>,
    /// Outline of the preview.
    pub preview: PreviewOutline,
    /// State of the bar below the last answer.
    pub answer: AnswerBar,
    /// Rectangle of all panes when the window was last drawn, in screen points.
    pub panes_rect: egui::Rect,
    /// Image position under the pointer, in pixels.
    pub pointer_px: Option<glam::DVec2>,
    /// Pointer that arrow keys move over the image.
    pub key_pointer: KeyPointer,
    /// How the image was last drawn.
    pub canvas_map: Option<CanvasMap>,
}

/// Result shown in the 3-D view.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Shown {
    /// Points of the cloud.
    #[default]
    Points,
    /// Shaded mesh.
    Mesh,
    /// Edges of the mesh's triangles.
    Wireframe,
    /// Cubes that contain points.
    Voxels,
}

impl Shown {
    /// Returns the surface that has to be loaded to show this result.
    #[must_use]
    pub fn surface(self) -> Option<SurfaceKind> {
        match self {
            Self::Points => None,
            Self::Mesh | Self::Wireframe => Some(SurfaceKind::Mesh),
            Self::Voxels => Some(SurfaceKind::Voxels),
        }
    }
}

/// One-time action of the 3-D view.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SceneAction {
    /// Shows the whole cloud.
    FrameAll,
    /// Shows the cameras and the points.
    FrameCameras,
    /// Views the scene from the camera of the shown frame.
    LookThrough,
    /// Centres the inspected point.
    ShowInspected,
    /// Views the scene from one side.
    LookFrom(Side),
}

/// Dialogs of the window. At most one is open.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Dialog {
    /// Creates a project.
    NewProject,
    /// Adds frames to the open project.
    AddFrames,
    /// Locates frames whose files have moved.
    Relocate,
    /// Exports results to files.
    Export,
    /// Lists what an export wrote.
    Exported,
    /// Saves the 3-D view as an image or video.
    Image,
    /// Lists and installs networks.
    Models,
    /// Shows and changes preferences.
    Preferences,
    /// Shows and changes shortcuts.
    Shortcuts,
    /// Goes to a frame by number or name.
    GoToFrame,
    /// Searches the list of actions.
    Palette,
    /// Shows a page of the help.
    Help(HelpPage),
    /// Chooses the label that receives the pixels of a merge or split.
    Into(IntoRequest),
    /// Asks for a single path, typed or chosen.
    Path(PathRequest),
}

impl ViewState {
    /// Returns the state of a new window with stored preferences.
    #[must_use]
    pub fn new(prefs: Prefs) -> Self {
        Self {
            frame: 0,
            tool: Tool::Click,
            label: None,
            masks_shown: true,
            hidden: BTreeSet::new(),
            only_label: false,
            coloring: Coloring::Rgb,
            scene: SceneLook::default(),
            shown: Shown::Points,
            prefs,
            zoom: ZoomState::default(),
            draft: Draft::default(),
            playback: Playback::default(),
            segmenter: SegmenterId::Auto,
            range: None,
            copied: None,
            compare: false,
            timeline_rows: None,
            range_from: None,
            track: TrackSettings::default(),
            reconstruct: ReconstructRequest::default(),
            pairs_text: String::new(),
            fuse: FuseRequest::default(),
            onto_text: String::new(),
            dialog: None,
            new_project: NewProjectForm::default(),
            has_example: false,
            wants_example: false,
            adapter: None,
            guide_page: 0,
            export: ExportForm::default(),
            exported: Vec::new(),
            folder_to_show: None,
            image: ImageForm::default(),
            screenshot_request: None,
            portrait: None,
            relocate: RelocateForm::default(),
            models: ModelsForm::default(),
            mask_format: MaskFormat::default(),
            picker: PathPicker::default(),
            path_text: String::new(),
            confirmed_path: None,
            recipe_to: None,
            dismisses_unfinished: false,
            sheet: SheetState::default(),
            text_prompt: TextPrompt::default(),
            palette: PaletteState::default(),
            focuses_menu: false,
            frame_text: String::new(),
            labels: LabelEditing::default(),
            frames: FrameReview::default(),
            instances: None,
            point_counts: PointCounts::default(),
            notices: Notices::default(),
            note: String::new(),
            reveal_frame: true,
            inspected_point: None,
            scene_action: None,
            scene_select: SceneSelect::default(),
            ruler: Ruler::default(),
            matches: MatchView::default(),
            measures: MeasureView::default(),
            steps: StepsState::default(),
            has_shown_labels: false,
            layer: Layer::Image,
            tone: Tone::default(),
            rest: None,
            hover_request: None,
            preview: PreviewOutline::default(),
            answer: AnswerBar::default(),
            panes_rect: egui::Rect::NOTHING,
            pointer_px: None,
            key_pointer: KeyPointer::default(),
            canvas_map: None,
        }
    }

    /// Resets everything that belongs to the previous project.
    ///
    /// Preferences, notices, the new-project form and the file chooser are kept.
    pub fn project_changed(&mut self) {
        let notices = std::mem::take(&mut self.notices);
        let kept = std::mem::take(&mut self.prefs);
        let (new_project, picker) = (
            std::mem::take(&mut self.new_project),
            std::mem::take(&mut self.picker),
        );
        let (adapter, models) = (self.adapter.take(), std::mem::take(&mut self.models));
        *self = Self {
            notices,
            new_project,
            picker,
            adapter,
            models,
            has_example: self.has_example,
            ..Self::new(kept)
        };
    }

    /// Replaces a frame, range or label that the project no longer has.
    pub fn keep_valid(&mut self, session: &SessionView<'_>) {
        let last = session.project.frames.len().saturating_sub(1);
        self.frame = self.frame.min(last);
        self.color_by_label(session);
        self.measures.keep_valid(session);
        self.range = self.range.filter(|&(_, to)| to <= last);
        self.copied = self
            .copied
            .filter(|(label, _)| session.project.labels.get(*label).is_some());
        if self
            .label
            .is_none_or(|label| session.project.labels.get(label).is_none())
        {
            self.label = session.project.labels.iter().next().map(|label| label.id);
        }
    }

    /// Colours points by label when the first cloud with labels comes.
    fn color_by_label(&mut self, session: &SessionView<'_>) {
        let has_labels = !self.has_shown_labels
            && session
                .cloud
                .is_some_and(|cloud| cloud.labels.iter().any(|&label| label != LabelId::NONE));
        if has_labels {
            self.has_shown_labels = true;
            if self.coloring == Coloring::Rgb {
                self.coloring = Coloring::Label;
            }
        }
    }

    /// Sets the options of *Reconstruct*.
    pub(super) fn set_reconstruction(&mut self, request: &ReconstructRequest) {
        self.reconstruct = request.clone();
        let pairs = request.pairs.iter().map(|[a, b]| format!("{a},{b}"));
        self.pairs_text = pairs.collect::<Vec<_>>().join(" ");
    }

    /// Multiplies lengths in scene units by `factor`; drops the selected and the inspected points.
    pub fn scale_by(&mut self, factor: f64) {
        self.ruler.scale_by(factor);
        self.measures.scale_by(factor);
        self.fuse.voxel = self.fuse.voxel.map(|voxel| voxel * factor);
        // A selection is stored with the camera poses from before the change of scale.
        self.scene_select.steps.clear();
        self.inspected_point = None;
    }

    /// Lists what an export wrote; while the user draws or answers a dialog, only in a note.
    pub(super) fn show_exported(&mut self, items: Vec<ExportedItem>) {
        if let Some(folder) = items.first().and_then(|item| item.path.parent()) {
            self.note = format!("Exported to {}", folder.display());
        }
        if self.is_free() {
            self.dialog = Some(Dialog::Exported);
        }
        self.exported = items;
    }

    /// Starts the ruler in the 3-D view, to set the scale by a known length.
    pub(crate) fn start_ruler(&mut self) {
        self.ruler.start();
        self.scene_select.in_hand = false;
        self.dialog = None;
        if self.prefs.panes == Panes::Image {
            self.prefs.panes = Panes::Both;
        }
    }

    /// Returns the settings that track the selected label again around the shown frame.
    ///
    /// Returns `None` where the shown frame is not a keyframe or both its neighbours are keyframes.
    #[must_use]
    pub fn retracking(&self, session: &SessionView<'_>) -> Option<TrackSettings> {
        let labels = vec![self.label?];
        let settings = TrackSettings {
            labels,
            direction: Direction::Both,
            ..self.track.clone()
        };
        settings.around(session.project, self.frame).ok()
    }

    /// Returns `true` if no drawing is in progress and no dialog is open.
    ///
    /// Only then may the window switch to another frame by itself.
    #[must_use]
    pub fn is_free(&self) -> bool {
        self.dialog.is_none() && !self.draft.is_half_made()
    }

    /// Returns the frames that a change of the selected label applies to.
    ///
    /// This is the selected range, or else the shown frame.
    #[must_use]
    pub fn frames_meant(&self) -> (usize, usize) {
        self.range.unwrap_or((self.frame, self.frame))
    }

    /// Returns the only label that the image shows, with its child labels; `None` shows all.
    #[must_use]
    pub fn shown_label(&self) -> Option<LabelId> {
        self.label.filter(|_| self.only_label)
    }

    /// Empties the field of a dialog with a single path field.
    pub(crate) fn clear_path(&mut self) {
        self.path_text.clear();
        self.confirmed_path = None;
    }

    /// Returns the style of masks over the image.
    pub(crate) fn overlay_style(&self) -> OverlayStyle {
        OverlayStyle {
            opacity: self.prefs.opacity,
            outlines: self.prefs.outlines,
            hidden: self.hidden.clone(),
            only: self.shown_label(),
        }
    }

    /// Shows another frame and pauses playback.
    ///
    /// A drawing in progress on the old frame is dropped.
    pub fn go_to(&mut self, frame: usize) {
        self.playback.pause();
        self.show(frame);
    }

    /// Shows another frame. A drawing in progress on the old frame is dropped.
    pub(crate) fn show(&mut self, frame: usize) {
        if self.frame != frame {
            self.frame = frame;
            self.draft.drop_half_made();
            self.reveal_frame = true;
        }
    }
}
