//! Brush strokes that stop at image edges.

use glam::{DVec2, Vec3};

use super::brush::stroke;
use crate::components::{Connectivity, components};
use crate::lab::lab_of_pixel;
use crate::maxflow::{FlowGraph, FlowLink};
use crate::{MaskError, Region};
use ostra_core::statistics::upper_median;
use ostra_frames::Image;

/// Share of the brush radius within which everything is painted.
const CORE_SHARE: f64 = 0.5;

/// Minimum colour difference (ΔE) that separates two objects.
const LEAST_DIFFERENCE: f32 = 6.0;

/// Colour difference that separates two objects, in median steps between neighbouring pixels.
const DIFFERENCE_IN_STEPS: f32 = 3.0;

/// Weight of smoothness against colour similarity.
///
/// It is the cost of a border one pixel long where there is no edge.
const BORDER_COST: f32 = 1.5;

/// Maximum distance, in steps along a stroke, at which a sample can be the nearest to a pixel.
///
/// The brush reaches two steps.
const NEAR_STEPS: f64 = 4.0;

/// Integer capacity of the cut per unit of cost.
const UNITS: f32 = 1000.0;

/// Returns the pixels of a [`stroke`] on the same side of image edges as its core.
///
/// The core is the inner half of the radius and is always kept. A pixel between half the radius and
/// the radius is kept when its colour is similar to the nearby core and no edge separates the two.
/// The decision is a minimum cut over these pixels (Boykov and Jolly, "Interactive graph cuts for
/// optimal boundary & region segmentation of objects in N-D images", ICCV 2001). Without edges the
/// result is the plain stroke.
///
/// `image` has the frame's size.
///
/// # Errors
/// As [`stroke`].
pub fn snapped_stroke(
    image: &Image,
    points_px: &[DVec2],
    radius_px: f64,
) -> Result<Region, MaskError> {
    let whole = stroke(image.width, image.height, points_px, radius_px)?;
    let core = stroke(image.width, image.height, points_px, radius_px * CORE_SHARE)?;
    let band = StrokeBand::new(image, &whole, &core);
    let appearance = StrokeAppearance::new(image, points_px, radius_px * CORE_SHARE);
    let mut kept = band.cut(&appearance);
    keep_touching(&mut kept, &core);
    Ok(kept)
}

/// Pixels of a stroke as nodes of a graph.
struct StrokeBand<'a> {
    image: &'a Image,
    whole: &'a Region,
    core: &'a Region,
    /// Indices of the stroke's pixels in the image.
    places: Vec<u32>,
    colors: Vec<Vec3>,
    /// Node of each pixel of the image; `u32::MAX` outside the stroke.
    nodes: Vec<u32>,
}

impl<'a> StrokeBand<'a> {
    fn new(image: &'a Image, whole: &'a Region, core: &'a Region) -> Self {
        let places: Vec<u32> = (0..whole.inside.len() as u32)
            .filter(|&at| whole.inside[at as usize])
            .collect();
        let colors = places.iter().map(|&at| lab(image, at as usize)).collect();
        let mut nodes = vec![u32::MAX; whole.inside.len()];
        for (node, &at) in places.iter().enumerate() {
            nodes[at as usize] = node as u32;
        }
        Self {
            image,
            whole,
            core,
            places,
            colors,
            nodes,
        }
    }

    /// Returns pairs of neighbouring pixels of the stroke with their colour difference.
    fn steps(&self) -> Vec<(u32, u32, f32)> {
        let width = self.image.width as usize;
        let mut steps = Vec::with_capacity(self.places.len() * 2);
        for (node, &at) in self.places.iter().enumerate() {
            let at = at as usize;
            let right = (at % width + 1 < width).then_some(at + 1);
            for next in [right, Some(at + width)].into_iter().flatten() {
                if let Some(&other) = self.nodes.get(next).filter(|&&other| other != u32::MAX) {
                    steps.push((
                        node as u32,
                        other,
                        self.colors[node].distance(self.colors[other as usize]),
                    ));
                }
            }
        }
        steps
    }

    fn cut(&self, appearance: &StrokeAppearance) -> Region {
        let steps = self.steps();
        let scale = difference_scale(&steps);
        let terminal = self.places.iter().zip(&self.colors).map(|(&at, &color)| {
            if self.core.inside[at as usize] {
                return (8.0 * BORDER_COST * UNITS) as i32;
            }
            let center = DVec2::new(
                f64::from(at % self.image.width) + 0.5,
                f64::from(at / self.image.width) + 0.5,
            );
            let (off, half) = (appearance.difference(center, color).powi(2), scale * scale);
            ((half - off) / (half + off) * UNITS) as i32
        });
        let link = |&(from, to, step): &(u32, u32, f32)| {
            let cost = (BORDER_COST * (-(step / scale).powi(2)).exp() * UNITS) as i32 + 1;
            FlowLink {
                from,
                to,
                forward: cost,
                backward: cost,
            }
        };
        let side = FlowGraph::new(
            terminal.collect(),
            &steps.iter().map(link).collect::<Vec<_>>(),
        )
        .source_side();
        let mut kept = Region::empty(self.whole.width, self.whole.height);
        for (&at, &inside) in self.places.iter().zip(&side) {
            kept.inside[at as usize] = inside || self.core.inside[at as usize];
        }
        kept
    }
}

