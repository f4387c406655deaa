use egui::{Align2, Id, Pos2, Rangef, Rect, Ui, Vec2, Window, WindowDrag};
use glam::Vec3;

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
const WIDTH: f32 = 200.0;
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
        let width = now.map_or(WIDTH, |now| now.width()) + FREE;
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
                now = Some(pivot.anchor_size(corner, Vec2::new(WIDTH, 300.0)));
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
            "it does not cover that"
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
        assert!(
            place.turn_away(wide, now, (Vec3::X, at)),
            "it is not in a corner of that"
        );
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
