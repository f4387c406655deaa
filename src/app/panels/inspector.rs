use egui::{Align2, Color32, Id, Pos2, Rangef, Rect, Sense, Stroke, Ui, Vec2, Window, WindowDrag};
use glam::Vec3;

use super::ruler::{position_unit, scale_unknown_ui};
use super::scene_content::SceneViewport;
use super::scene_tools::{InspectedPoint, middle};
use crate::{Panes, SessionView, ViewState};
use ostra_masks::{LabelId, LabelTree};

const COLOR: Color32 = Color32::from_rgb(255, 235, 90);
/// Length of the cross's arms and of the gap around the point, in screen points.
const ARM: f32 = 14.0;
const GAP: f32 = 4.0;
/// Width of the inspector window, in screen points.
const WIDTH: f32 = 180.0;

/// Draws a cross around the inspected point and returns its centre on the screen.
///
/// The cross has the same size at any distance and is visible on light and dark backgrounds.
fn mark(ui: &Ui, viewport: &SceneViewport, inspected_point: &InspectedPoint) -> Option<Pos2> {
    let SceneViewport { rect, camera, .. } = viewport;
    let (at, _) = camera.project(inspected_point.place())?;
    let at = rect.min + Vec2::new(at.x, at.y) / ui.pixels_per_point();
    let painter = ui.painter().with_clip_rect(*rect);
    for stroke in [Stroke::new(5.0, Color32::BLACK), Stroke::new(2.0, COLOR)] {
        for arm in [Vec2::X, Vec2::Y, -Vec2::X, -Vec2::Y] {
            painter.line_segment([at + GAP * arm, at + (GAP + ARM) * arm], stroke);
        }
    }
    Some(at)
}

/// Draws a cross at the inspected point.
///
/// While the side panel is hidden, the point inspector is a window in a corner away from it.
pub(super) fn inspector_ui(
    ui: &Ui,
    viewport: &SceneViewport,
    place: &mut InspectedPlace,
    session: &SessionView<'_>,
    view: &mut ViewState,
) {
    view.inspected_point = view
        .inspected_point
        .take()
        .zip(session.cloud)
        .and_then(|(inspected_point, cloud)| inspected_point.on(cloud, session.votes));
    let Some(inspected_point) = view.inspected_point.clone() else {
        place.forget();
        return;
    };
    let at = mark(ui, viewport, &inspected_point);
    if view.steps.is_docked {
        place.forget();
        return;
    }
    let mut open = true;
    // A small window leaves most of the cloud visible.
    let window = egui::Window::new(egui::RichText::new("Point").strong())
        .default_width(WIDTH)
        .resizable(false);
    let window = window
        .frame(egui::Frame::window(ui.style()).inner_margin(8))
        .open(&mut open);
    place
        .put(window, ui, viewport.rect, inspected_point.place(), at)
        .constrain_to(viewport.rect)
        .show(ui.ctx(), |ui| point_ui(ui, session, view, &inspected_point));
    if !open {
        view.inspected_point = None;
    }
}

