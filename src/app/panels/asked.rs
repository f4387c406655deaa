use egui::{Align2, Color32, Id, Pos2, Rangef, Rect, Sense, Stroke, Ui, Vec2, Window, WindowDrag};
use glam::Vec3;

use super::scene_tools::{Asked, middle};
use crate::{Panes, SessionView, ViewState};
use ostra_masks::{LabelId, LabelTree};
use ostra_view::ViewCamera;

const COLOR: Color32 = Color32::from_rgb(255, 235, 90);
/// Length of an arm of the cross in the 3-D view, in points of the screen, and the gap around the point itself.
const ARM: f32 = 14.0;
const GAP: f32 = 4.0;
/// Of the window that tells of the point.
const WIDTH: f32 = 180.0;

/// A cross around the point asked about in the view that a camera gives, as large from near as from far, and seen before
/// anything light or dark. Where the middle of the cross is.
fn mark(ui: &Ui, rect: Rect, camera: &ViewCamera, asked: &Asked) -> Option<Pos2> {
    let (at, _) = camera.project(asked.place())?;
    let at = rect.min + Vec2::new(at.x, at.y) / ui.pixels_per_point();
    let painter = ui.painter().with_clip_rect(rect);
    for stroke in [Stroke::new(5.0, Color32::BLACK), Stroke::new(2.0, COLOR)] {
        for arm in [Vec2::X, Vec2::Y, -Vec2::X, -Vec2::Y] {
            painter.line_segment([at + GAP * arm, at + (GAP + ARM) * arm], stroke);
        }
    }
    Some(at)
}

