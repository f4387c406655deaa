use std::collections::{BTreeSet, VecDeque};
use std::sync::{Arc, Weak};

use egui::{Pos2, Response, Ui};
use glam::{Vec2, Vec3};

use super::inspector::label_ui;
use crate::pointer::HoverDwell;
use crate::session_view::labels_of;
use crate::{SessionView, ViewState};
use ostra_cloud::LabelledCloud;
use ostra_masks::LabelId;
use ostra_view::{Appearance, Clip, PickRequest, Picking, ViewCamera};

/// Camera of the view, and the settings that decide which points are drawn and picked.
pub(super) struct VisibleScene {
    pub camera: ViewCamera,
    pub appearance: Appearance,
    pub clip: Clip,
}

impl VisibleScene {
    /// Returns the request for a point within `radius_px` of a pixel of the view.
    pub fn pick_near(&self, at_px: Vec2, radius_px: f32) -> PickRequest {
        PickRequest {
            camera: self.camera,
            appearance: self.appearance.clone(),
            clip: self.clip,
            at_px,
            radius_px,
        }
    }
}

/// Returns the pixel of the view at a screen position.
pub(super) fn view_px(ui: &Ui, response: &Response, at: Pos2) -> Vec2 {
    let at = (at - response.rect.min) * ui.pixels_per_point();
    Vec2::new(at.x, at.y)
}

/// Purpose of a pick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Purpose {
    /// Shows the label and votes of the point.
    Ask,
    /// Isolates the point's label.
    Isolate,
    /// Adds a point to the ruler.
    Measure,
    /// Centres the view on the point.
    Recentre,
    /// Zooms to the point at this screen position.
    Zoom(Pos2),
}

/// Result of a pick.
pub(super) struct Picked {
    pub purpose: Purpose,
    pub cloud: Arc<LabelledCloud>,
    /// `None` if there is no point.
    pub point: Option<usize>,
}

impl Picked {
    /// Returns the position of the point, in world units.
    pub fn place(&self) -> Option<Vec3> {
        self.point.map(|point| self.cloud.positions[point])
    }
}

/// Pick in progress.
struct ActivePick {
    purpose: Purpose,
    cloud: Arc<LabelledCloud>,
    picking: Picking,
}

/// Picks that run in the background, so that the window does not wait for them.
///
/// Picks of clicks finish in order. For the wheel, one pick runs at a time.
#[derive(Default)]
pub(super) struct ScenePicks {
    clicks: VecDeque<ActivePick>,
    wheel: Option<ActivePick>,
}

impl ScenePicks {
    /// Starts picking a point of the view.
    ///
    /// A wheel pick is ignored while another one runs.
    pub fn begin(
        &mut self,
        ui: &Ui,
        purpose: Purpose,
        cloud: &Arc<LabelledCloud>,
        request: PickRequest,
    ) {
        let is_wheel = matches!(purpose, Purpose::Zoom(_));
        if is_wheel && self.wheel.is_some() {
            return;
        }
        let waker = ui.ctx().clone();
        let picking = Picking::begin(Arc::clone(cloud), request, move || {
            waker.request_repaint();
        });
        let pick = ActivePick {
            purpose,
            cloud: Arc::clone(cloud),
            picking,
        };
        if is_wheel {
            self.wheel = Some(pick);
        } else {
            self.clicks.push_back(pick);
        }
    }

    /// Returns the next finished pick; a click waits for earlier ones.
    pub fn next(&mut self) -> Option<Picked> {
        let known = |pick: &ActivePick| pick.picking.next();
        let wheel = self
            .wheel
            .as_ref()
            .and_then(known)
            .and_then(|point| Some((self.wheel.take()?, point)));
        let click = || {
            let point = self.clicks.front().and_then(known)?;
            Some((self.clicks.pop_front()?, point))
        };
        let (ActivePick { purpose, cloud, .. }, point) = wheel.or_else(click)?;
        Some(Picked {
            purpose,
            cloud,
            point,
        })
    }
}

/// Maximum distance of a point from the pointer, in screen points.
const NEAR: f32 = 6.0;

