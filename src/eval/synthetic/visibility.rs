use glam::DVec3;
use rayon::prelude::*;

use super::model::Model;
use super::raster::{Raster, band_rows};
use super::sampling::Spot;
use super::view::View;

/// A surface hides what lies more than this behind it, metres: rounding, not size.
const BEHIND_M: f64 = 2e-5;

/// Numbers of the spots that a view sees, ascending. Every spot has its own ray, so that the answer is exact and does
/// not depend on the picture's resolution.
pub(super) fn visible_spots(model: &Model, spots: &[Spot], view: &View) -> Vec<usize> {
    let raster = Raster::new(model, &view.camera, &view.camera_from_world);
    let pixels = Pixels::new(spots, view);
    let bands = (0..raster.band_count())
        .into_par_iter()
        .map(|band| seen_in_band(&raster, &pixels, view, band));
    let mut seen: Vec<usize> = bands.collect::<Vec<_>>().concat();
    seen.sort_unstable();
    seen
}

fn seen_in_band(raster: &Raster<'_>, pixels: &Pixels, view: &View, band: usize) -> Vec<usize> {
    let (width, rows) = (view.camera.width, band_rows(&view.camera, band));
    let first = pixels.range(0, rows.start).start;
    let last = pixels.range(width - 1, rows.end - 1).end;
    let mut hidden = vec![false; last - first];
    for facet in raster.facets(band) {
        let (columns, rows) = facet.pixels(0..width, rows.clone());
        for row in rows {
            for column in columns.clone() {
                for place in pixels.range(column, row) {
                    let x = pixels.x_in_camera[place];
                    let nearer = facet
                        .depth(x / x.z)
                        .is_some_and(|depth| depth < x.z - BEHIND_M);
                    hidden[place - first] |= nearer;
                }
            }
        }
    }
    (first..last)
        .filter(|place| !hidden[place - first])
        .map(|place| pixels.spots[place])
        .collect()
}

/// Spots sorted by the pixel that they fall into.
struct Pixels {
    width: u32,
    /// Per pixel, where its spots start in the lists below; one more at the end.
    starts: Vec<usize>,
    spots: Vec<usize>,
    x_in_camera: Vec<DVec3>,
}

impl Pixels {
    fn new(spots: &[Spot], view: &View) -> Self {
        let (width, height) = (view.camera.width, view.camera.height);
        let place = |(k, spot): (usize, &Spot)| {
            let x_in_camera = view.camera_from_world.transform(spot.x);
            let px = view.camera.project(x_in_camera)?;
            let inside =
                px.min_element() >= 0.0 && px.x < f64::from(width) && px.y < f64::from(height);
            inside.then(|| {
                (
                    px.y as usize * width as usize + px.x as usize,
                    k,
                    x_in_camera,
                )
            })
        };
        let mut placed: Vec<_> = spots.par_iter().enumerate().filter_map(place).collect();
        placed.sort_unstable_by_key(|&(pixel, k, _)| (pixel, k));
        let mut starts = vec![0; width as usize * height as usize + 1];
        placed
            .iter()
            .for_each(|&(pixel, ..)| starts[pixel + 1] += 1);
        (1..starts.len()).for_each(|k| starts[k] += starts[k - 1]);
        let (spots, x_in_camera) = placed.into_iter().map(|(_, k, x)| (k, x)).unzip();
        Self {
            width,
            starts,
            spots,
            x_in_camera,
        }
    }

    /// Places in the lists of the spots in a pixel.
    fn range(&self, column: u32, row: u32) -> std::ops::Range<usize> {
        let pixel = row as usize * self.width as usize + column as usize;
        self.starts[pixel]..self.starts[pixel + 1]
    }
}
