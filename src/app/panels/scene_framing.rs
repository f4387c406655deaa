//! Where the 3-D view looks from for new content, and whether any of it is in view.

use std::sync::{Arc, Weak};

use egui::{Button, Rect, Ui, Vec2};
use glam::Vec3;

use super::scene_content::SceneViewport;
use crate::{Action, SessionView, ViewState};
use ostra_cloud::LabelledCloud;
use ostra_frames::Frame;
use ostra_view::{
    Axes, Bounds, LineVertex, Orbit, ViewCamera, default_view, frustum_lines, is_any_in_view,
};

/// Kind of content that a view is framed for.
///
/// The order is that in which content appears: the last kind that is there decides the first view,
/// whichever is loaded first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
enum Content {
    /// The shown frame's points in its own camera, before there are cameras.
    OwnCamera,
    #[default]
    Cameras,
    Sparse,
    ShownFrame,
    AllFrames,
    Cloud,
}

impl Content {
    fn of(session: &SessionView<'_>) -> Self {
        if session.cloud.is_some() || session.proposed.is_some() {
            return Self::Cloud;
        }
        if session.preview_cloud.is_some() {
            return Self::AllFrames;
        }
        match session.depth_points {
            Some(points) if !points.in_world => Self::OwnCamera,
            Some(points) if points.has_all => Self::AllFrames,
            Some(_) => Self::ShownFrame,
            None if session.sparse.is_some() => Self::Sparse,
            None => Self::Cameras,
        }
    }
}

/// Content that the view was last framed for.
#[derive(Default)]
pub(super) struct Framed {
    content: Content,
    cloud: Option<Weak<LabelledCloud>>,
    /// The view as it was framed, before the user moved it.
    orbit: Option<Orbit>,
    /// Aspect that it was framed for, and its distance in a pane as wide as high.
    aspect: f32,
    distance: f32,
    pub(super) centre: Vec3,
    pub(super) radius: f32,
    pub(super) axes: Option<Axes>,
    /// Extent of the points along the axes.
    pub(super) extent: Option<Bounds>,
}

impl Framed {
    /// Returns the view for the content of the session, given the view so far.
    ///
    /// It is framed again for the first content, for content of a better kind while the user has not
    /// moved it, and with `is_asked`. A view that the user has moved stays.
    pub(super) fn follow(
        &mut self,
        orbit: Option<Orbit>,
        session: &SessionView<'_>,
        aspect: f32,
        is_asked: bool,
    ) -> Option<Orbit> {
        let cloud = session.points().map(Arc::downgrade);
        let is_same = match (&self.cloud, &cloud) {
            (Some(old), Some(new)) => old.ptr_eq(new),
            (None, None) => true,
            _ => false,
        };
        let content = Content::of(session);
        let is_better = content > self.content;
        if !is_same || orbit.is_none() || is_asked {
            // The extent of depth maps hardly differs from one shown frame to the next.
            let is_of_depths = is_dense(session) && session.cloud.is_none();
            if is_better || is_asked || !is_of_depths || self.extent.is_none() {
                self.measure(session);
            }
            self.cloud = cloud;
        }
        let Some(before) = orbit else {
            return self.frame(session, content, aspect);
        };
        let is_untouched = self.is_untouched(&before) || self.content == Content::OwnCamera;
        if is_asked || (is_better && is_untouched && self.is_worth_moving(session, content)) {
            return self.frame(session, content, aspect).or(orbit);
        }
        self.content = self.content.max(content);
        Some(self.fit_pane(before, aspect))
    }

