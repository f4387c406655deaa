use ostra_project::SegmenterId;
use std::collections::BTreeSet;
use std::path::PathBuf;

use super::canvas::{Draft, Tool, ZoomState};
use super::dialogs::{
    ExportForm, ModelsForm, NewProjectForm, PathPicker, PathRequest, PictureForm, RelocateForm,
    ScreenshotRequest, SheetState,
};
use super::panel_state::{LabelEditing, MatchView, PointCounts, Presence, Words};
use super::panels::{Asked, MeasureView, Ruler, SceneSelect};
use super::pointer::Rest;
use super::{Notices, Prefs, SceneLook, SessionView};
use ostra_masks::{Direction, LabelId, MaskFormat};
use ostra_project::{FuseRequest, ReconstructRequest};
use ostra_session::{InstancesRequest, PromptRequest, Surface, TrackSettings};
use ostra_view::{Coloring, Layer, Portrait, Side};

/// All that belongs to looking and not to the project: the frame shown, the tool, the eye. Never saved with a project.
pub struct ViewState {
    /// Number of the frame shown.
    pub frame: usize,
    /// The tool in hand.
    pub tool: Tool,
    /// The label that clicks and brush are for.
    pub label: Option<LabelId>,
    /// Whether masks are shown at all.
    pub masks_shown: bool,
    /// Labels (with all below them) that are not shown.
    pub hidden: BTreeSet<LabelId>,
    /// What the colours of points show.
    pub coloring: Coloring,
    /// What of the project the 3-D view shows.
    pub scene: SceneLook,
    /// What is shown of the result.
    pub shown: Shown,
    /// Taste, kept from one start to the next.
    pub prefs: Prefs,
    /// Zoom and place of the picture.
    pub zoom: ZoomState,
    /// What is being drawn and not yet sent.
    pub draft: Draft,
    /// Name of the segmenter to use.
    pub segmenter: SegmenterId,
    /// First and last frame that changes of a label go over; none = the shown frame alone.
    pub range: Option<(usize, usize)>,
    /// The label and frame whose mask was copied.
    pub copied: Option<(LabelId, usize)>,
    /// The masks before the last change are shown.
    pub compare: bool,
    /// Where the timeline's drag over frames began.
    pub range_from: Option<usize>,
    /// Settings of the Track panel.
    pub track: TrackSettings,
    /// Settings of the Reconstruct panel.
    pub reconstruct: ReconstructRequest,
    /// What is typed there for pairs to be matched.
    pub pairs_text: String,
    /// Settings of the Fuse panel.
    pub fuse: FuseRequest,
    /// What is typed there for a cloud to vote on.
    pub onto_text: String,
    /// The dialog that is open.
    pub dialog: Option<Dialog>,
    /// Form of the new-project dialog, kept while the window lives.
    pub new_project: NewProjectForm,
    /// Form of the export dialog.
    pub export: ExportForm,
    /// Form of the dialog for pictures.
    pub picture: PictureForm,
    /// A picture that the 3-D view is to make.
    pub screenshot_request: Option<ScreenshotRequest>,
    /// What is drawn of the 3-D view for it.
    pub portrait: Option<(ScreenshotRequest, Portrait)>,
    /// Form of the dialog for moved frames.
    pub relocate: RelocateForm,
    /// Form of the dialog of networks.
    pub models: ModelsForm,
    /// Kind of files that masks are read from.
    pub mask_format: MaskFormat,
    /// What the file chooser is open for.
    pub picker: PathPicker,
    /// What is typed in a dialog that asks for one path.
    pub path_text: String,
    /// Where the history shall be written as a recipe.
    pub recipe_to: Option<PathBuf>,
    /// The shortcut sheet.
    pub sheet: SheetState,
    /// What is looked for by words.
    pub words: Words,
    /// What is typed in the palette.
    pub palette_text: String,
    /// What is being edited in the label list.
    pub labels: LabelEditing,
    /// Which labels are on which frames.
    pub presence: Presence,
    /// Instances that are looked for and not yet made.
    pub instances: Option<InstancesRequest>,
    /// Points per label of the cloud.
    pub point_counts: PointCounts,
    /// Errors and warnings not yet dismissed.
    pub notices: Notices,
    /// What was done last, for the status line.
    pub note: String,
    /// The filmstrip scrolls to the shown frame next time.
    pub reveal_frame: bool,
    /// The point of the cloud that was asked about.
    pub asked: Option<Asked>,
    /// Asks the 3-D view to do something once.
    pub scene_action: Option<SceneAction>,
    /// Points that are being chosen in the 3-D view.
    pub scene_select: SceneSelect,
    /// A known length in the 3-D view.
    pub ruler: Ruler,
    /// The window of cameras and matches.
    pub matches: MatchView,
    /// The window of measures.
    pub measures: MeasureView,
    /// What is shown of the frame.
    pub layer: Layer,
    /// Where the pointer rests over the picture.
    pub rest: Option<Rest>,
    /// The prompt that a click there would send, to be previewed.
    pub hover_request: Option<PromptRequest>,
    /// Picture position under the pointer, in pixels.
    pub pointer_px: Option<glam::DVec2>,
    /// Middle of the shown picture, in pixels.
    pub picture_middle_px: glam::DVec2,
}

/// What is shown of the result in the 3-D view.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Shown {
    /// Its points.
    #[default]
    Points,
    /// The mesh, lit.
    Mesh,
    /// The sides of the mesh's triangles.
    Wireframe,
    /// The cubes that hold points.
    Voxels,
}

