use super::canvas::Canvas;
use super::part::Part;
use crate::Region;

/// Places along each side of a logit's cell at which a region is looked at.
const SAMPLES: usize = 4;
/// Logit of a cell that lies inside as a whole, about as sure as the network's own answers are.
const SURE: f32 = 10.0;

/// A region of the picture as logits that the decoder can refine: `fine · fine` of its square, from how much of each cell
/// is inside.
pub(super) fn hint(region: &Region, part: Part, canvas: Canvas, fine: usize) -> Vec<f32> {
    let (columns, rows) = part.shown(canvas);
    let steps = fine * SAMPLES;
    // Pixel of the picture under each sample along an axis; none in the padding.
    let along = |first: u32, count: u32, shown: usize| -> Vec<Option<u32>> {
        let pixel = |at: usize| {
            ((at as f64 + 0.5) * canvas.side as f64 / steps as f64 * f64::from(count)
                / shown as f64) as u32
        };
        (0..steps)
            .map(|at| {
                Some(pixel(at))
                    .filter(|&pixel| pixel < count)
                    .map(|pixel| first + pixel)
            })
            .collect()
    };
    let (across, down) = (
        along(part.x, part.width, columns),
        along(part.y, part.height, rows),
    );
    let mut inside = vec![0u32; fine * fine];
    for (y, row) in down.iter().enumerate() {
        for (x, column) in across.iter().enumerate() {
            let is_inside = column.zip(*row).is_some_and(|(x, y)| region.at(x, y));
            inside[y / SAMPLES * fine + x / SAMPLES] += u32::from(is_inside);
        }
    }
    let share = |&count: &u32| count as f32 / (SAMPLES * SAMPLES) as f32;
    inside
        .iter()
        .map(|count| SURE * (2.0 * share(count) - 1.0))
        .collect()
}
