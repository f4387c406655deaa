use std::sync::Arc;

use egui::{Color32, FontId, Painter, Pos2, Rect, Shape, Stroke, Vec2};
use glam::DVec2;

use super::map::CanvasMap;
use ostra_masks::{LabelId, LabelMask, Region, RunMask, outlines, simplified_ring};

/// Length of a dash and of the gap after it, in screen points.
const DASH: [f32; 2] = [6.0, 5.0];
/// Maximum distance of the drawn outline from the border of the pixels, in pixels.
const TOLERANCE_PX: f64 = 0.7;

/// Outline of the mask that a click at the resting pointer would give.
///
/// It is dashed and not filled, so that it cannot be mistaken for a mask.
#[derive(Default)]
pub struct PreviewOutline {
    of: Option<Arc<RunMask>>,
    rings_px: Vec<Vec<DVec2>>,
    /// Share of the image inside.
    share: f64,
}

impl PreviewOutline {
    /// Draws the outline of the labelled pixels of a mask, and their share of the image at the pointer.
    pub(super) fn draw(
        &mut self,
        painter: &Painter,
        map: &CanvasMap,
        mask: &Arc<RunMask>,
        color: Color32,
        pointer: Option<Pos2>,
    ) {
        if !self.of.as_ref().is_some_and(|of| Arc::ptr_eq(of, mask)) {
            self.rings_px = rings_of(&mask.decode());
            self.share = share_of(mask);
            self.of = Some(Arc::clone(mask));
        }
        let [dash, gap] = DASH;
        for ring in &self.rings_px {
            let mut line: Vec<Pos2> = ring.iter().map(|&at| map.to_screen(at)).collect();
            line.extend(line.first().copied());
            for (width, color) in [(3.5, Color32::from_black_alpha(170)), (1.5, color)] {
                let dashes = Shape::dashed_line(&line, Stroke::new(width, color), dash, gap);
                painter.extend(dashes);
            }
        }
        if let Some(at) = pointer.filter(|_| !self.rings_px.is_empty()) {
            let text = format!("{:.1} % of the image", 100.0 * self.share);
            let font = FontId::proportional(12.0);
            let text = painter.layout_no_wrap(text, font, Color32::WHITE);
            let place = Rect::from_min_size(at + Vec2::new(14.0, 18.0), text.size());
            painter.rect_filled(place.expand(3.0), 3.0, Color32::from_black_alpha(170));
            painter.galley(place.min, text, Color32::WHITE);
        }
    }
}

/// Returns the share of the pixels that have a label.
fn share_of(mask: &RunMask) -> f64 {
    let labelled: u64 = mask
        .runs
        .iter()
        .filter(|(id, _)| *id != LabelId::NONE)
        .map(|&(_, length)| u64::from(length))
        .sum();
    let all = u64::from(mask.width) * u64::from(mask.height);
    labelled as f64 / all.max(1) as f64
}

/// Returns the borders of the labelled pixels.
fn rings_of(mask: &LabelMask) -> Vec<Vec<DVec2>> {
    let region = Region {
        width: mask.width,
        height: mask.height,
        inside: mask.ids.iter().map(|&id| id != LabelId::NONE).collect(),
    };
    outlines(&region)
        .into_iter()
        .flat_map(|outline| std::iter::once(outline.outer).chain(outline.holes))
        .filter_map(|ring| simplified_ring(&ring, TOLERANCE_PX))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rings_are_the_borders_of_the_labelled_pixels_with_their_holes() {
        let mut mask = LabelMask::empty(12, 12);
        for y in 2..10 {
            for x in 2..10 {
                let is_hole = (4..8).contains(&x) && (4..8).contains(&y);
                if !is_hole {
                    mask.ids[y * 12 + x] = LabelId(3);
                }
            }
        }
        let rings = rings_of(&mask);
        assert_eq!(rings.len(), 2, "{rings:?}");
        let share = share_of(&RunMask::encode(&mask));
        assert!((share - 48.0 / 144.0).abs() < 1e-9, "{share}");
        assert!(rings[0].contains(&DVec2::new(2.0, 2.0)));
        assert!(rings[1].contains(&DVec2::new(8.0, 8.0)), "{rings:?}");
    }
}
