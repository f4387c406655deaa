use egui::{Pos2, Rect, Vec2};
use glam::DVec2;
use ostra_masks::PxBox;

/// Zoom and position of the image in its pane. They are kept when the shown frame changes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ZoomState {
    /// Screen points per image pixel; `None` fits the whole image.
    pub scale: Option<f32>,
    /// Image position at the centre of the pane; unused while the image is fitted.
    pub centre_px: DVec2,
}

/// Current mapping between image and screen positions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CanvasMap {
    /// Rectangle of the pane, in screen points.
    pub pane: Rect,
    /// Width and height of the image.
    pub size_px: [u32; 2],
    /// Screen points per image pixel.
    pub scale: f32,
    /// Image position at the centre of the pane.
    pub centre_px: DVec2,
}

/// Margin around a fitted image, in screen points.
const MARGIN: f32 = 10.0;
/// Margin around a part of the image that is shown, as a share of its size.
const PART_MARGIN: f64 = 0.2;
/// Largest zoom, in screen points per image pixel. A larger one shows no more detail.
const MAX_SCALE: f32 = 64.0;

impl ZoomState {
    /// Returns the mapping for an image of this size in this pane.
    #[must_use]
    pub fn map(&self, pane: Rect, size_px: [u32; 2]) -> CanvasMap {
        let middle = DVec2::from(size_px.map(f64::from)) / 2.0;
        match self.scale {
            Some(scale) => CanvasMap {
                pane,
                size_px,
                scale,
                centre_px: self.centre_px,
            },
            None => CanvasMap {
                pane,
                size_px,
                scale: fit_scale(pane, size_px),
                centre_px: middle,
            },
        }
    }

    /// Zooms in (`factor` > 1) or out, keeping the image position under `at` fixed.
    pub fn zoom_at(&mut self, map: &CanvasMap, at: Pos2, factor: f32) {
        let fixed = map.to_px(at);
        let least = fit_scale(map.pane, map.size_px).min(1.0) * 0.25;
        let scale = (map.scale * factor).clamp(least, MAX_SCALE);
        let offset = at - map.pane.center();
        self.scale = Some(scale);
        self.centre_px =
            fixed - DVec2::new(f64::from(offset.x), f64::from(offset.y)) / f64::from(scale);
        self.keep_in_sight(map.size_px);
    }

    /// Shows a part of the image, with a margin around it.
    pub fn show(&mut self, map: &CanvasMap, part: PxBox) {
        let size = (part.max_px - part.min_px).max(DVec2::ONE) * (1.0 + 2.0 * PART_MARGIN);
        let pane = DVec2::new(f64::from(map.pane.width()), f64::from(map.pane.height()));
        let least = fit_scale(map.pane, map.size_px);
        let scale = (pane / size).min_element() as f32;
        self.scale = Some(scale.clamp(least.min(MAX_SCALE), MAX_SCALE));
        self.centre_px = (part.min_px + part.max_px) / 2.0;
    }

    /// Moves the image by a pointer movement in screen points.
    pub fn pan(&mut self, map: &CanvasMap, delta: Vec2) {
        self.scale = Some(map.scale);
        self.centre_px = map.centre_px
            - DVec2::new(f64::from(delta.x), f64::from(delta.y)) / f64::from(map.scale);
        self.keep_in_sight(map.size_px);
    }

    fn keep_in_sight(&mut self, size_px: [u32; 2]) {
        self.centre_px = self.centre_px.clamp(
            DVec2::ZERO,
            DVec2::new(f64::from(size_px[0]), f64::from(size_px[1])),
        );
    }
}

impl CanvasMap {
    /// Returns the image position at a screen position; it may lie outside the image.
    #[must_use]
    pub fn to_px(&self, at: Pos2) -> DVec2 {
        let offset = at - self.pane.center();
        self.centre_px
            + DVec2::new(f64::from(offset.x), f64::from(offset.y)) / f64::from(self.scale)
    }

    /// Returns the screen position of an image position.
    #[must_use]
    pub fn to_screen(&self, at_px: DVec2) -> Pos2 {
        let offset = (at_px - self.centre_px) * f64::from(self.scale);
        self.pane.center() + Vec2::new(offset.x as f32, offset.y as f32)
    }

