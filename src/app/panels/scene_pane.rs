use egui::{PointerButton, Rect, Response, Role, Sense, Ui, WidgetInfo};
use glam::{Vec2, Vec3};

use super::inspector::{InspectedPlace, inspector_ui};
use super::ruler::scale_bar_mark_ui;
use super::ruler_marks::ruler_marks;
use super::scene_bar::{scene_bar_ui, scene_context_ui};
use super::scene_content::{SceneCanvas, SceneViewport, image_planes, message, model, points_over};
use super::scene_framing::{Framed, InView, own_camera_note_ui};
use super::scene_overlay::{blend, marks};
use super::scene_picks::{Purpose, SceneHover, ScenePicks, VisibleScene, view_px};
use super::scene_select::{choose_by_hand, chosen_ui};
use super::scene_tools::InspectedPoint;
use crate::session_view::labels_of;
use crate::textures::Textures;
use crate::view_state::SceneAction;
use crate::{Action, SessionView, ViewState};
use ostra_frames::Frame;
use ostra_view::{
    Appearance, Axes, Clip, Orbit, PickRequest, RenderRequest, Scene3d, SceneStyle, ViewCamera,
    frustum_lines, link_lines, pick_frustum,
};

/// 3-D view: camera, rendered texture, picking and inspection.
pub struct ScenePane {
    canvas: Option<SceneCanvas>,
    orbit: Option<Orbit>,
    framed: Framed,
    in_view: InView,
    /// Pointer position of the last zoom, its target, and whether the target was picked.
    zoom_anchor: Option<(egui::Pos2, Vec3, bool)>,
    picks: ScenePicks,
    /// Camera of the view when it was set to look through a frame's camera.
    through: Option<Orbit>,
    hover: SceneHover,
    inspected_place: InspectedPlace,
}

/// Speed of the turntable in radians per second.
const TURNING: f32 = 0.5;

impl ScenePane {
    /// Creates a view that draws on the window's GPU; without one it shows a message.
    #[must_use]
    pub fn new(gpu: Option<&egui_wgpu::RenderState>) -> Self {
        Self {
            canvas: gpu.map(SceneCanvas::new),
            orbit: None,
            framed: Framed::default(),
            in_view: InView::default(),
            zoom_anchor: None,
            picks: ScenePicks::default(),
            through: None,
            hover: SceneHover::default(),
            inspected_place: InspectedPlace::default(),
        }
    }

    /// Resets the view for another project.
    pub fn clear(&mut self) {
        let mut canvas = self.canvas.take();
        canvas.iter_mut().for_each(SceneCanvas::clear);
        *self = Self {
            canvas,
            ..Self::new(None)
        };
    }

    /// Multiplies scene lengths by `factor`, so that the view stays the same.
    pub fn scale_by(&mut self, factor: f32) {
        self.orbit
            .iter_mut()
            .chain(&mut self.through)
            .for_each(|orbit| orbit.scale_by(factor));
        self.framed.scale_by(factor);
        // Pending picks refer to positions from before the change of scale.
        self.picks = ScenePicks::default();
        self.zoom_anchor = None;
    }

    /// Returns the camera of the view; `None` before there is something to show.
    #[must_use]
    pub fn orbit(&self) -> Option<Orbit> {
        self.orbit
    }

