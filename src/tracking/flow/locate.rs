use glam::Vec2;
use rayon::prelude::*;

use super::cells::{FEATURES, FeatureCells, ODDS};
use super::plane::Plane;
use ostra_core::image::bilinear_weights;

/// Weights of recent appearance, keyframe appearance, colours and distance.
const LAST: f32 = 1.0;
const FIRST: f32 = 0.3;
const COLORS: f32 = 1.5;
const DISTANCE: f32 = 0.5;
/// Minimum gain in score for a place to replace the predicted one.
const MARGIN: f32 = 0.1;
/// Distance in cells below which the prediction is more exact than a cell.
const NEAR: f32 = 1.2;
/// Limits on contrast and difference relative to the usual, for a place to be the object.
const LEAST_CONTRAST: f32 = 0.6;
const MOST_DIFFERENCE: f32 = 2.0;
/// Rate at which the recent appearance adapts to each new frame.
const RATE: f32 = 0.08;

/// Appearance of an object in cells around its centre, with each cell's weight.
#[derive(Clone)]
struct Template {
    radius: usize,
    features: Vec<[f32; FEATURES]>,
    weights: Vec<f32>,
}

/// An object's appearance in its keyframe and in recent frames.
pub(super) struct ObjectAppearance {
    first: Template,
    last: Template,
    /// Size of the object relative to that in the keyframe.
    size: f32,
    /// Fit at the last place where the object was well visible; `None` at first.
    usual: Option<ObjectFit>,
}

/// How well a place fits the object.
#[derive(Debug, Clone, Copy)]
struct ObjectFit {
    /// Odds of the colours inside minus those around.
    contrast: f32,
    /// Mean squared difference of features from the recent appearance.
    difference: f32,
    /// Mean squared difference from the keyframe appearance.
    first: f32,
}

impl ObjectFit {
    fn score(&self) -> f32 {
        COLORS * self.contrast - LAST * self.difference - FIRST * self.first
    }

    /// Returns whether this may be the object that fitted with `usual` before.
    fn is_like(&self, usual: &Self) -> bool {
        self.contrast > LEAST_CONTRAST * usual.contrast
            && self.difference < MOST_DIFFERENCE * usual.difference + 0.5
    }
}

/// Templates scaled to a frame, with the contrast weights of the shape.
struct ScaledTemplates {
    first: Template,
    last: Template,
    shape: Template,
    contrast: Vec<f32>,
}

impl ScaledTemplates {
    fn fit(&self, cells: &FeatureCells, x: isize, y: isize) -> ObjectFit {
        let odds = (0..self.contrast.len())
            .filter(|&at| self.contrast[at] != 0.0)
            .map(|at| {
                let (dx, dy) = self.shape.offset(at);
                self.contrast[at] * cells.at(x + dx, y + dy)[ODDS]
            });
        ObjectFit {
            contrast: odds.sum(),
            difference: self.last.difference(cells, x, y),
            first: self.first.difference(cells, x, y),
        }
    }
}

/// Position of an object in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ObjectPlace {
    /// Centre of the object in pixels.
    pub centre: Vec2,
    /// Whether it differs from the predicted position.
    pub corrected: bool,
    /// Whether the place resembles the object.
    pub is_like: bool,
}

impl Template {
    fn new(cells: &FeatureCells, share: &Plane, centre: Vec2, radius: usize) -> Self {
        let side = 2 * radius + 1;
        let middle = cells.of_pixel(centre);
        let offset =
            |at: usize| middle + Vec2::new((at % side) as f32, (at / side) as f32) - radius as f32;
        let features = (0..side * side)
            .map(|at| between(cells, offset(at)))
            .collect();
        let inside = |p: Vec2| {
            p.x > -1.0 && p.y > -1.0 && p.x < share.width as f32 && p.y < share.height as f32
        };
        let weight = |at: usize| {
            Some(offset(at))
                .filter(|&p| inside(p))
                .map_or(0.0, |p| share.sample(p))
        };
        Self {
            radius,
            features,
            weights: (0..side * side).map(weight).collect(),
        }
    }