    /// Returns a view in the same direction that shows the cameras besides the points.
    pub(super) fn frame_cameras(
        &self,
        session: &SessionView<'_>,
        orbit: Orbit,
        aspect: f32,
    ) -> Orbit {
        let points = bounds(session).map(|bounds| [bounds.min, bounds.max]);
        let places = points.into_iter().flatten().chain(centres(session));
        let Some(bounds) = Bounds::of(places) else {
            return orbit;
        };
        let direction = orbit.rotation.conjugate() * Vec3::Z;
        let framed = Orbit::framing(&bounds, direction, orbit.up);
        Orbit {
            distance: framed.distance / narrow(aspect),
            orthographic: orbit.orthographic,
            ..framed
        }
    }

    /// Returns whether content is shown that a view of the content so far may miss.
    ///
    /// A preview grows around the cameras and sparse points, and a cloud is where the depths were.
    fn is_worth_moving(&self, session: &SessionView<'_>, content: Content) -> bool {
        match self.content {
            Content::AllFrames => false,
            Content::Sparse | Content::ShownFrame => {
                content == Content::Cloud || session.preview_cloud.is_none()
            }
            Content::OwnCamera | Content::Cameras | Content::Cloud => true,
        }
    }

    fn frame(&mut self, session: &SessionView<'_>, content: Content, aspect: f32) -> Option<Orbit> {
        let framed = framing(session)?;
        self.content = content;
        (self.aspect, self.distance) = (narrow(aspect), framed.distance);
        self.orbit = Some(Orbit {
            distance: framed.distance / self.aspect,
            ..framed
        });
        self.orbit
    }

    /// Moves a view that the user has not moved so that everything fits a pane of another shape.
    fn fit_pane(&mut self, orbit: Orbit, aspect: f32) -> Orbit {
        let now = narrow(aspect);
        if now == self.aspect || !self.is_untouched(&orbit) {
            return orbit;
        }
        let fitted = Orbit {
            distance: self.distance / now,
            ..orbit
        };
        (self.orbit, self.aspect) = (Some(fitted), now);
        fitted
    }

    fn is_untouched(&self, orbit: &Orbit) -> bool {
        self.orbit.is_some_and(|framed| {
            let orthographic = orbit.orthographic;
            let framed = Orbit {
                orthographic,
                ..framed
            };
            framed == *orbit
        })
    }

    /// Multiplies lengths by `factor`.
    pub(super) fn scale_by(&mut self, factor: f32) {
        self.orbit
            .iter_mut()
            .for_each(|orbit| orbit.scale_by(factor));
        self.distance *= factor;
        self.centre *= factor;
        self.radius *= factor;
        if let Some(extent) = &mut self.extent {
            *extent = Bounds {
                min: extent.min * factor,
                max: extent.max * factor,
            };
        }
    }

    fn measure(&mut self, session: &SessionView<'_>) {
        let bounds = bounds(session);
        self.centre = bounds.as_ref().map_or(Vec3::ZERO, Bounds::centre);
        self.radius = bounds.map_or(1.0, |bounds| bounds.radius());
        let axes = Axes::of_cameras(&session.project.frames);
        self.axes = Some(axes);
        self.extent = session
            .points()
            .and_then(|cloud| axes.bounds(every_nth(cloud).map(|n| cloud.positions[n])));
    }
}

/// Returns the part of an aspect (width / height) by which a narrow pane shows less.
fn narrow(aspect: f32) -> f32 {
    aspect.clamp(0.2, 1.0)
}

fn centres<'a>(session: &'a SessionView<'_>) -> impl Iterator<Item = Vec3> + 'a {
    let posed = session
        .project
        .frames
        .iter()
        .filter_map(Frame::posed_camera);
    posed.map(|(_, pose)| pose.centre().as_vec3())
}

/// Returns whether the positions are those of surfaces, and not of sparse points or a preview.
fn is_dense(session: &SessionView<'_>) -> bool {
    session.cloud.is_some() || (session.preview_cloud.is_none() && session.depth_points.is_some())
}

fn bounds(session: &SessionView<'_>) -> Option<Bounds> {
    match session.points() {
        Some(cloud) if !is_dense(session) => Bounds::of(near_the_cameras(session, cloud)),
        Some(cloud) => Bounds::of(every_nth(cloud).map(|index| cloud.positions[index])),
        None => Bounds::of(centres(session)),
    }
}