    /// Draws the tool row and the view; returns `true` if the pane is dragged away.
    pub(crate) fn ui(
        &mut self,
        ui: &mut Ui,
        session: &SessionView<'_>,
        view: &mut ViewState,
        textures: &mut Textures,
        actions: &mut Vec<Action>,
    ) -> bool {
        let is_dragged = scene_bar_ui(ui, session, view, actions);
        let (rect, response) = ui.allocate_exact_size(ui.available_size(), Sense::click_and_drag());
        response.widget_info(|| WidgetInfo::labeled(Role::Image, ui.is_enabled(), "3-D view"));
        ui.painter()
            .rect_filled(rect, 0.0, ui.visuals().extreme_bg_color);
        let size = rect.size() * ui.pixels_per_point();
        let through = view.scene.through;
        self.frame_new_content(session, view, size.x / size.y.max(1.0));
        let Some(orbit) = self.orbit else {
            message(ui, rect, "The 3-D view appears once there is depth");
            return is_dragged;
        };
        let camera = orbit.camera(size.x.max(1.0) as u32, size.y.max(1.0) as u32);
        self.take_picks(session, view);
        self.turn(ui, &response, view);
        self.input(ui, &response, session, view, &camera);
        // Moving the view ends looking through a camera.
        view.scene.through = view.scene.through.filter(|_| self.orbit == self.through);
        if view.scene.through != through {
            // The tool bar is already drawn and has to be updated.
            ui.ctx().request_repaint();
        }
        let seen = self.seen(session, view, camera);
        self.hover.ui(ui, &response, session, view, &seen);
        self.draw(ui, rect, session, view);
        let viewport = SceneViewport {
            rect,
            camera,
            depth: orbit.distance,
        };
        blend(ui, &viewport, session, view, textures);
        if let Some(request) = view.screenshot_request.take() {
            let portrait = model(session, view).map(|model| {
                let (style, rows) = (self.style(ui, session, view), camera.height);
                RenderRequest::new(model, orbit, style, rows)
            });
            view.portrait = portrait.map(|portrait| (request, portrait));
        }
        let unit = view.measures.unit.unwrap_or(session.unit);
        ruler_marks(ui, &viewport, &view.ruler, unit);
        scale_bar_mark_ui(ui, rect, session, view);
        inspector_ui(ui, &viewport, &mut self.inspected_place, session, view);
        chosen_ui(ui, &viewport, session, view, actions);
        scene_context_ui(ui, rect, session, view, actions);
        own_camera_note_ui(ui, rect, session);
        let depth = self.frustum_depth(view);
        self.in_view
            .ui(ui, &viewport, depth, session, view, actions);
        is_dragged
    }

    /// Frames the scene for new content or on request, and performs other one-time actions.
    fn frame_new_content(&mut self, session: &SessionView<'_>, view: &mut ViewState, aspect: f32) {
        let request = view.scene_action.take();
        let is_asked = request == Some(SceneAction::FrameAll);
        self.orbit = self.framed.follow(self.orbit, session, aspect, is_asked);
        if let (Some(SceneAction::FrameCameras), Some(orbit)) = (request, &mut self.orbit) {
            *orbit = self.framed.frame_cameras(session, *orbit, aspect);
        }
        let follows = view.scene.through.is_some_and(|frame| frame != view.frame);
        if request == Some(SceneAction::LookThrough) || follows {
            let put = self.look_through(session.project.frames.get(view.frame));
            view.scene.through = put.then_some(view.frame);
        }
        if let Some(orbit) = &mut self.orbit {
            orbit.orthographic = view.prefs.scene.orthographic;
            if let (Some(SceneAction::LookFrom(side)), Some(axes)) = (request, &self.framed.axes) {
                orbit.look_from(axes, side);
            }
        }
        if let (Some(SceneAction::ShowInspected), Some(orbit), Some(inspected_point)) =
            (request, &mut self.orbit, &view.inspected_point)
        {
            orbit.recentre(inspected_point.place());
        }
    }

    /// Rotates the view until the user interacts with it.
    fn turn(&mut self, ui: &Ui, response: &Response, view: &mut ViewState) {
        let touched = response.is_pointer_button_down_on()
            || (response.hovered() && ui.input(|i| i.smooth_scroll_delta() != egui::Vec2::ZERO));
        view.scene.turning &= !touched;
        if let (true, Some(orbit)) = (view.scene.turning, &mut self.orbit) {
            orbit.turn(TURNING * ui.input(|i| i.stable_dt).min(0.1));
            ui.ctx().request_repaint();
        }
    }

    /// Returns what is visible with a camera.
    fn seen(
        &self,
        session: &SessionView<'_>,
        view: &ViewState,
        camera: ViewCamera,
    ) -> VisibleScene {
        VisibleScene {
            camera,
            appearance: self.appearance(session, view),
            clip: self.clip(session, view),
        }
    }

    /// Returns the axes of the content that the view was framed for, or else of the cameras.
    fn axes(&self, session: &SessionView<'_>) -> Axes {
        self.framed
            .axes
            .unwrap_or_else(|| Axes::of_cameras(&session.project.frames))
    }

    fn appearance(&self, session: &SessionView<'_>, view: &ViewState) -> Appearance {
        Appearance {
            coloring: view.coloring,
            level: view.scene.level,
            hidden: view.hidden.clone(),
            isolated: view.scene.isolated,
            uncertain_below: view.scene.uncertain_below,
            least_views: if view.scene.least_views > 1 {
                view.scene.least_views
            } else {
                0
            },
            faint: view.prefs.scene.faint,
            tree: session.shown_tree(),
            votes: session.votes.cloned(),
            up: self.axes(session).up,
        }
    }