    /// Returns the template enlarged by `zoom`.
    fn scaled(&self, zoom: f32) -> Self {
        let side = 2 * self.radius + 1;
        let nearest = |at: usize| {
            let offset = Vec2::new((at % side) as f32, (at / side) as f32) - self.radius as f32;
            let source = (offset / zoom + self.radius as f32)
                .round()
                .clamp(Vec2::ZERO, Vec2::splat(side as f32 - 1.0));
            source.y as usize * side + source.x as usize
        };
        Self {
            radius: self.radius,
            features: (0..side * side)
                .map(|at| self.features[nearest(at)])
                .collect(),
            weights: (0..side * side)
                .map(|at| self.weights[nearest(at)])
                .collect(),
        }
    }

    fn learn(&mut self, other: &Self) {
        for (mine, other) in self.features.iter_mut().zip(&other.features) {
            mine.iter_mut()
                .zip(other)
                .for_each(|(mine, other)| *mine += RATE * (other - *mine));
        }
        self.weights
            .iter_mut()
            .zip(&other.weights)
            .for_each(|(mine, other)| *mine += RATE * (other - *mine));
    }

    /// Returns the weighted mean squared difference of features with the centre at a cell.
    fn difference(&self, cells: &FeatureCells, x: isize, y: isize) -> f32 {
        let (mut sum, mut weights) = (0.0, 1e-6);
        for (at, (features, &weight)) in self.features.iter().zip(&self.weights).enumerate() {
            if weight > 0.02 {
                let (dx, dy) = self.offset(at);
                let seen = cells.at(x + dx, y + dy);
                let distance: f32 = (0..FEATURES).map(|k| (features[k] - seen[k]).powi(2)).sum();
                sum += weight * (distance - (features[ODDS] - seen[ODDS]).powi(2));
                weights += weight;
            }
        }
        sum / weights
    }

    fn offset(&self, at: usize) -> (isize, isize) {
        let side = 2 * self.radius + 1;
        (
            (at % side) as isize - self.radius as isize,
            (at / side) as isize - self.radius as isize,
        )
    }

    /// Returns weights that are positive on the shape and negative on a ring around it.
    ///
    /// Both parts sum to one. The sum of the colour odds with these weights is the contrast: how
    /// much better the odds are inside than around.
    fn contrast(&self) -> Vec<f32> {
        let near = dilated(&self.weights, 2 * self.radius + 1, self.radius / 3);
        let ring: Vec<f32> = near
            .iter()
            .zip(&self.weights)
            .map(|(near, own)| (near - own).clamp(0.0, 1.0))
            .collect();
        let (own, around) = (
            self.weights.iter().sum::<f32>() + 1e-6,
            ring.iter().sum::<f32>() + 1e-6,
        );
        self.weights
            .iter()
            .zip(&ring)
            .map(|(weight, ring)| weight / own - ring / around)
            .collect()
    }
}

/// The shape that an object is expected to have in a grid of cells.
pub(super) struct ExpectedShape<'a> {
    /// Share of each cell that the object covers.
    pub share: &'a Plane,
    /// Centre of the object, in pixels.
    pub centre: Vec2,
}

impl ObjectAppearance {
    /// Learns the appearance of an object at `centre`; `share` is its part of each cell.
    pub fn new(cells: &FeatureCells, share: &Plane, centre: Vec2) -> Self {
        let middle = cells.of_pixel(centre);
        let own = (0..share.values.len()).filter(|&at| share.values[at] > 0.1);
        let extent = own.map(|at| {
            let cell = Vec2::new((at % share.width) as f32, (at / share.width) as f32);
            (cell - middle).abs().max_element()
        });
        let radius = (extent.fold(1.0, f32::max) * 1.15).ceil() as usize + 1;
        let template = Template::new(cells, share, centre, radius);
        Self {
            first: template.clone(),
            last: template,
            size: 1.0,
            usual: None,
        }
    }

