use glam::DVec2;
use rayon::prelude::*;

use crate::{MaskError, Region, squared_distance_to};
use ostra_core::image::blend;

/// Interpolation between two shapes.
///
/// Both shapes are moved and scaled to the interpolated centroid and size, so that an object that
/// moves or grows keeps its form. Their signed distances are then blended (Raya, Udupa,
/// "Shape-based interpolation of multidimensional objects", IEEE Transactions on Medical Imaging,
/// 1990).
#[derive(Debug, Clone)]
pub struct ShapeBlend {
    first: RegionShape,
    second: RegionShape,
}

/// Signed distance, centroid and size of a region.
#[derive(Debug, Clone)]
struct RegionShape {
    width: usize,
    height: usize,
    /// Distance from the outline in pixels, row by row; positive outside, negative inside.
    distance_px: Vec<f32>,
    centroid_px: DVec2,
    /// Square root of the area.
    size_px: f64,
}

impl ShapeBlend {
    /// Prepares the interpolation between two regions.
    ///
    /// # Errors
    /// [`MaskError::Request`] when a region is empty or the two differ in size.
    pub fn new(first: &Region, second: &Region) -> Result<Self, MaskError> {
        first.check_size(second.width, second.height)?;
        if first.is_empty() || second.is_empty() {
            return Err(MaskError::Request(
                "there is nothing to interpolate from; give both ends a mask".into(),
            ));
        }
        Ok(Self {
            first: RegionShape::of(first),
            second: RegionShape::of(second),
        })
    }

    /// Returns the shape at `share` of the way from the first (0) to the second (1).
    #[must_use]
    pub fn at(&self, share: f64) -> Region {
        let (a, b) = (&self.first, &self.second);
        let centroid_px = a.centroid_px.lerp(b.centroid_px, share);
        let size_px = a.size_px.powf(1.0 - share) * b.size_px.powf(share);
        let mut inside = vec![false; a.distance_px.len()];
        inside
            .par_chunks_mut(a.width.max(1))
            .enumerate()
            .for_each(|(y, row)| {
                for (x, inside) in row.iter_mut().enumerate() {
                    let off = (DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - centroid_px) / size_px;
                    *inside = (1.0 - share) * a.relative_at(off) + share * b.relative_at(off) < 0.0;
                }
            });
        Region {
            width: a.width as u32,
            height: a.height as u32,
            inside,
        }
    }
}

impl RegionShape {
    fn of(region: &Region) -> Self {
        let (width, height) = (region.width as usize, region.height as usize);
        let longest = (width + height) as f32;
        let root = |squared: u32| (squared as f32).sqrt().min(longest);
        let (outside, within) = (
            squared_distance_to(region),
            squared_distance_to(&region.inverted()),
        );
        // Distances run between pixel centres, so the outline lies half a pixel before the nearest
        // pixel on its other side.
        let signed = |(&out, &within): (&u32, &u32)| {
            if out > 0 {
                root(out) - 0.5
            } else {
                0.5 - root(within)
            }
        };
        let distance_px = outside.iter().zip(&within).map(signed).collect();
        let area = region.area() as f64;
        let at = |at: usize| DVec2::new((at % width) as f64 + 0.5, (at / width) as f64 + 0.5);
        let sum: DVec2 = (0..region.inside.len())
            .filter(|&pixel| region.inside[pixel])
            .map(at)
            .sum();
        Self {
            width,
            height,
            distance_px,
            centroid_px: sum / area,
            size_px: area.sqrt(),
        }
    }

    /// Returns the signed distance at `off` from the centroid.
    ///
    /// Both are in units of the shape's size. Beyond the frame's edge, the value at the edge is
    /// used.
    fn relative_at(&self, off: DVec2) -> f64 {
        let at = self.centroid_px + off * self.size_px - 0.5;
        let last = DVec2::new((self.width - 1) as f64, (self.height - 1) as f64);
        let at = at.clamp(DVec2::ZERO, last);
        let (x, y) = (at.x as usize, at.y as usize);
        let (right, below) = ((x + 1).min(self.width - 1), (y + 1).min(self.height - 1));
        let (fx, fy) = (at.x - x as f64, at.y - y as f64);
        let of = |x: usize, y: usize| f64::from(self.distance_px[y * self.width + x]);
        let upper = blend(of(x, y), of(right, y), fx);
        let lower = blend(of(x, below), of(right, below), fx);
        blend(upper, lower, fy) / self.size_px
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ellipse(centre: (f64, f64), radii: (f64, f64)) -> Region {
        let (width, height) = (120u32, 80u32);
        let inside = (0..width * height).map(|at| {
            let (x, y) = (
                f64::from(at % width) + 0.5 - centre.0,
                f64::from(at / width) + 0.5 - centre.1,
            );
            (x / radii.0).powi(2) + (y / radii.1).powi(2) <= 1.0
        });
        Region {
            width,
            height,
            inside: inside.collect(),
        }
    }

    #[test]
    fn blend_reproduces_both_ends() {
        let (a, b) = (
            ellipse((30.0, 40.0), (18.0, 7.0)),
            ellipse((85.0, 30.0), (9.0, 14.0)),
        );
        let blend = ShapeBlend::new(&a, &b).unwrap();
        assert!(blend.at(0.0).iou(&a) > 0.99 && blend.at(1.0).iou(&b) > 0.99);
    }

    #[test]
    fn moving_and_growing_ellipse_stays_an_ellipse() {
        let blend = ShapeBlend::new(
            &ellipse((25.0, 40.0), (10.0, 5.0)),
            &ellipse((85.0, 50.0), (20.0, 10.0)),
        )
        .unwrap();
        let half = 2.0f64.sqrt();
        let iou = blend
            .at(0.5)
            .iou(&ellipse((55.0, 45.0), (10.0 * half, 5.0 * half)));
        assert!(iou > 0.94, "{iou}");
    }

    #[test]
    fn empty_regions_are_rejected() {
        let some = ellipse((30.0, 40.0), (8.0, 8.0));
        assert!(ShapeBlend::new(&some, &Region::empty(120, 80)).is_err());
        assert!(ShapeBlend::new(&Region::empty(4, 4), &some).is_err());
    }
}