/// Returns the camera centres and the half of the sparse points nearest to their mean.
///
/// Some sparse points are always far away and would make the bounds too large.
fn near_the_cameras<'a>(
    session: &'a SessionView<'_>,
    cloud: &'a LabelledCloud,
) -> impl Iterator<Item = Vec3> + 'a {
    let middle = centres(session).sum::<Vec3>() / centres(session).count().max(1) as f32;
    let mut points: Vec<Vec3> = every_nth(cloud)
        .map(|index| cloud.positions[index])
        .collect();
    points.sort_by(|a, b| {
        a.distance_squared(middle)
            .total_cmp(&b.distance_squared(middle))
    });
    points.truncate(points.len() / 2 + 1);
    points.into_iter().chain(centres(session))
}

/// Returns a view of everything for a pane that is as wide as high.
fn framing(session: &SessionView<'_>) -> Option<Orbit> {
    match session.points() {
        Some(cloud) if is_dense(session) => {
            default_view(&thinned(cloud), &session.project.frames, 1.0)
        }
        _ => cameras_view(session),
    }
}

/// Returns a view of all cameras from behind, slightly from above and from the side, upright.
fn cameras_view(session: &SessionView<'_>) -> Option<Orbit> {
    let poses = session
        .project
        .frames
        .iter()
        .filter_map(Frame::posed_camera);
    let rotations = poses.map(|(_, pose)| pose.rotation.as_quat().conjugate());
    let forward = rotations
        .map(|world_from_camera| world_from_camera * Vec3::Z)
        .sum::<Vec3>();
    let Axes { up, .. } = Axes::of_cameras(&session.project.frames);
    let forward = forward.try_normalize().unwrap_or(Vec3::Z);
    Some(Orbit::framing(
        &bounds(session)?,
        forward + 0.5 * forward.cross(up) - 0.4 * up,
        up,
    ))
}

/// Returns evenly spaced point indices, enough to estimate the extent of the cloud.
fn every_nth(cloud: &LabelledCloud) -> impl Iterator<Item = usize> {
    (0..cloud.len()).step_by((cloud.len() / 100_000).max(1))
}

fn thinned(cloud: &LabelledCloud) -> LabelledCloud {
    LabelledCloud {
        positions: every_nth(cloud)
            .map(|index| cloud.positions[index])
            .collect(),
        labels: every_nth(cloud).map(|index| cloud.labels[index]).collect(),
        ..LabelledCloud::default()
    }
}

/// Whether anything is in view, remembered while the view rests.
#[derive(Default)]
pub(super) struct InView {
    last: Option<(ViewCamera, f32, Option<Weak<LabelledCloud>>)>,
    /// What the last camera misses, once it is known.
    missed: Option<Missed>,
}

/// Content that is not in view.
#[derive(Debug, Clone, Copy, Default)]
struct Missed {
    /// Whether there are points, but none in view.
    points: bool,
    /// Whether there are cameras, but no edge of their frustums is in view.
    cameras: bool,
}

impl Missed {
    /// Looks for points and for frustums that are `depth` deep.
    fn of(session: &SessionView<'_>, camera: &ViewCamera, depth: f32) -> Self {
        const STEPS: u8 = 8;
        let misses = |places: &[Vec3]| !places.is_empty() && !is_any_in_view(places, camera);
        let ends = frustum_lines(&session.project.frames, depth, None);
        let along = |[from, to]: &[LineVertex; 2]| {
            let (from, to) = (Vec3::from(from.position), Vec3::from(to.position));
            (0..=STEPS).map(move |step| from.lerp(to, f32::from(step) / f32::from(STEPS)))
        };
        let edges: Vec<Vec3> = ends.as_chunks().0.iter().flat_map(along).collect();
        Self {
            points: session
                .points()
                .is_some_and(|points| misses(&points.positions)),
            cameras: misses(&edges),
        }
    }
}

