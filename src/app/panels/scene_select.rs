use egui::{PointerButton, Pos2, Rect, Response, Ui};
use glam::DVec2;

use crate::trail::trail;
use crate::{Look, ViewState};
use ostra_cloud::select::{Likeness, SeenRegion, SelectStep};
use ostra_masks::LabelId;
use ostra_session::{CloudChange, CloudCorrection, Command};
use ostra_view::{Clip, ViewCamera};

/// What the pointer draws to choose points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SelectShape {
    /// A closed line.
    #[default]
    Lasso,
    /// A box from corner to corner.
    Box,
    /// A stroke.
    Brush,
}

/// Points of the cloud that are being chosen in the 3-D view, and what shall become of them.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneSelect {
    /// Whether drags in the 3-D view choose points.
    pub in_hand: bool,
    /// What a drag draws.
    pub shape: SelectShape,
    /// Radius of the brush in points of the screen.
    pub brush: f32,
    /// What points must have in common with the chosen ones to be added to them.
    pub likeness: Likeness,
    /// The piece that would be kept, counted from 1.
    pub piece: usize,
    /// Frames that a correction changes become anchors.
    pub as_anchors: bool,
    /// How the points are chosen.
    pub steps: Vec<SelectStep>,
    /// What is being drawn, on the screen.
    pub(super) drawn: Vec<Pos2>,
}

impl Default for SceneSelect {
    fn default() -> Self {
        Self {
            in_hand: false,
            shape: SelectShape::Lasso,
            brush: 14.0,
            likeness: Likeness::default(),
            piece: 1,
            as_anchors: false,
            steps: Vec::new(),
            drawn: Vec::new(),
        }
    }
}

impl SceneSelect {
    /// Takes back the latest of: what is being drawn, what is chosen, the tool. Says whether there was any.
    pub fn cancel(&mut self) -> bool {
        let was_any = self.in_hand || !self.steps.is_empty();
        if !self.drawn.is_empty() {
            self.drawn.clear();
        } else if !self.steps.is_empty() {
            self.steps.clear();
        } else {
            self.in_hand = false;
        }
        was_any
    }

    /// The wish to change the chosen points, which are chosen no more; `None` without any.
    pub fn correct(&mut self, change: CloudChange) -> Option<Command> {
        let select = std::mem::take(&mut self.steps);
        let correction = CloudCorrection {
            select,
            change,
            as_anchors: self.as_anchors,
        };
        (!correction.select.is_empty()).then_some(Command::CorrectCloud(correction))
    }

    /// The corners of what is drawn, or the points of its stroke.
    pub(super) fn outline(&self) -> Vec<Pos2> {
        match (self.shape, self.drawn.first(), self.drawn.last()) {
            (SelectShape::Box, Some(&from), Some(&to)) => {
                let [a, b] = [Pos2::new(to.x, from.y), Pos2::new(from.x, to.y)];
                vec![from, a, to, b]
            }
            _ => self.drawn.clone(),
        }
    }
}

/// Who moves the pointer no farther than this, in points of the screen, clicks and draws nothing.
const CLICK: f32 = 6.0;

/// Draws with the primary button; letting go chooses: with Shift what is seen there too, with Ctrl or Alt no longer, else
/// only that.
pub(super) fn choose_by_hand(
    ui: &Ui,
    response: &Response,
    view: &mut ViewState,
    camera: &ViewCamera,
    clip: &Clip,
) {
    if !follow(ui, response, &mut view.scene_select.drawn) {
        return;
    }
    let (scale, modifiers) = (ui.pixels_per_point(), ui.input(|input| input.modifiers));
    let remove = modifiers.alt || modifiers.command || modifiers.ctrl;
    let region = region(view, response.rect, scale, (camera, clip), remove);
    let select = &mut view.scene_select;
    if !remove && !modifiers.shift {
        select.steps.clear();
    }
    select.steps.push(SelectStep::Seen(region));
    select.drawn.clear();
    select.piece = 1;
}

/// Adds to a line where the pointer went with the primary button down; whether the line has come to its end. By hand, as a
/// response tells of a drag only in the frame after the button went down.
fn follow(ui: &Ui, response: &Response, drawn: &mut Vec<Pos2>) -> bool {
    let (down, pressed) = ui.input(|input| {
        (
            input.pointer.primary_down(),
            input.pointer.primary_pressed(),
        )
    });
    let held = down && response.is_pointer_button_down_on();
    let mut places = trail(ui, &[PointerButton::Primary]).into_iter();
    if held && pressed {
        *drawn = places.next().into_iter().collect();
    }
    for at in places {
        if drawn.last().is_some_and(|last| last.distance(at) > 1.0) {
            drawn.push(at);
        }
    }
    let is_click = drawn.iter().all(|at| at.distance(drawn[0]) <= CLICK);
    if !held && is_click {
        drawn.clear();
    }
    !held && !is_click
}

fn region(
    view: &ViewState,
    rect: Rect,
    scale: f32,
    (camera, clip): (&ViewCamera, &Clip),
    remove: bool,
) -> SeenRegion {
    let select = &view.scene_select;
    let in_picture = |at: Pos2| {
        let at = (at - rect.min) * scale;
        DVec2::new(f64::from(at.x), f64::from(at.y))
    };
    let radius_px = if select.shape == SelectShape::Brush {
        f64::from(select.brush * scale)
    } else {
        0.0
    };
    let hidden: Vec<LabelId> = view.hidden.iter().copied().collect();
    let points_px = select.outline().into_iter().map(in_picture).collect();
    let scene = &view.scene;
    let (isolated, doubtful_below, cube_from_world) =
        (scene.isolated, scene.doubtful_below, clip.cube_from_world());
    SeenRegion {
        eye: camera.eye(),
        points_px,
        radius_px,
        remove,
        hidden,
        isolated,
        doubtful_below,
        cube_from_world,
    }
}

/// Whether points are chosen, so that they can be corrected.
pub(crate) fn has_chosen(look: &Look<'_>, view: &ViewState) -> bool {
    let any = look
        .chosen
        .is_some_and(|chosen| chosen.is_ok_and(|chosen| !chosen.points.is_empty()));
    any && !view.scene_select.steps.is_empty()
}
