use glam::DVec2;

use super::path::{PathPixel, path_between};
use super::ribbon::{Ribbon, median, split};
use super::ridge::{Ridge, RidgeFilter};
use crate::{MaskError, Region};
use ostra_frames::Image;

/// Minimum distance of two points, pixels; closer points count as one.
const SAME_PX: f64 = 1.0;

/// Maximum distance of neighbouring points, pixels.
///
/// Bounds the part of the image that is searched.
const MOST_APART_PX: f64 = 1500.0;

/// Returns the pixels of a thin structure (stem, wire) that runs through the points.
///
/// The structure may be up to about 25 pixels wide. Points are in pixels, in their order along the
/// structure, and may be a few pixels off it. From each point to the next, the line of most
/// contrast and most similar colour is followed. Its width is measured from the edges on both sides
/// at every pixel. The structure ends at the first and the last point.
///
/// # Errors
/// [`MaskError::Request`] for fewer than two different points, or for points outside the image or
/// too far apart.
pub fn trace(image: &Image, points_px: &[DVec2]) -> Result<Region, MaskError> {
    let points = checked(image, points_px)?;
    let filter = RidgeFilter::new();
    let mut path: Vec<PathPixel> = Vec::new();
    for ends in points.windows(2) {
        let part = path_between(image, &filter, ends[0], ends[1]);
        path.extend(&part[usize::from(!path.is_empty()).min(part.len())..]);
    }
    let (places, ridges) = split(&path);
    let ribbon = Ribbon::fit(image, &places, &ridges, reach(&ridges));
    ribbon.region(image.width, image.height, 1)
}

fn checked(image: &Image, points_px: &[DVec2]) -> Result<Vec<DVec2>, MaskError> {
    let refuse = |what: String| Err(MaskError::Request(what));
    let (width, height) = (f64::from(image.width), f64::from(image.height));
    let inside =
        |p: &DVec2| p.is_finite() && p.x >= 0.0 && p.y >= 0.0 && p.x <= width && p.y <= height;
    if let Some(out) = points_px.iter().find(|point| !inside(point)) {
        return refuse(format!(
            "the point {}, {} is outside the image ({width}×{height}); move it in",
            out.x, out.y
        ));
    }
    let mut points = points_px.to_vec();
    points.dedup_by(|a, b| a.distance(*b) < SAME_PX);
    if points.len() < 2 {
        return refuse("a thin structure needs two different points or more: where it begins and where it ends".into());
    }
    if points
        .windows(2)
        .any(|ends| ends[0].distance(ends[1]) > MOST_APART_PX)
    {
        return refuse(format!(
            "two points are more than {MOST_APART_PX} pixels apart; give one in between"
        ));
    }
    Ok(points)
}

/// Returns how far from the line edges are searched, pixels.
fn reach(ridges: &[Ridge]) -> f64 {
    let mut half_widths: Vec<f32> = ridges.iter().map(|ridge| ridge.half_width_px).collect();
    2.0 * f64::from(median(&mut half_widths)) + 4.0
}
