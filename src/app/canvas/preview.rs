use std::sync::Arc;

use egui::{Color32, Painter, Pos2, Shape, Stroke};
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
}

impl PreviewOutline {
    /// Draws the outline of the labelled pixels of a mask.
    pub(super) fn draw(
        &mut self,
        painter: &Painter,
        map: &CanvasMap,
        mask: &Arc<RunMask>,
        color: Color32,
    ) {
        if !self.of.as_ref().is_some_and(|of| Arc::ptr_eq(of, mask)) {
            self.rings_px = rings_of(&mask.decode());
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
    }
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
        assert!(rings[0].contains(&DVec2::new(2.0, 2.0)));
        assert!(rings[1].contains(&DVec2::new(8.0, 8.0)), "{rings:?}");
    }
}
