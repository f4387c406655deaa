use ostra_masks::{Region, squared_distance_to};

/// Tolerance of matching boundaries as a share of the image diagonal, rounded up to whole pixels.
const TOLERANCE: f64 = 0.008;

/// Returns the boundary F-measure of two regions of one frame, 0–1.
///
/// It is the harmonic mean of precision and recall: the share of the result's boundary close to the
/// ground truth boundary, and the share of the ground truth boundary close to the result's. It is 1
/// if both are empty. "Close" is within 0.008 of the diagonal, rounded up, by a disk on the pixel
/// grid.
///
/// Source: Perazzi, Pont-Tuset, McWilliams, Van Gool, Gross, Sorkine-Hornung, "A benchmark dataset
/// and evaluation methodology for video object segmentation", CVPR 2016.
#[must_use]
pub fn boundary_f(truth: &Region, result: &Region) -> f64 {
    let Some(window) = BoundaryWindow::around(truth, result) else {
        return 1.0;
    };
    let diagonal = f64::from(truth.width).hypot(f64::from(truth.height));
    let tolerance = (TOLERANCE * diagonal).ceil();
    let (true_boundary, found_boundary) = (window.boundary(truth), window.boundary(result));
    let (true_length, found_length) = (true_boundary.area(), found_boundary.area());
    if true_length == 0 || found_length == 0 {
        return f64::from(u8::from(true_length == found_length));
    }
    let precision = share_near(&found_boundary, &true_boundary, tolerance);
    let recall = share_near(&true_boundary, &found_boundary, tolerance);
    if precision + recall == 0.0 {
        0.0
    } else {
        2.0 * precision * recall / (precision + recall)
    }
}

/// Returns the share of the pixels of `boundary` within `tolerance` pixels of `other`.
fn share_near(boundary: &Region, other: &Region, tolerance: f64) -> f64 {
    let distances = squared_distance_to(other);
    let near = |at: &usize| f64::from(distances[*at]) <= tolerance * tolerance;
    let pixels = (0..distances.len()).filter(|&at| boundary.inside[at]);
    pixels.filter(near).count() as f64 / boundary.area() as f64
}

/// The part of a frame that can contain boundaries.
struct BoundaryWindow {
    left: u32,
    top: u32,
    /// Exclusive.
    right: u32,
    /// Exclusive.
    bottom: u32,
}

impl BoundaryWindow {
    /// Returns the bounding box of both regions, extended by one pixel to the left and the top.
    ///
    /// The right and lower neighbours of the additional pixels can be inside. Returns `None` if
    /// both regions are empty.
    fn around(truth: &Region, result: &Region) -> Option<Self> {
        let width = truth.width.max(1) as usize;
        let rows = truth
            .inside
            .chunks_exact(width)
            .zip(result.inside.chunks_exact(width));
        let mut window: Option<Self> = None;
        for (row, (a, b)) in (0..).zip(rows) {
            let either = |column: &usize| a[*column] | b[*column];
            let Some(first) = (0..width).find(either) else {
                continue;
            };
            let last = (first..width).rev().find(either).unwrap_or(first);
            let (left, right) = ((first as u32).saturating_sub(1), last as u32 + 1);
            let known = window.get_or_insert(Self {
                left,
                top: row,
                right,
                bottom: row,
            });
            (known.left, known.right, known.bottom) =
                (known.left.min(left), known.right.max(right), row + 1);
        }
        window.map(|window| Self {
            top: window.top.saturating_sub(1),
            ..window
        })
    }