impl InView {
    /// Returns what is not in view.
    ///
    /// All points may have to be tried, so this is found out when the view rests.
    fn missed(
        &mut self,
        ui: &Ui,
        session: &SessionView<'_>,
        camera: ViewCamera,
        frustum_depth: f32,
    ) -> Missed {
        let cloud = session.points().map(Arc::downgrade);
        let is_same = self.last.as_ref().is_some_and(|(seen_by, depth, of)| {
            let is_same_cloud = match (of, &cloud) {
                (Some(of), Some(cloud)) => of.ptr_eq(cloud),
                (of, cloud) => of.is_none() && cloud.is_none(),
            };
            *seen_by == camera && *depth == frustum_depth && is_same_cloud
        });
        if !is_same {
            self.last = Some((camera, frustum_depth, cloud));
            self.missed = None;
            ui.ctx().request_repaint();
            return Missed::default();
        }
        *self
            .missed
            .get_or_insert_with(|| Missed::of(session, &camera, frustum_depth))
    }

    /// Draws a button that brings everything into view where nothing is, or the cameras.
    ///
    /// `frustum_depth` is the depth that frustums are drawn with, in world units.
    pub(super) fn ui(
        &mut self,
        ui: &mut Ui,
        viewport: &SceneViewport,
        frustum_depth: f32,
        session: &SessionView<'_>,
        view: &ViewState,
        actions: &mut Vec<Action>,
    ) {
        let has_points = session.points().is_some_and(|points| !points.is_empty());
        let has_frusta = view.prefs.frusta;
        if !has_points && !has_frusta {
            return;
        }
        let missed = self.missed(ui, session, viewport.camera, frustum_depth);
        // Clicks of the ruler and drags that select points are not to end on the button.
        let is_free = !view.ruler.in_hand && !view.scene_select.in_hand;
        let (action, what) = if missed.points {
            (Action::FrameCloud, "Show whole cloud")
        } else if !has_points && missed.cameras {
            (Action::FrameCloud, "Show everything")
        } else if has_frusta && is_free && missed.cameras {
            (Action::FrameCameras, "Show cameras")
        } else {
            return;
        };
        let keys = view.prefs.shortcuts.text(ui.ctx(), action);
        let (text, place) = if action == Action::FrameCameras {
            // Above the axes, where it hardly covers the cloud.
            let centre = viewport.rect.right_bottom() + Vec2::new(-62.0, -102.0);
            let place = Rect::from_center_size(centre, Vec2::new(108.0, 20.0));
            (what.to_owned(), place)
        } else {
            let text = if keys.is_empty() {
                what.to_owned()
            } else {
                format!("{what} ({keys})")
            };
            (
                text,
                Rect::from_center_size(viewport.rect.center(), Vec2::new(200.0, 32.0)),
            )
        };
        let outline = ui.visuals().widgets.noninteractive.fg_stroke;
        let button = ui.put(place, Button::new(text).stroke(outline));
        let tip = view.prefs.shortcuts.tip(ui.ctx(), action);
        if button.on_hover_text(tip).clicked() {
            actions.push(action);
        }
    }
}

/// Says over the view that the points are in no common space yet.
pub(super) fn own_camera_note_ui(ui: &mut Ui, rect: Rect, session: &SessionView<'_>) {
    let is_alone = session
        .depth_points
        .is_some_and(|points| !points.in_world && Content::of(session) == Content::OwnCamera);
    if is_alone {
        let place = Rect::from_center_size(
            rect.center_top() + Vec2::new(0.0, 20.0),
            Vec2::new(rect.width() - 16.0, 20.0),
        );
        ui.put(
            place,
            egui::Label::new("No cameras yet: these are the points of the shown frame alone"),
        );
    }
}
