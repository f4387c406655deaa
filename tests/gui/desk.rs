//! A window without a session: it shows a made-up project and collects the commands.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use egui::{Pos2, Ui, Vec2};
use egui_kittest::kittest::{NodeT, Queryable};
use egui_kittest::{Harness, HarnessBuilder};
use glam::{DQuat, DVec3, Vec3};
use ostra_app::{Layers, Prefs, SessionView, Shell};
use ostra_cloud::conflicts::FrameConflict;
use ostra_cloud::fuse::Votes;
use ostra_cloud::measure::{LengthUnit, TraitRow};
use ostra_cloud::select::Selection;
use ostra_cloud::{LabelledCloud, LabelledMesh};
use ostra_compute::nn::ModelStatus;
use ostra_frames::{Frame, FrameCamera, Image, ImageSource, Orientation};
use ostra_geometry::{Camera, Pose};
use ostra_masks::{Label, LabelId, LabelMask, LabelTree, RunMask};
use ostra_project::workflow::WorkflowStep;
use ostra_project::{FrameMask, MaskOrigin, Project};
use ostra_session::JobView;
use ostra_session::{
    Angles, Command, DepthPoints, EngineInfo, Grounding, Images, ProposedInstances, RecentProject,
    SparseReconstruction, Suggestion, Survey, Unfinished, list_engines, list_models,
};

pub const WIDTH: u32 = 64;
pub const HEIGHT: u32 = 48;

/// The window, the data it shows, and the commands it requested.
pub struct Desk {
    pub shell: Shell,
    pub project: Project,
    pub root: Option<PathBuf>,
    pub cloud: Option<Arc<LabelledCloud>>,
    pub votes: Option<Arc<Votes>>,
    pub surface: Option<Arc<LabelledMesh>>,
    pub preview_cloud: Option<Arc<LabelledCloud>>,
    pub depth_points: Option<Arc<DepthPoints>>,
    pub sparse: Option<Arc<SparseReconstruction>>,
    pub chosen: Option<Arc<Selection>>,
    pub inspected: Option<PathBuf>,
    pub images: Images,
    pub layers: Option<Layers>,
    pub hovered: Option<Arc<RunMask>>,
    pub jobs: Vec<JobView>,
    pub engines: Vec<EngineInfo>,
    pub models: Vec<ModelStatus>,
    pub unfinished: Option<Unfinished>,
    pub last_prompt: Option<(usize, LabelId)>,
    pub undo: Option<String>,
    pub recent: Vec<PathBuf>,
    pub recent_projects: BTreeMap<PathBuf, RecentProject>,
    pub survey: Option<Arc<Survey>>,
    pub survey_images: Images,
    pub before: Option<Arc<RunMask>>,
    pub suggestions: Vec<Suggestion>,
    pub proposed: Option<Arc<ProposedInstances>>,
    pub grounding: Option<Grounding>,
    pub conflicts: BTreeMap<usize, FrameConflict>,
    pub traits: Option<Arc<Vec<TraitRow>>>,
    pub angles: Angles,
    pub size: Vec2,
    /// Whether files hover over the window.
    pub dragged: bool,
    pub unit: LengthUnit,
    pub requested: Vec<Command>,
    pub revision: u64,
    /// Project and conflicts when the window was last drawn.
    pub drawn: Option<(Project, BTreeMap<usize, FrameConflict>)>,
}

impl Desk {
    /// Returns a desk with nothing open.
    pub fn empty() -> Self {
        Self {
            shell: Shell::new(Prefs::default(), None),
            project: Project::default(),
            root: None,
            cloud: None,
            votes: None,
            surface: None,
            preview_cloud: None,
            depth_points: None,
            sparse: None,
            chosen: None,
            inspected: None,
            images: Images::new(|frame| Ok(Arc::new(image(frame))), || {}),
            layers: None,
            hovered: None,
            jobs: Vec::new(),
            unfinished: None,
            engines: list_engines(),
            models: list_models().unwrap(),
            last_prompt: None,
            undo: None,
            recent: Vec::new(),
            recent_projects: BTreeMap::new(),
            survey: None,
            survey_images: Images::new(|frame| Ok(Arc::new(image(frame))), || {}),
            before: None,
            suggestions: Vec::new(),
            proposed: None,
            grounding: None,
            conflicts: BTreeMap::new(),
            traits: None,
            angles: Angles::new(),
            size: Vec2::new(1400.0, 900.0),
            dragged: false,
            unit: LengthUnit::Metre,
            requested: Vec::new(),
            revision: 0,
            drawn: None,
        }
    }