/// Draws what is known about a point: its label, its votes, and links to the frames that show it.
pub(crate) fn point_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    inspected_point: &InspectedPoint,
) {
    let mut to = None;
    let tree = if session.root.is_some() {
        &session.project.labels
    } else {
        &inspected_point.cloud.tree
    };
    label_ui(
        ui,
        tree,
        inspected_point.cloud.labels[inspected_point.point],
    );
    let at = inspected_point.place().as_dvec3() + inspected_point.cloud.origin;
    ui.weak(format!("at {:.4}, {:.4}, {:.4}", at.x, at.y, at.z))
        .on_hover_text(position_unit(session));
    scale_unknown_ui(ui, session, view);
    // A PLY file on its own need not come from a vote.
    if session.root.is_some() {
        let confidence = inspected_point.cloud.confidence[inspected_point.point];
        ui.label(format!("{:.0} % of the votes", 100.0 * confidence));
    }
    if inspected_point.votes.is_empty() && session.root.is_some() {
        ui.weak("No frame with a mask shows this point.");
    }
    for &(label, votes) in &inspected_point.votes {
        ui.horizontal(|ui| {
            ui.monospace(format!("{votes:>4}"));
            label_ui(ui, tree, label);
        });
    }
    if !inspected_point.voters.is_empty() {
        ui.separator();
        egui::ScrollArea::vertical()
            .max_height(100.0)
            .auto_shrink([false, true])
            .show(ui, |ui| {
                for voter in &inspected_point.voters {
                    ui.horizontal(|ui| {
                        let text = format!("frame {}", voter.frame);
                        let row = ui.selectable_label(view.frame == voter.frame, text);
                        if row.on_hover_text("Show the point in this frame").clicked() {
                            to = Some((voter.frame, middle(voter.x, voter.y)));
                        }
                        match voter.label {
                            Some(label) => label_ui(ui, tree, label),
                            None => drop(ui.weak("no mask")),
                        }
                    });
                }
            });
    }
    if let Some((frame, at_px)) = to {
        view.go_to(frame);
        view.zoom.centre_px = at_px;
        if view.prefs.panes == Panes::Scene {
            view.prefs.panes = Panes::Both;
        }
    }
}

/// Shows the path of a label next to its colour.
pub(super) fn label_ui(ui: &mut Ui, tree: &LabelTree, label: LabelId) {
    let Some(known) = tree.get(label) else {
        ui.weak(if label == LabelId::NONE {
            "unlabelled".to_owned()
        } else {
            format!("label {}", label.0)
        });
        return;
    };
    let names: Vec<&str> = tree
        .path(label)
        .iter()
        .filter_map(|&id| Some(tree.get(id)?.name.as_str()))
        .collect();
    let [r, g, b] = known.color;
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        let (patch, _) = ui.allocate_exact_size(Vec2::splat(10.0), Sense::hover());
        ui.painter()
            .rect_filled(patch, 2.0, Color32::from_rgb(r, g, b));
        ui.label(names.join(" › "));
    });
}

/// Position of the point inspector's window.
///
/// It stays where it is unless it would cover a newly inspected point.
#[derive(Debug, PartialEq, Default)]
pub(super) struct InspectedPlace {
    is_right: bool,
    is_low: bool,
    /// Point that the window was placed for.
    of: Option<Vec3>,
    /// Horizontal extent of the 3-D view when the window was placed.
    within: Option<Rangef>,
}

/// Distance kept free around a point, in screen points.
const FREE: f32 = 40.0;
/// Approximate width of the window before it was first drawn, in screen points.
const FIRST_WIDTH: f32 = 200.0;
/// Distance from the border of the view, in screen points.
const MARGIN: f32 = 10.0;

impl InspectedPlace {
    /// Resets the position once no point is inspected.
    pub(super) fn forget(&mut self) {
        self.of = None;
    }