    /// Finds the object, at most `reach_px` from `predicted`.
    ///
    /// `zoom` is its growth since the last frame.
    pub fn find(
        &mut self,
        cells: &FeatureCells,
        shape: &ExpectedShape<'_>,
        predicted: Vec2,
        zoom: f32,
        reach_px: f32,
    ) -> ObjectPlace {
        self.size *= zoom;
        self.last = self.last.scaled(zoom);
        let ready = self.ready(cells, shape, zoom);
        let middle = cells.of_pixel(predicted);
        let reach = reach_px / cells.side as f32;
        let score = |fit: &ObjectFit, x: isize, y: isize| {
            let away = Vec2::new(x as f32, y as f32).distance_squared(middle) / (reach * reach);
            fit.score() - DISTANCE * away
        };
        let candidates = within(cells, middle, reach).into_par_iter().map(|(x, y)| {
            let fit = ready.fit(cells, x, y);
            (score(&fit, x, y), fit, (x, y))
        });
        let scored: Vec<(f32, ObjectFit, (isize, isize))> = candidates.collect();
        let best = scored
            .into_iter()
            .reduce(|best, next| if next.0 > best.0 { next } else { best });
        let Some((value, fit, (x, y))) = best else {
            return ObjectPlace {
                centre: predicted,
                corrected: false,
                is_like: false,
            };
        };
        let (found, there) = (Vec2::new(x as f32, y as f32), middle.round());
        let (there_x, there_y) = (there.x as isize, there.y as isize);
        let predicted_fit = ready.fit(cells, there_x, there_y);
        let is_like = |fit: &ObjectFit| self.usual.is_none_or(|usual| fit.is_like(&usual));
        let better = found.distance(middle) > NEAR
            && value > score(&predicted_fit, there_x, there_y) + MARGIN;
        if better && is_like(&fit) {
            ObjectPlace {
                centre: cells.to_pixel(found),
                corrected: true,
                is_like: true,
            }
        } else {
            ObjectPlace {
                centre: predicted,
                corrected: false,
                is_like: is_like(&predicted_fit),
            }
        }
    }

    fn ready(&self, cells: &FeatureCells, shape: &ExpectedShape<'_>, zoom: f32) -> ScaledTemplates {
        let shape = Template::new(cells, shape.share, shape.centre, self.last.radius).scaled(zoom);
        let contrast = shape.contrast();
        ScaledTemplates {
            first: self.first.scaled(self.size),
            last: self.last.clone(),
            shape,
            contrast,
        }
    }

    /// Returns the radius of the templates in cells.
    pub fn radius(&self) -> usize {
        self.last.radius
    }

    /// Updates the recent appearance from a frame that shows the object well.
    pub fn learn(&mut self, cells: &FeatureCells, share: &Plane, centre: Vec2) {
        let ready = self.ready(cells, &ExpectedShape { share, centre }, 1.0);
        let at = cells.of_pixel(centre).round();
        self.usual = Some(ready.fit(cells, at.x as isize, at.y as isize));
        self.last.learn(&ready.shape);
    }
}

/// Returns the maximum of a square array within `reach` columns and rows.
fn dilated(values: &[f32], side: usize, reach: usize) -> Vec<f32> {
    let along = |values: &[f32], step: usize| -> Vec<f32> {
        let most = |at: usize| {
            let place = at / step % side;
            let (before, after) = (place.min(reach), (side - 1 - place).min(reach));
            (at - before * step..=at + after * step)
                .step_by(step)
                .map(|at| values[at])
                .fold(0.0, f32::max)
        };
        (0..values.len()).map(most).collect()
    };
    along(&along(values, 1), side)
}

/// Returns the cells of the image at most `reach` from a position.
fn within(cells: &FeatureCells, middle: Vec2, reach: f32) -> Vec<(isize, isize)> {
    let span = |centre: f32, count: usize| {
        let first = (centre - reach).ceil().max(0.0) as isize;
        let last = (centre + reach).floor().min(count as f32 - 1.0) as isize;
        first..=last
    };
    span(middle.y, cells.rows)
        .flat_map(|y| span(middle.x, cells.columns).map(move |x| (x, y)))
        .filter(|&(x, y)| Vec2::new(x as f32, y as f32).distance(middle) <= reach)
        .collect()
}

/// Interpolates the features between four cells.
fn between(cells: &FeatureCells, at: Vec2) -> [f32; FEATURES] {
    let low = at.floor();
    let (u, v) = (at.x - low.x, at.y - low.y);
    let (x, y) = (low.x as isize, low.y as isize);
    let corners = [(0, 0), (1, 0), (0, 1), (1, 1)];
    let mut sum = [0.0; FEATURES];
    for ((dx, dy), weight) in corners.into_iter().zip(bilinear_weights([u, v])) {
        for (sum, value) in sum.iter_mut().zip(cells.at(x + dx, y + dy)) {
            *sum += weight * value;
        }
    }
    sum
}