    fn clip(&self, session: &SessionView<'_>, view: &ViewState) -> Clip {
        self.framed.extent.map_or_else(Clip::default, |extent| {
            view.scene.clip.clip(&self.axes(session), &extent)
        })
    }

    /// Returns the rendering style for this screen's scale.
    fn style(&self, ui: &Ui, session: &SessionView<'_>, view: &ViewState) -> SceneStyle {
        let (fill, scene) = (ui.visuals().extreme_bg_color, &view.prefs.scene);
        SceneStyle {
            appearance: self.appearance(session, view),
            clip: self.clip(session, view),
            point_px: view.prefs.point_size * ui.pixels_per_point() * 0.5,
            background: scene.background.unwrap_or([fill.r(), fill.g(), fill.b()]),
            edl_strength: if scene.edl { scene.edl_strength } else { 0.0 },
        }
    }

    /// Sets the view to a frame's camera; returns `false` if its pose is unknown.
    fn look_through(&mut self, frame: Option<&Frame>) -> bool {
        let up = self.orbit.map_or(Vec3::NEG_Y, |orbit| orbit.up);
        let Some((camera, pose)) = frame.and_then(Frame::posed_camera) else {
            return false;
        };
        // The target is at the depth of the scene's centre, where the scale bar should be valid.
        let depth = pose.transform(self.framed.centre.as_dvec3()).z as f32;
        let depth = if depth > 0.1 * self.framed.radius {
            depth
        } else {
            self.framed.radius
        };
        self.orbit = Some(Orbit::through(camera, pose, depth, up));
        self.through = self.orbit;
        true
    }

    fn input(
        &mut self,
        ui: &Ui,
        response: &Response,
        session: &SessionView<'_>,
        view: &mut ViewState,
        camera: &ViewCamera,
    ) {
        let scale = ui.pixels_per_point();
        let delta = response.drag_delta() * scale;
        let delta = Vec2::new(delta.x, delta.y);
        let seen = self.seen(session, view, *camera);
        let Some(orbit) = &mut self.orbit else { return };
        let choosing = view.scene_select.in_hand;
        let turning = if choosing {
            PointerButton::Secondary
        } else {
            PointerButton::Primary
        };
        if response.dragged_by(turning) {
            orbit.orbit(delta);
        } else if response.dragged_by(PointerButton::Secondary)
            || response.dragged_by(PointerButton::Middle)
        {
            orbit.pan(delta, camera.height as f32);
        }
        if choosing {
            choose_by_hand(ui, response, view, &seen);
        } else if response.secondary_clicked() && view.ruler.in_hand {
            view.ruler.undo_click();
        } else if let Some(at) = response
            .interact_pointer_pos()
            .filter(|_| response.clicked())
        {
            let at_px = view_px(ui, response, at);
            let frame = pick_frustum(&session.project.frames, camera, at_px, 14.0 * scale);
            let (purpose, near_px) = if response.double_clicked() {
                (Purpose::Recentre, 12.0)
            } else if ui.input(|i| i.modifiers.alt) {
                (Purpose::Isolate, 10.0)
            } else if view.ruler.in_hand {
                (Purpose::Measure, 14.0)
            } else {
                (Purpose::Ask, 10.0)
            };
            match frame.filter(|_| view.prefs.frusta && purpose == Purpose::Ask) {
                Some(frame) => view.go_to(frame),
                None => {
                    let request = seen.pick_near(at_px, near_px * scale);
                    self.pick(ui, session, purpose, request);
                }
            }
        }
        self.zoom(ui, response, session, &seen);
    }

    /// Starts picking a point.
    ///
    /// Picks for inspection and isolation use the labelled cloud, all others the points shown.
    fn pick(&mut self, ui: &Ui, session: &SessionView<'_>, purpose: Purpose, request: PickRequest) {
        let labelled = session.cloud.filter(|_| session.preview_cloud.is_none());
        let cloud = if matches!(purpose, Purpose::Ask | Purpose::Isolate) {
            labelled
        } else {
            session.points()
        };
        if let Some(cloud) = cloud {
            self.picks.begin(ui, purpose, cloud, request);
        }
    }