/// Returns the colour difference that separates two objects.
///
/// It is a multiple of the median difference between neighbours, so that texture and noise do not
/// count.
fn difference_scale(steps: &[(u32, u32, f32)]) -> f32 {
    let mut sizes: Vec<f32> = steps.iter().map(|step| step.2).collect();
    upper_median(&mut sizes).map_or(LEAST_DIFFERENCE, |usual| {
        (usual * DIFFERENCE_IN_STEPS).max(LEAST_DIFFERENCE)
    })
}

/// Appearance of the core along the stroke.
struct StrokeAppearance {
    places: Vec<(DVec2, Vec<Vec3>)>,
}

impl StrokeAppearance {
    /// Samples the core's colours on a grid around points along the stroke.
    fn new(image: &Image, points_px: &[DVec2], core_px: f64) -> Self {
        let place = |at: DVec2| (at, colors_around(image, at, core_px));
        let size = DVec2::new(f64::from(image.width), f64::from(image.height));
        Self {
            places: places_along(points_px, core_px.max(1.0), size)
                .into_iter()
                .map(place)
                .collect(),
        }
    }

    /// Returns the difference of a colour from the most similar core colour.
    ///
    /// Only the colours at the sample nearest to the position are compared.
    fn difference(&self, at_px: DVec2, color: Vec3) -> f32 {
        let off = |place: &&(DVec2, Vec<Vec3>)| place.0.distance_squared(at_px);
        let near = self.places.iter().min_by(|a, b| off(a).total_cmp(&off(b)));
        let colors = near.map_or(&[][..], |place| &place.1);
        colors
            .iter()
            .map(|other| other.distance(color))
            .fold(f32::INFINITY, f32::min)
    }
}

/// Returns points along a polyline, at most `step_px` apart.
///
/// These are the first point and those near an image of `size`. A stroke may continue far outside,
/// where its points are not the nearest to any pixel.
fn places_along(points_px: &[DVec2], step_px: f64, size: DVec2) -> Vec<DVec2> {
    let mut places = vec![points_px[0]];
    for ends in points_px.windows(2) {
        let Some([enters, leaves]) = shares_inside(ends[0], ends[1], size, NEAR_STEPS * step_px)
        else {
            continue;
        };
        let count = (ends[0].distance(ends[1]) / step_px).ceil().max(1.0);
        let (first, last) = (
            (enters * count).floor().max(1.0),
            (leaves * count).ceil().min(count),
        );
        places
            .extend((first as u64..=last as u64).map(|k| ends[0].lerp(ends[1], k as f64 / count)));
    }
    places.dedup_by(|next, kept| next.distance(*kept) < step_px / 2.0);
    places
}

/// Returns the shares of the way from `a` to `b` at which it enters and leaves a rectangle.
///
/// The rectangle runs from 0 to `size` and is widened by `margin`. Returns `None` when the segment
/// misses it.
fn shares_inside(a: DVec2, b: DVec2, size: DVec2, margin: f64) -> Option<[f64; 2]> {
    let (mut enters, mut leaves) = (0.0f64, 1.0f64);
    for axis in 0..2 {
        let (from, way) = (a[axis], b[axis] - a[axis]);
        let (low, high) = (-margin - from, size[axis] + margin - from);
        if way == 0.0 {
            if low > 0.0 || high < 0.0 {
                return None;
            }
            continue;
        }
        let (first, second) = (low / way, high / way);
        (enters, leaves) = (enters.max(first.min(second)), leaves.min(first.max(second)));
    }
    (enters <= leaves).then_some([enters, leaves])
}

/// Returns the colours on a 5 × 5 grid within a disk.
///
/// Positions outside the image are clamped to the nearest pixel.
fn colors_around(image: &Image, at: DVec2, radius_px: f64) -> Vec<Vec3> {
    let reach = (radius_px - 0.5).max(0.0);
    let far = DVec2::new(f64::from(image.width), f64::from(image.height)) - 1.0;
    let grid =
        (-2..=2).flat_map(|y| (-2..=2).map(move |x| DVec2::new(f64::from(x), f64::from(y)) / 2.0));
    let inside = grid
        .filter(|by| by.length() <= 1.0)
        .map(|by| (at + by * reach).floor().clamp(DVec2::ZERO, far));
    inside
        .map(|pixel| {
            lab(
                image,
                pixel.y as usize * image.width as usize + pixel.x as usize,
            )
        })
        .collect()
}

/// Removes the components that are not connected to the core.
fn keep_touching(region: &mut Region, core: &Region) {
    let parts = components(region, Connectivity::Four);
    let mut touched = vec![false; parts.areas.len() + 1];
    for (&part, &inside) in parts.labels.iter().zip(&core.inside) {
        touched[part as usize] |= inside;
    }
    for (inside, &part) in region.inside.iter_mut().zip(&parts.labels) {
        *inside = part > 0 && touched[part as usize];
    }
}