    /// Returns a desk with twelve frames, cameras, three labels, masks of every state and a cloud.
    pub fn sample() -> Self {
        Self {
            project: project(),
            root: Some("/projects/tiller".into()),
            cloud: Some(Arc::new(cloud())),
            undo: Some("Prompt".into()),
            ..Self::empty()
        }
    }

    pub fn ui(&mut self, ui: &mut Ui) {
        self.note_changes();
        self.draw(ui);
    }

    /// Draws the window; a change since it was last drawn must have changed `revision`.
    pub fn draw(&mut self, ui: &mut Ui) {
        let session = SessionView {
            preview_cloud: self.preview_cloud.as_ref(),
            depth_points: self.depth_points.as_ref(),
            votes: self.votes.as_ref(),
            proposed: self.proposed.as_ref(),
            has_surface: self.surface.is_some(),
            surface: self.surface.as_ref(),
            project: &self.project,
            root: self.root.as_deref(),
            cloud: self.cloud.as_ref(),
            sparse: self.sparse.as_ref(),
            chosen: self.chosen.as_ref().map(Ok),
            inspected: self.inspected.as_deref(),
            images: Some(&self.images),
            layers: self.layers.as_ref(),
            hovered: self.hovered.as_ref(),
            jobs: &self.jobs,
            unfinished: self.unfinished.as_ref(),
            engines: &self.engines,
            models: &self.models,
            last_prompt: self.last_prompt,
            undo: self.undo.as_deref(),
            redo: None,
            recent: &self.recent,
            recent_projects: Some(&self.recent_projects),
            survey: self.survey.as_ref(),
            survey_images: Some(&self.survey_images),
            before: self.before.as_ref(),
            suggestions: &self.suggestions,
            grounding: self.grounding.as_ref(),
            traits: self.traits.as_ref(),
            angles: Some(&self.angles),
            unit: self.unit,
            conflicts: &self.conflicts,
            vote_mismatch: None,
            revision: self.revision,
        };
        self.requested.extend(self.shell.ui(ui, &session));
    }

    /// Changes the revision if a test changed the project or its conflicts.
    fn note_changes(&mut self) {
        let is_drawn = self.drawn.as_ref().is_some_and(|(project, conflicts)| {
            *project == self.project && *conflicts == self.conflicts
        });
        if !is_drawn {
            self.drawn = Some((self.project.clone(), self.conflicts.clone()));
            self.revision += 1;
        }
    }

    /// Returns a harness that shows this desk.
    pub fn shown(self) -> Harness<'static, Self> {
        self.shown_by(Harness::builder())
    }

    pub fn shown_by(self, builder: HarnessBuilder<Self>) -> Harness<'static, Self> {
        let size = self.size;
        self.shown_at(builder, size)
    }

    pub fn shown_at(self, builder: HarnessBuilder<Self>, size: Vec2) -> Harness<'static, Self> {
        let mut harness = builder
            .with_size(size)
            .build_ui_state(|ui, desk: &mut Self| desk.ui(ui), self);
        if harness.state().dragged {
            let hovered = &mut harness.input_mut().hovered_files;
            hovered.push(egui::HoveredFile::default());
        }
        harness.run_steps(4);
        harness
    }
}

/// Returns the screen position of an image position while the image fits its pane.
pub fn on_screen(harness: &Harness<'_, Desk>, x: f32, y: f32) -> Pos2 {
    let frame = &harness.state().project.frames[harness.state().shell.view.frame];
    let pane = harness
        .get_by_label(&format!("Image {}", frame.name))
        .rect();
    let free = pane.size() - Vec2::splat(20.0);
    let scale = (free.x / frame.width as f32).min(free.y / frame.height as f32);
    pane.center()
        + (Vec2::new(x, y) - Vec2::new(frame.width as f32, frame.height as f32) / 2.0) * scale
}

/// Returns the event of a button that is pressed or released.
pub fn button_event(pos: Pos2, button: egui::PointerButton, pressed: bool) -> egui::Event {
    egui::Event::PointerButton {
        pos,
        button,
        pressed,
        modifiers: egui::Modifiers::NONE,
    }
}

/// Presses and releases a button, with frames between the events.
pub fn click_at(harness: &mut Harness<'_, Desk>, at: Pos2, button: egui::PointerButton) {
    drag(harness, at, at, button);
}