    /// Performs the actions of finished picks.
    fn take_picks(&mut self, session: &SessionView<'_>, view: &mut ViewState) {
        while let Some(picked) = self.picks.next() {
            let (place, label) = (
                picked.place(),
                picked.point.map(|point| picked.cloud.labels[point]),
            );
            match (picked.purpose, &mut self.orbit) {
                (Purpose::Ask, _) => {
                    let votes = session
                        .votes
                        .filter(|votes| votes.len() == picked.cloud.len());
                    view.inspected_point = picked
                        .point
                        .map(|point| InspectedPoint::new(&picked.cloud, votes, point));
                }
                (Purpose::Isolate, _) => {
                    view.scene.isolate(
                        view.scene
                            .shown_as(labels_of(session), label.unwrap_or_default()),
                    );
                }
                (Purpose::Measure, _) if view.ruler.in_hand => {
                    place.into_iter().for_each(|at| view.ruler.click(at));
                }
                (Purpose::Recentre, Some(orbit)) => {
                    place.into_iter().for_each(|at| orbit.recentre(at));
                }
                (Purpose::Zoom(at), _) => {
                    let here = self.zoom_anchor.filter(|&(of, ..)| of == at);
                    self.zoom_anchor = here
                        .map(|(_, rough, _)| (at, place.unwrap_or(rough), true))
                        .or(self.zoom_anchor);
                }
                (Purpose::Measure | Purpose::Recentre, _) => {}
            }
        }
    }

    /// Zooms with the wheel towards the point under the pointer.
    ///
    /// It is picked once while the pointer rests. Until then, the target is at the distance of the
    /// view's centre.
    fn zoom(
        &mut self,
        ui: &Ui,
        response: &Response,
        session: &SessionView<'_>,
        seen: &VisibleScene,
    ) {
        let Some(at) = response.hover_pos() else {
            return;
        };
        let (scroll, pinch) = ui.input(|i| (i.smooth_scroll_delta(), i.zoom_delta()));
        let factor = (-(scroll.x + scroll.y) / 300.0).exp() / pinch;
        if (factor - 1.0).abs() < 1e-6 {
            return;
        }
        let Some(distance) = self.orbit.map(|orbit| orbit.distance) else {
            return;
        };
        let at_px = view_px(ui, response, at);
        let known = self.zoom_anchor.filter(|&(of, ..)| of == at);
        let (_, anchor, found) =
            known.unwrap_or_else(|| (at, seen.camera.unproject(at_px, distance), false));
        self.zoom_anchor = Some((at, anchor, found));
        if !found {
            self.pick(ui, session, Purpose::Zoom(at), seen.pick_near(at_px, 30.0));
        }
        if let Some(orbit) = &mut self.orbit {
            orbit.zoom(factor, anchor);
        }
    }

    /// Returns the depth that frustums are drawn with, in world units.
    fn frustum_depth(&self, view: &ViewState) -> f32 {
        self.framed.radius * view.prefs.scene.frustum
    }

    fn draw(&mut self, ui: &Ui, rect: Rect, session: &SessionView<'_>, view: &ViewState) {
        let style = self.style(ui, session, view);
        let frustum_depth = self.frustum_depth(view);
        let (Some(orbit), Some(canvas)) = (self.orbit, &mut self.canvas) else {
            return message(
                ui,
                rect,
                "The 3-D view needs a graphics adapter, and this computer offers none.",
            );
        };
        let scale = ui.pixels_per_point();
        let size = (rect.size() * scale).round().max(egui::Vec2::splat(1.0));
        let most = ui.input(|i| i.max_texture_side) as f32;
        let (mut lines, mut planes) = (Vec::new(), Vec::new());
        if view.prefs.frusta {
            lines = frustum_lines(&session.project.frames, frustum_depth, Some(view.frame));
            if view.prefs.scene.images {
                planes = image_planes(session, view, frustum_depth);
            }
        }
        if let Some(sparse) = session.sparse.filter(|_| view.prefs.links) {
            lines.extend(link_lines(&session.project.frames, &sparse.links));
        }
        lines.extend(view.ruler.lines(self.framed.radius * 0.012));
        let camera = orbit.camera(size.x.min(most) as u32, size.y.min(most) as u32);
        if !canvas.draw(
            ui,
            rect,
            model(session, view),
            &Scene3d {
                camera,
                style,
                lines,
                planes,
                over: points_over(session),
            },
        ) {
            ui.ctx().request_repaint();
        }
        let viewport = SceneViewport {
            rect,
            camera,
            depth: orbit.distance,
        };
        marks(ui, &viewport, view, session.unit, canvas.range());
    }
}

#[cfg(test)]
mod tests;