    /// Places the window in the view `rect` for a point and its screen position, if it is visible.
    pub(super) fn put<'a>(
        &mut self,
        window: Window<'a>,
        ui: &Ui,
        rect: Rect,
        point: Vec3,
        at: Option<Pos2>,
    ) -> Window<'a> {
        let id = Id::unique("point asked about");
        let now = ui.ctx().memory(|memory| memory.area_rect(id));
        let is_moved = self.turn_away(rect, now, point, at);
        let (pivot, corner) = self.corner(rect);
        // egui ignores new positions of a window that is dragged by its title.
        let window = window.id(id).pivot(pivot).drag_area(WindowDrag::Anywhere);
        // For the same point the window stays where the user dragged it.
        if is_moved {
            window.current_pos(corner)
        } else {
            window.default_pos(corner)
        }
    }

    /// Chooses a corner away from a new point or in a changed view; returns `true` if it chose one.
    pub(super) fn turn_away(
        &mut self,
        rect: Rect,
        now: Option<Rect>,
        point: Vec3,
        at: Option<Pos2>,
    ) -> bool {
        let is_new = self.of.replace(point) != Some(point);
        // If other panes open or close, the old corner may be in the middle of the view.
        let is_elsewhere = self.within.replace(rect.x_range()) != Some(rect.x_range());
        let Some(at) = at.filter(|_| is_new || is_elsewhere) else {
            return false;
        };
        if !is_elsewhere && now.is_some_and(|now| !now.expand(FREE).contains(at)) {
            return false;
        }
        let middle = rect.center();
        self.is_right = at.x < middle.x;
        // In a narrow view both upper corners reach the middle.
        let width = now.map_or(FIRST_WIDTH, |now| now.width()) + FREE;
        self.is_low =
            at.y < middle.y && (at.x - middle.x).abs() < width + MARGIN - 0.5 * rect.width();
        true
    }

    fn corner(&self, rect: Rect) -> (Align2, Pos2) {
        let inner = rect.shrink2(Vec2::splat(MARGIN));
        match (self.is_right, self.is_low) {
            (false, false) => (Align2::LEFT_TOP, inner.left_top()),
            (true, false) => (Align2::RIGHT_TOP, inner.right_top()),
            (false, true) => (Align2::LEFT_BOTTOM, inner.left_bottom()),
            (true, true) => (Align2::RIGHT_BOTTOM, inner.right_bottom()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the rectangle of a window 300 points high after inspecting `points` in turn.
    fn after(rect: Rect, points: &[Pos2]) -> Rect {
        let (mut place, mut now) = (InspectedPlace::default(), None);
        for (number, &at) in points.iter().enumerate() {
            if place.turn_away(rect, now, number as f32 * Vec3::X, Some(at)) {
                let (pivot, corner) = place.corner(rect);
                now = Some(pivot.anchor_size(corner, Vec2::new(FIRST_WIDTH, 300.0)));
            }
        }
        now.unwrap()
    }

    #[test]
    fn window_avoids_the_point_and_moves_only_if_needed() {
        let rect = Rect::from_min_max(Pos2::new(100.0, 50.0), Pos2::new(900.0, 750.0));
        let [left, right, low] = [(150.0, 100.0), (850.0, 100.0), (150.0, 700.0)].map(Pos2::from);
        assert_eq!(after(rect, &[left]).right_top(), Pos2::new(890.0, 60.0));
        assert_eq!(after(rect, &[right]).left_top(), Pos2::new(110.0, 60.0));
        assert_eq!(
            after(rect, &[right, low]).left_top(),
            Pos2::new(110.0, 60.0),
            "not covered"
        );
        assert_eq!(
            after(rect, &[left, right]).left_top(),
            Pos2::new(110.0, 60.0)
        );
    }

    #[test]
    fn window_moves_to_a_corner_when_the_view_changes() {
        let (wide, narrow) = (
            Rect::from_min_max(Pos2::ZERO, Pos2::new(900.0, 700.0)),
            Rect::everything_right_of(500.0),
        );
        let narrow = narrow.intersect(wide);
        let (mut place, at) = (InspectedPlace::default(), Some(Pos2::new(800.0, 300.0)));
        assert!(place.turn_away(narrow, None, Vec3::X, at));
        let (pivot, corner) = place.corner(narrow);
        let now = Some(pivot.anchor_size(corner, Vec2::new(200.0, 250.0)));
        assert!(!place.turn_away(narrow, now, Vec3::X, at));
        assert!(place.turn_away(wide, now, Vec3::X, at), "not in a corner");
        assert_eq!(place.corner(wide).1, Pos2::new(10.0, 10.0));
    }

    #[test]
    fn window_covers_no_point_of_a_narrow_view() {
        let rect = Rect::from_min_max(Pos2::ZERO, Pos2::new(380.0, 760.0));
        for x in (5..380).step_by(15) {
            for y in (5..760).step_by(15) {
                let at = Pos2::new(x as f32, y as f32);
                assert!(!after(rect, &[at]).contains(at), "{at}");
            }
        }
    }
}