/// Label of the point under the resting pointer, shown as a tooltip.
#[derive(Default)]
pub(super) struct SceneHover {
    rest: Option<HoverDwell>,
    looking: Option<(PickQuery, Picking)>,
    found: Option<(PickQuery, Option<usize>)>,
}

/// Pixel of a view, and everything that decides which point is visible there.
struct PickQuery {
    at: Pos2,
    camera: ViewCamera,
    clip: Clip,
    hidden: BTreeSet<LabelId>,
    isolated: Option<LabelId>,
    uncertain_below: Option<f32>,
    least_views: u32,
    cloud: Weak<LabelledCloud>,
}

impl PickQuery {
    fn is(&self, other: &Self) -> bool {
        (self.at, self.camera, self.clip) == (other.at, other.camera, other.clip)
            && (
                &self.hidden,
                self.isolated,
                self.uncertain_below,
                self.least_views,
            ) == (
                &other.hidden,
                other.isolated,
                other.uncertain_below,
                other.least_views,
            )
            && self.cloud.ptr_eq(&other.cloud)
    }
}

impl SceneHover {
    /// Follows the pointer over the view and shows the label of the point under it.
    pub fn ui(
        &mut self,
        ui: &Ui,
        response: &Response,
        session: &SessionView<'_>,
        view: &ViewState,
        seen: &VisibleScene,
    ) {
        let (Some(at), Some(cloud)) = (
            response.hover_pos(),
            session.cloud.filter(|_| may_inspect(ui, session, view)),
        ) else {
            *self = Self::default();
            return;
        };
        self.take_found();
        let Some(at) = HoverDwell::follow(&mut self.rest, ui, at) else {
            return;
        };
        let place = PickQuery {
            at,
            camera: seen.camera,
            clip: seen.clip,
            hidden: seen.appearance.hidden.clone(),
            isolated: seen.appearance.isolated,
            uncertain_below: seen.appearance.uncertain_below,
            least_views: seen.appearance.least_views,
            cloud: Arc::downgrade(cloud),
        };
        match &self.found {
            Some((of, point)) if of.is(&place) => point
                .iter()
                .for_each(|&point| tell(response, session, cloud, point)),
            _ if self.looking.is_none() => {
                let at_px = view_px(ui, response, at);
                let request = seen.pick_near(at_px, NEAR * ui.pixels_per_point());
                let waker = ui.ctx().clone();
                let picking = Picking::begin(Arc::clone(cloud), request, move || {
                    waker.request_repaint();
                });
                self.looking = Some((place, picking));
            }
            _ => {}
        }
    }

    fn take_found(&mut self) {
        let found = self
            .looking
            .as_ref()
            .and_then(|(_, picking)| picking.next());
        if let (Some(point), Some((place, _))) = (found, self.looking.take_if(|_| found.is_some()))
        {
            self.found = Some((place, point));
        }
    }
}

/// Returns `true` if a tooltip is useful.
///
/// This requires that nothing is pressed, no tool is active, the view and points are not changing
/// and the labelled cloud is shown.
fn may_inspect(ui: &Ui, session: &SessionView<'_>, view: &ViewState) -> bool {
    let in_hand = view.scene_select.in_hand
        || view.ruler.in_hand
        || ui.input(|input| input.pointer.any_down());
    let is_still = !view.scene.turning && view.dialog.is_none();
    session.preview_cloud.is_none() && session.proposed.is_none() && is_still && !in_hand
}

fn tell(response: &Response, session: &SessionView<'_>, cloud: &LabelledCloud, point: usize) {
    response.clone().on_hover_ui_at_pointer(|ui| {
        label_ui(ui, labels_of(session), cloud.labels[point]);
        // A PLY file on its own need not come from a vote.
        if session.root.is_none() {
            return;
        }
        let share = format!("{:.0} % of the votes", 100.0 * cloud.confidence[point]);
        ui.weak(if session.votes.is_some() {
            format!("{share}; click to see the votes")
        } else {
            share
        });
    });
}