/// Drags from one position to another.
pub fn drag(harness: &mut Harness<'_, Desk>, from: Pos2, to: Pos2, button: egui::PointerButton) {
    let press = |pos, pressed| button_event(pos, button, pressed);
    harness.hover_at(from);
    harness.run_steps(1);
    harness.event(press(from, true));
    harness.run_steps(1);
    for step in 1..=4_u8 {
        if from != to {
            harness.hover_at(from + (to - from) * (f32::from(step) / 4.0));
            harness.run_steps(1);
        }
    }
    harness.event(press(to, false));
    harness.run_steps(2);
}

/// Drags from one position to another and keeps the button pressed.
pub fn hold(harness: &mut Harness<'_, Desk>, from: Pos2, to: Pos2) {
    harness.hover_at(from);
    harness.drag_at(from);
    harness.run_steps(1);
    harness.hover_at(to);
    harness.run_steps(2);
}

/// Drags along `places` as while frames are slow.
///
/// The press and the first half of the path fall into one frame, the rest and the release into the
/// next.
pub fn drag_fast(harness: &mut Harness<'_, Desk>, places: &[Pos2], button: egui::PointerButton) {
    let press = |pos, pressed| button_event(pos, button, pressed);
    let moved = |places: &[Pos2]| {
        places
            .iter()
            .map(|&at| egui::Event::PointerMoved(at))
            .collect::<Vec<_>>()
    };
    let (first, last) = places.split_at(places.len() / 2);
    let frames = [
        moved(&first[..1]),
        [vec![press(first[0], true)], moved(&first[1..])].concat(),
        [moved(last), vec![press(last[last.len() - 1], false)]].concat(),
    ];
    for events in frames {
        harness.input_mut().events.extend(events);
        harness.step();
    }
    harness.run_steps(2);
}

/// Drags as while frames are slow: the press falls into one frame, all else into the next.
pub fn drag_in_two_frames(harness: &mut Harness<'_, Desk>, from: Pos2, to: Pos2) {
    let press = |pos, pressed| button_event(pos, egui::PointerButton::Primary, pressed);
    harness.hover_at(from);
    harness.run_steps(1);
    harness.event(press(from, true));
    harness.run_steps(1);
    let moved = (1..=4_u8)
        .map(|step| egui::Event::PointerMoved(from + (to - from) * (f32::from(step) / 4.0)));
    let events = moved.chain([press(to, false)]);
    harness.input_mut().events.extend(events);
    harness.run_steps(2);
}

/// Presses at the first place, moves along the others and releases, all within one frame.
///
/// A tap on a touchpad sends its events like this.
pub fn flick(harness: &mut Harness<'_, Desk>, places: &[Pos2], button: egui::PointerButton) {
    let press = |pos, pressed| button_event(pos, button, pressed);
    let (first, last) = (places[0], places[places.len() - 1]);
    harness.hover_at(first);
    harness.run_steps(1);
    let moved = places[1..].iter().map(|&at| egui::Event::PointerMoved(at));
    let events = std::iter::once(press(first, true))
        .chain(moved)
        .chain([press(last, false)]);
    harness.input_mut().events.extend(events);
    harness.run_steps(2);
}

/// Presses and releases a key with modifiers.
pub fn press(harness: &mut Harness<'_, Desk>, modifiers: egui::Modifiers, key: egui::Key) {
    harness.key_press_modifiers(modifiers, key);
    harness.run_steps(2);
}

/// Opens a step of the side panel.
pub fn open_step(harness: &mut Harness<'_, Desk>, step: WorkflowStep) {
    if harness.state().shell.view.steps.open == Some(step) {
        return;
    }
    let title = match step {
        WorkflowStep::Label => "Label: ",
        WorkflowStep::Track => "Track: ",
        WorkflowStep::Geometry => "Cameras & depth: ",
        WorkflowStep::Cloud => "Cloud: ",
        WorkflowStep::Measure => "Measure & export: ",
    };
    // A tooltip may repeat the text of the header.
    let header = harness.get_all_by_label_contains(title).next();
    header.unwrap().click();
    harness.run_steps(3);
    assert_eq!(harness.state().shell.view.steps.open, Some(step));
}

/// Opens a step of the side panel with its advanced settings.
pub fn open_advanced(harness: &mut Harness<'_, Desk>, step: WorkflowStep) {
    open_step(harness, step);
    harness.get_by_label("Advanced").click();
    harness.run_steps(30);
}

/// Returns a window for each step that has advanced settings, with these open.
pub fn advanced_steps() -> impl Iterator<Item = (WorkflowStep, Harness<'static, Desk>)> {
    let steps = [
        WorkflowStep::Label,
        WorkflowStep::Track,
        WorkflowStep::Geometry,
        WorkflowStep::Cloud,
    ];
    steps.into_iter().map(|step| {
        let mut harness = Desk::sample().shown();
        open_advanced(&mut harness, step);
        (step, harness)
    })
}