    /// Returns the pixels whose right, lower or lower right neighbour is on the other side.
    ///
    /// In the last column only the lower neighbour counts, in the last row only the right one.
    fn boundary(&self, region: &Region) -> Region {
        let (width, height) = (self.right - self.left, self.bottom - self.top);
        let mut boundary = Region::empty(width, height);
        let columns = (self.left..self.right).map(|x| (x, (x + 1).min(region.width - 1)));
        let rows = (self.top..self.bottom).map(|y| (y, (y + 1).min(region.height - 1)));
        let pixels = rows.flat_map(|row| columns.clone().map(move |column| (column, row)));
        for (inside, ((x, right), (y, below))) in boundary.inside.iter_mut().zip(pixels) {
            let here = region.at(x, y);
            *inside = here != region.at(right, y)
                || here != region.at(x, below)
                || here != region.at(right, below);
        }
        boundary
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rectangle(x: u32, y: u32, width: u32, height: u32) -> Region {
        let mut region = Region::empty(100, 75);
        for row in y..y + height {
            for column in x..x + width {
                region.inside[(row * 100 + column) as usize] = true;
            }
        }
        region
    }

    #[test]
    fn boundary_f_of_empty_and_full_regions() {
        let (some, none) = (rectangle(10, 10, 20, 20), Region::empty(100, 75));
        assert!((boundary_f(&none, &none) - 1.0).abs() < 1e-12);
        assert!(boundary_f(&some, &none).abs() < 1e-12);
        assert!(boundary_f(&none, &some).abs() < 1e-12);
        let all = none.inverted();
        assert!(
            (boundary_f(&all, &none) - 1.0).abs() < 1e-12,
            "a full frame has no boundary, as in DAVIS"
        );
    }

    #[test]
    fn tolerance_of_a_hundred_pixel_frame_is_one_pixel() {
        let truth = rectangle(10, 10, 20, 20);
        assert!((boundary_f(&truth, &rectangle(11, 10, 20, 20)) - 1.0).abs() < 1e-12);
        let moved = boundary_f(&truth, &rectangle(12, 10, 20, 20));
        assert!(moved > 0.4 && moved < 0.6, "{moved}");
    }

    /// Returns the pixels (x, y) with ((x − cx)·b)² + ((y − cy)·a)² ≤ (a·b)² in a 200 × 150 frame.
    fn ellipse(cx: i64, cy: i64, a: i64, b: i64) -> Region {
        let pixels = (0..150).flat_map(|y| (0..200).map(move |x| (x, y)));
        let inside = pixels
            .map(|(x, y)| ((x - cx) * b).pow(2) + ((y - cy) * a).pow(2) <= (a * b).pow(2))
            .collect();
        Region {
            width: 200,
            height: 150,
            inside,
        }
    }

    #[test]
    fn scores_match_an_independent_computation() {
        // J and F computed in NumPy by dilating boundary images with a disk.
        let truth = ellipse(100, 70, 60, 30);
        let mut cut = truth.clone();
        cut.subtract(&ellipse(130, 70, 15, 15));
        let mut two = ellipse(60, 60, 25, 20);
        two.unite(&ellipse(130, 80, 30, 25));
        let cases = [
            (
                &truth,
                ellipse(102, 71, 60, 30),
                0.941_824_440_620,
                0.947_802_197_802,
            ),
            (&truth, cut, 0.874_313_065_059, 0.854_460_093_897),
            (&truth, two, 0.481_303_335_919, 0.111_023_622_047),
            (
                &ellipse(195, 146, 50, 40),
                ellipse(198, 147, 50, 40),
                0.906_976_744_186,
                0.464_846_269_619,
            ),
            (
                &ellipse(0, 0, 32, 20),
                ellipse(2, 1, 30, 20),
                0.920_913_884_007,
                1.0,
            ),
        ];
        for (truth, result, j, f) in cases {
            assert!(
                (truth.iou(&result) - j).abs() < 1e-9,
                "{} {j}",
                truth.iou(&result)
            );
            assert!(
                (boundary_f(truth, &result) - f).abs() < 1e-9,
                "{} {f}",
                boundary_f(truth, &result)
            );
            assert!((boundary_f(&result, truth) - f).abs() < 1e-9);
        }
    }
}