/// A cross at the point asked about, and what is known of it in a corner of the 3-D view away from it: its label, who voted
/// what, and the way there.
pub(super) fn asked_ui(
    ui: &Ui,
    (rect, camera): (Rect, &ViewCamera),
    place: &mut AskedPlace,
    session: &SessionView<'_>,
    view: &mut ViewState,
) {
    view.asked = view
        .asked
        .take()
        .zip(session.cloud)
        .and_then(|(asked, cloud)| asked.on(cloud, session.votes));
    let Some(asked) = view.asked.clone() else {
        place.forget();
        return;
    };
    let at = mark(ui, rect, camera, &asked);
    let (mut open, mut to) = (true, None);
    // Small, so that much of the cloud stays in sight.
    let window = egui::Window::new(egui::RichText::new("Point").strong())
        .default_width(WIDTH)
        .resizable(false);
    let window = window
        .frame(egui::Frame::window(ui.style()).inner_margin(8))
        .open(&mut open);
    place
        .put(window, ui, rect, (asked.place(), at))
        .constrain_to(rect)
        .show(ui.ctx(), |ui| {
            let tree = if session.root.is_some() {
                &session.project.labels
            } else {
                &asked.cloud.tree
            };
            label_ui(ui, tree, asked.cloud.labels[asked.point]);
            let at = asked.place().as_dvec3() + asked.cloud.origin;
            ui.weak(format!("at {:.4}, {:.4}, {:.4}", at.x, at.y, at.z))
                .on_hover_text("World units");
            let confidence = asked.cloud.confidence[asked.point];
            ui.label(format!("{:.0} % of the votes", 100.0 * confidence));
            if asked.votes.is_empty() {
                ui.weak("No frame with a mask shows this point.");
            }
            for &(label, votes) in &asked.votes {
                ui.horizontal(|ui| {
                    ui.monospace(format!("{votes:>4}"));
                    label_ui(ui, tree, label);
                });
            }
            if !asked.voters.is_empty() {
                ui.separator();
                egui::ScrollArea::vertical()
                    .max_height(100.0)
                    .auto_shrink([false, true])
                    .show(ui, |ui| {
                        for voter in &asked.voters {
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
        });
    if let Some((frame, at_px)) = to {
        view.go_to(frame);
        view.zoom.centre_px = at_px;
        if view.prefs.panes == Panes::Scene {
            view.prefs.panes = Panes::Both;
        }
    }
    if !open {
        view.asked = None;
    }
}

/// A label's path in its colour.
pub(super) fn label_ui(ui: &mut Ui, tree: &LabelTree, label: LabelId) {
    let Some(known) = tree.get(label) else {
        ui.weak(if label == LabelId::NONE {
            "nothing".to_owned()
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

/// Where the window of the point asked about stands: where it was left, unless it would cover the point that was just
/// clicked.
#[derive(Default)]
pub(super) struct AskedPlace {
    is_right: bool,
    is_low: bool,
    /// The point it was placed for.
    of: Option<Vec3>,
    /// From where to where the view reached across the window then.
    within: Option<Rangef>,
}

/// Around a point so much stays free, in points of the screen.
const FREE: f32 = 40.0;
/// As wide as it is at first, about.
const FIRST_WIDTH: f32 = 200.0;
/// From the border of the view.
const MARGIN: f32 = 10.0;

impl AskedPlace {
    /// No point is asked about any more.
    pub(super) fn forget(&mut self) {
        self.of = None;
    }

    /// The window in its place in the view `rect`, for a point that is seen at a place, if at all.
    pub(super) fn put<'a>(
        &mut self,
        window: Window<'a>,
        ui: &Ui,
        rect: Rect,
        point: (Vec3, Option<Pos2>),
    ) -> Window<'a> {
        let id = Id::unique("point asked about");
        let now = ui.ctx().memory(|memory| memory.area_rect(id));
        let is_moved = self.turn_away(rect, now, point);
        let (pivot, corner) = self.corner(rect);
        // egui keeps a window that is dragged by its title where it is, whatever position it is given.
        let window = window.id(id).pivot(pivot).drag_area(WindowDrag::Anywhere);
        // Between two points it stays where the user drags it.
        if is_moved {
            window.current_pos(corner)
        } else {
            window.default_pos(corner)
        }
    }

    /// Chooses a corner away from another point than the last, or of another view; whether it does.
    fn turn_away(
        &mut self,
        rect: Rect,
        now: Option<Rect>,
        (point, at): (Vec3, Option<Pos2>),
    ) -> bool {
        let is_new = self.of.replace(point) != Some(point);
        // Beside other panes the view begins or ends elsewhere: what was a corner may be its middle.
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

    /// Where a window 300 high stands after points were asked about.
    fn after(rect: Rect, points: &[Pos2]) -> Rect {
        let (mut place, mut now) = (AskedPlace::default(), None);
        for (number, &at) in points.iter().enumerate() {
            if place.turn_away(rect, now, (number as f32 * Vec3::X, Some(at))) {
                let (pivot, corner) = place.corner(rect);
                now = Some(pivot.anchor_size(corner, Vec2::new(FIRST_WIDTH, 300.0)));
            }
        }
        now.unwrap()
    }

    #[test]
    fn it_stands_away_from_the_point_and_moves_only_when_it_must() {
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
    fn it_goes_to_a_corner_of_the_view_among_other_panes() {
        let (wide, narrow) = (
            Rect::from_min_max(Pos2::ZERO, Pos2::new(900.0, 700.0)),
            Rect::everything_right_of(500.0),
        );
        let narrow = narrow.intersect(wide);
        let (mut place, at) = (AskedPlace::default(), Some(Pos2::new(800.0, 300.0)));
        assert!(place.turn_away(narrow, None, (Vec3::X, at)));
        let (pivot, corner) = place.corner(narrow);
        let now = Some(pivot.anchor_size(corner, Vec2::new(200.0, 250.0)));
        assert!(!place.turn_away(narrow, now, (Vec3::X, at)));
        assert!(place.turn_away(wide, now, (Vec3::X, at)), "not in a corner");
        assert_eq!(place.corner(wide).1, Pos2::new(10.0, 10.0));
    }

    #[test]
    fn no_point_of_a_narrow_view_is_covered() {
        let rect = Rect::from_min_max(Pos2::ZERO, Pos2::new(380.0, 760.0));
        for x in (5..380).step_by(15) {
            for y in (5..760).step_by(15) {
                let at = Pos2::new(x as f32, y as f32);
                assert!(!after(rect, &[at]).contains(at), "{at}");
            }
        }
    }
}