fn lab(image: &Image, at: usize) -> Vec3 {
    Vec3::from_array(lab_of_pixel(image.pixels[at]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a noisy image of 120 × 80 pixels, with `left` up to column 60, then `right`.
    fn halves(left: [i32; 3], right: [i32; 3], noise: i32) -> Image {
        let pixel = |at: usize| {
            let wobble = ((at * 2_654_435_761) >> 9) as i32 % (2 * noise + 1) - noise;
            let color = if at % 120 < 60 { left } else { right };
            color.map(|value| (value + wobble).clamp(0, 255) as u8)
        };
        Image {
            width: 120,
            height: 80,
            pixels: (0..120 * 80).map(pixel).collect(),
        }
    }

    const UPRIGHT: [DVec2; 2] = [DVec2::new(52.0, 20.0), DVec2::new(52.0, 60.0)];

    #[test]
    fn stroke_over_an_edge_does_not_spill() {
        for (left, right) in [
            ([90, 120, 60], [170, 160, 150]),
            ([60, 60, 60], [90, 90, 90]),
            ([120, 120, 120], [150, 105, 120]),
        ] {
            let image = halves(left, right, 4);
            let plain = stroke(120, 80, &UPRIGHT, 14.0).unwrap();
            let snapped = snapped_stroke(&image, &UPRIGHT, 14.0).unwrap();
            let beyond = |region: &Region| {
                (0..80)
                    .flat_map(|y| (60..120).map(move |x| (x, y)))
                    .filter(|&(x, y)| region.at(x, y))
                    .count()
            };
            let lost = (0..80)
                .flat_map(|y| (0..60).map(move |x| (x, y)))
                .filter(|&(x, y)| plain.at(x, y) && !snapped.at(x, y))
                .count();
            assert!(beyond(&plain) > 200, "the plain brush spills");
            assert!(
                beyond(&snapped) < 8,
                "{left:?} | {right:?}: {} pixels spilt",
                beyond(&snapped)
            );
            assert!(lost < 20, "{left:?} | {right:?}: {lost} pixels lost");
        }
    }

    #[test]
    fn stroke_without_edges_nearly_equals_the_plain_brush() {
        for noise in [0, 3, 12, 40] {
            let image = halves([110, 130, 90], [110, 130, 90], noise);
            let plain = stroke(120, 80, &UPRIGHT, 14.0).unwrap();
            let iou = snapped_stroke(&image, &UPRIGHT, 14.0).unwrap().iou(&plain);
            assert!(iou > 0.98, "noise {noise}: {iou:.3}");
        }
    }

    #[test]
    fn stroke_contains_its_core_and_stays_within_the_brush() {
        let image = halves([20, 20, 20], [230, 230, 230], 9);
        for x in [40.0, 55.0, 60.0, 66.0, 119.9, 130.0] {
            let points = [DVec2::new(x, 10.0), DVec2::new(x, 70.0)];
            for radius in [0.6, 2.0, 9.0, 30.0] {
                let mut snapped = snapped_stroke(&image, &points, radius).unwrap();
                let mut core = stroke(120, 80, &points, radius * CORE_SHARE).unwrap();
                core.subtract(&snapped);
                snapped.subtract(&stroke(120, 80, &points, radius).unwrap());
                assert!(
                    core.is_empty() && snapped.is_empty(),
                    "x {x}, radius {radius}"
                );
            }
        }
        assert!(snapped_stroke(&image, &[], 3.0).is_err());
    }

    #[test]
    fn nothing_behind_a_thin_line_is_painted() {
        let mut image = halves([110, 130, 90], [110, 130, 90], 2);
        for y in 0..80 {
            image.pixels[y * 120 + 60..y * 120 + 62].fill([20, 20, 20]);
        }
        let snapped = snapped_stroke(&image, &UPRIGHT, 16.0).unwrap();
        let behind = (0..80)
            .flat_map(|y| (62..120).map(move |x| (x, y)))
            .filter(|&(x, y)| snapped.at(x, y))
            .count();
        assert_eq!(behind, 0);
    }

    #[test]
    fn strokes_far_outside_the_image_are_sampled_only_near_it() {
        let image = halves([90, 120, 60], [170, 160, 150], 4);
        let far = [
            DVec2::new(52.0, -1e13),
            DVec2::new(52.0, 1e13),
            DVec2::new(4e9, 1e13),
        ];
        let through = [DVec2::new(52.0, -100.0), DVec2::new(52.0, 200.0)];
        let areas =
            [&far[..], &through].map(|points| snapped_stroke(&image, points, 6.0).unwrap().area());
        assert!(
            areas[0] > 0 && areas[0].abs_diff(areas[1]) * 50 <= areas[1],
            "{areas:?}"
        );
        assert_eq!(
            snapped_stroke(&image, &[DVec2::new(500.0, -1e13), DVec2::splat(1e13)], 6.0)
                .unwrap()
                .area(),
            0
        );
        assert!(places_along(&far, 3.0, DVec2::new(120.0, 80.0)).len() < 100);
    }
}