/// Draws frames of the window until something is true, which threads do.
pub fn until(
    harness: &mut Harness<'static, Desk>,
    is_true: impl Fn(&Harness<'static, Desk>) -> bool,
) {
    for _ in 0..2000 {
        if is_true(harness) {
            return;
        }
        harness.run_steps(1);
        std::thread::park_timeout(Duration::from_millis(5));
    }
    panic!("it did not become true")
}

/// Clicks a tool in the menu of what does not fit above the image, and closes the menu.
pub fn choose_more(harness: &mut Harness<'_, Desk>, name: &str) {
    harness.get_by_label("More image tools").click();
    harness.run_steps(3);
    harness.get_by_label(name).click();
    harness.run_steps(2);
    press(harness, egui::Modifiers::NONE, egui::Key::Escape);
}

/// Returns the labels of all nodes, for failure messages.
pub fn labels(harness: &Harness<'_, Desk>) -> Vec<String> {
    harness
        .root()
        .children_recursive()
        .filter_map(|node| node.accesskit_node().label())
        .collect()
}

pub fn image(frame: usize) -> Image {
    let pixel = |i: u32| {
        let (x, y) = (i % WIDTH, i / WIDTH);
        [(x * 4) as u8, (y * 5) as u8, (frame * 20 % 256) as u8]
    };
    Image {
        width: WIDTH,
        height: HEIGHT,
        pixels: (0..WIDTH * HEIGHT).map(pixel).collect(),
    }
}

pub fn tree() -> LabelTree {
    let mut tree = LabelTree::default();
    for (id, name, parent) in [(1, "plant", None), (2, "leaf", Some(1)), (3, "pot", None)] {
        let id = LabelId(id);
        let parent = parent.map(LabelId);
        tree.set(Label {
            id,
            name: name.into(),
            color: LabelTree::color_for(id),
            parent,
        })
        .unwrap();
    }
    tree
}

fn project() -> Project {
    let camera = Camera::pinhole(WIDTH, HEIGHT, [60.0, 60.0], [32.0, 24.0]);
    let frame = |number: usize| {
        let rotation = DQuat::from_rotation_y(number as f64 * 0.1 - 0.5);
        let camera_from_world = Some(Pose {
            rotation,
            translation: DVec3::new(0.0, 0.0, 2.0),
        });
        Frame {
            name: format!("{number:03}.png"),
            width: WIDTH,
            height: HEIGHT,
            image: ImageSource::File {
                path: format!("/{number:03}.png").into(),
                orientation: Orientation(1),
            },
            depth: None,
            camera: Some(FrameCamera::given(camera, camera_from_world)),
        }
    };
    let masks = BTreeMap::from([
        (0, mask(MaskOrigin::Keyframe, false, 1.0)),
        (1, mask(MaskOrigin::Tracked, false, 0.9)),
        (2, mask(MaskOrigin::Tracked, true, 0.8)),
        (5, mask(MaskOrigin::Tracked, false, 0.2)),
    ]);
    Project {
        frames: Arc::new((0..12).map(frame).collect()),
        labels: tree(),
        masks,
        ..Project::default()
    }
}

fn mask(origin: MaskOrigin, stale: bool, confidence: f32) -> FrameMask {
    let mut mask = LabelMask::empty(WIDTH, HEIGHT);
    for y in 10..30_u32 {
        for x in 20..40_u32 {
            mask.ids[(y * WIDTH + x) as usize] = LabelId(2);
        }
    }
    let confidence = match origin {
        MaskOrigin::Keyframe => BTreeMap::new(),
        MaskOrigin::Tracked => BTreeMap::from([(LabelId(2), confidence)]),
    };
    FrameMask {
        runs: Arc::new(RunMask::encode(&mask)),
        origin,
        stale,
        confidence,
    }
}

fn cloud() -> LabelledCloud {
    let count = 400;
    let at = |i: usize| {
        Vec3::new(
            (i % 20) as f32 * 0.05 - 0.5,
            (i / 20) as f32 * 0.05 - 0.5,
            0.0,
        )
    };
    LabelledCloud {
        positions: (0..count).map(at).collect(),
        normals: vec![Vec3::NEG_Z; count],
        colors: vec![[120, 160, 90]; count],
        labels: (0..count).map(|i| LabelId((i % 4) as u16)).collect(),
        confidence: vec![0.9; count],
        tree: tree(),
        ..LabelledCloud::default()
    }
}