impl Shown {
    /// The triangles that are needed for it.
    #[must_use]
    pub fn surface(self) -> Option<Surface> {
        match self {
            Self::Points => None,
            Self::Mesh | Self::Wireframe => Some(Surface::Mesh),
            Self::Voxels => Some(Surface::Voxels),
        }
    }
}

/// What the 3-D view is asked to do once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SceneAction {
    /// Shows the whole cloud.
    FrameAll,
    /// Looks through the shown frame's camera.
    LookThrough,
    /// Brings the point asked about into the middle.
    ShowAsked,
    /// Looks from a side.
    LookFrom(Side),
}

/// The dialogs; at most one is open.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Dialog {
    /// A new project.
    NewProject,
    /// More frames for the open project.
    AddFrames,
    /// The place of frames that were moved.
    Relocate,
    /// Writing results to files.
    Export,
    /// A picture or film of the 3-D view.
    Picture,
    /// The networks and getting them.
    Models,
    /// The shortcut sheet.
    Shortcuts,
    /// The palette of actions.
    Palette,
    /// The label that gets the pixels of a merge or split.
    Into(IntoRequest),
    /// Path of something to open, typed or chosen.
    Path(PathRequest),
}

/// What another label is asked for: a label is merged into it over a range, or a piece of the label becomes it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IntoRequest {
    /// The label that gives its pixels.
    pub label: LabelId,
    /// First and last frame.
    pub range: (usize, usize),
    /// Where the piece is pointed at; `None` = all of the label.
    pub piece: Option<(usize, glam::DVec2)>,
}

impl ViewState {
    /// The state at the start, with the taste of last time.
    #[must_use]
    pub fn new(prefs: Prefs) -> Self {
        Self {
            frame: 0,
            tool: Tool::Click,
            label: None,
            masks_shown: true,
            hidden: BTreeSet::new(),
            coloring: Coloring::Rgb,
            scene: SceneLook::default(),
            shown: Shown::Points,
            prefs,
            zoom: ZoomState::default(),
            draft: Draft::default(),
            segmenter: SegmenterId::Auto,
            range: None,
            copied: None,
            compare: false,
            range_from: None,
            track: TrackSettings::default(),
            reconstruct: ReconstructRequest::default(),
            pairs_text: String::new(),
            fuse: FuseRequest::default(),
            onto_text: String::new(),
            dialog: None,
            new_project: NewProjectForm::default(),
            export: ExportForm::default(),
            picture: PictureForm::default(),
            screenshot_request: None,
            portrait: None,
            relocate: RelocateForm::default(),
            models: ModelsForm::default(),
            mask_format: MaskFormat::default(),
            picker: PathPicker::default(),
            path_text: String::new(),
            recipe_to: None,
            sheet: SheetState::default(),
            words: Words::default(),
            palette_text: String::new(),
            labels: LabelEditing::default(),
            presence: Presence::default(),
            instances: None,
            point_counts: PointCounts::default(),
            notices: Notices::default(),
            note: String::new(),
            reveal_frame: true,
            asked: None,
            scene_action: None,
            scene_select: SceneSelect::default(),
            ruler: Ruler::default(),
            matches: MatchView::default(),
            measures: MeasureView::default(),
            layer: Layer::Photo,
            rest: None,
            hover_request: None,
            pointer_px: None,
            picture_middle_px: glam::DVec2::ZERO,
        }
    }

    /// Forgets what belongs to the project that was open.
    pub fn project_changed(&mut self) {
        let notices = std::mem::take(&mut self.notices);
        let kept = std::mem::take(&mut self.prefs);
        let (new_project, picker) = (
            std::mem::take(&mut self.new_project),
            std::mem::take(&mut self.picker),
        );
        *self = Self {
            notices,
            new_project,
            picker,
            ..Self::new(kept)
        };
    }

    /// Brings frame and label back into what the project has.
    pub fn keep_valid(&mut self, session: &SessionView<'_>) {
        let last = session.project.frames.len().saturating_sub(1);
        self.frame = self.frame.min(last);
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

    /// Follows a scene whose lengths were multiplied: what was measured or typed in its unit stays what it was.
    pub fn scale_by(&mut self, factor: f64) {
        self.ruler.scale_by(factor);
        self.measures.scale_by(factor);
        self.fuse.voxel = self.fuse.voxel.map(|voxel| voxel * factor);
        // Points are chosen by what a camera saw where it stood before.
        self.scene_select.steps.clear();
        self.asked = None;
    }

    /// Settings that carry the chosen label anew around the shown frame; none where that is no anchor with room around
    /// it.
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

    /// Whether nothing is half made and no dialog is open, so that another frame may be shown unasked.
    #[must_use]
    pub fn is_free(&self) -> bool {
        self.dialog.is_none() && !self.draft.is_half_made()
    }

    /// The frames that a change of the chosen label goes over: the range, else the shown frame.
    #[must_use]
    pub fn frames_meant(&self) -> (usize, usize) {
        self.range.unwrap_or((self.frame, self.frame))
    }

    /// Shows another frame; half-made drawing on the old one is dropped.
    pub fn go_to(&mut self, frame: usize) {
        if self.frame != frame {
            self.frame = frame;
            self.draft.drop_half_made();
            self.reveal_frame = true;
        }
    }
}