    /// Returns the centre of the image, in pixels.
    #[must_use]
    pub fn middle_px(&self) -> DVec2 {
        DVec2::from(self.size_px.map(f64::from)) / 2.0
    }

    /// Returns the screen rectangle of the whole image.
    #[must_use]
    pub fn image_rect(&self) -> Rect {
        let size = DVec2::new(f64::from(self.size_px[0]), f64::from(self.size_px[1]));
        Rect::from_two_pos(self.to_screen(DVec2::ZERO), self.to_screen(size))
    }

    /// Returns the image position if it lies inside the image.
    #[must_use]
    pub fn inside(&self, at_px: DVec2) -> Option<DVec2> {
        let [width, height] = self.size_px.map(f64::from);
        (at_px.x >= 0.0 && at_px.y >= 0.0 && at_px.x < width && at_px.y < height).then_some(at_px)
    }

    /// Returns the nearest image position inside the image.
    #[must_use]
    pub fn clamped(&self, at_px: DVec2) -> DVec2 {
        let [width, height] = self.size_px.map(f64::from);
        at_px.clamp(DVec2::ZERO, DVec2::new(width, height))
    }
}

fn fit_scale(pane: Rect, size_px: [u32; 2]) -> f32 {
    let free = (pane.size() - Vec2::splat(2.0 * MARGIN)).max(Vec2::splat(1.0));
    (free.x / size_px[0].max(1) as f32).min(free.y / size_px[1].max(1) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PANE: Rect = Rect {
        min: Pos2::new(100.0, 50.0),
        max: Pos2::new(900.0, 650.0),
    };

    #[test]
    fn fit_centres_the_whole_image() {
        let map = ZoomState::default().map(PANE, [640, 480]);
        assert!(PANE.contains_rect(map.image_rect()));
        assert_eq!(map.image_rect().center(), PANE.center());
    }

    #[test]
    fn screen_and_image_positions_are_inverse() {
        let zoom = ZoomState {
            scale: Some(3.7),
            centre_px: DVec2::new(100.0, 80.0),
        };
        let map = zoom.map(PANE, [640, 480]);
        let at = DVec2::new(12.5, 300.25);
        assert!((map.to_px(map.to_screen(at)) - at).length() < 1e-4);
    }

    #[test]
    fn zoom_keeps_the_position_under_the_pointer() {
        let mut zoom = ZoomState::default();
        let before = zoom.map(PANE, [640, 480]);
        let at = Pos2::new(300.0, 400.0);
        zoom.zoom_at(&before, at, 2.5);
        let after = zoom.map(PANE, [640, 480]);
        assert!((before.to_px(at) - after.to_px(at)).length() < 1e-4);
        assert!((after.scale / before.scale - 2.5).abs() < 1e-4);
    }

    #[test]
    fn part_of_the_image_fills_the_pane_with_a_margin() {
        let mut zoom = ZoomState::default();
        let map = zoom.map(PANE, [640, 480]);
        let part = PxBox {
            min_px: DVec2::new(600.0, 100.0),
            max_px: DVec2::new(630.0, 200.0),
        };
        zoom.show(&map, part);
        let map = zoom.map(PANE, [640, 480]);
        let [min, max] = [part.min_px, part.max_px].map(|at| map.to_screen(at));
        assert!(PANE.contains(min) && PANE.contains(max));
        assert!(((max.y - min.y) / PANE.height() - 1.0 / 1.4).abs() < 0.01);
        zoom.show(
            &map,
            PxBox {
                min_px: DVec2::ZERO,
                max_px: DVec2::new(640.0, 480.0),
            },
        );
        assert_eq!(
            zoom.scale,
            ZoomState::default().map(PANE, [640, 480]).scale.into()
        );
    }

    #[test]
    fn panning_moves_with_the_pointer() {
        let mut zoom = ZoomState {
            scale: Some(2.0),
            centre_px: DVec2::new(320.0, 240.0),
        };
        let map = zoom.map(PANE, [640, 480]);
        zoom.pan(&map, Vec2::new(30.0, -10.0));
        let moved = zoom
            .map(PANE, [640, 480])
            .to_screen(DVec2::new(320.0, 240.0));
        assert_eq!(moved, PANE.center() + Vec2::new(30.0, -10.0));
    }
}
