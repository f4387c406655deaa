use glam::{Affine2, Vec2};

use super::cells::FeatureCells;
use super::change::FrameChange;
use super::locate::{ExpectedShape, ObjectAppearance};
use super::motion::{PointMatch, similarity};
use super::options::FlowOptions;
use super::plane::{Plane, median};
use super::tracked_image::{ColorModel, TrackedImage};
use ostra_masks::cut::{Borders, PixelWindow};
use ostra_masks::{Connectivity, LabelId, Region, components, squared_distance_to};

/// Maximum number of pixels sampled to estimate the object's motion.
const MOST_STEPS: usize = 800;
/// Approximate number of cells across an object.
const CELLS_ACROSS: f32 = 10.0;
/// Maximum number of cells along an object; thin and scattered objects get larger cells.
const MOST_CELLS: usize = 48;
/// Number of frames over which the area is remembered.
const REMEMBERED: usize = 10;
/// Number of repeated cuts if the area grows too much, and the decrease in odds per cut.
const TRIES: usize = 6;
const FALL: f32 = 0.3;
/// Factor on the trust of a pixel outside the mask, and gain of a pixel inside.
const FORGIVEN: f32 = 0.6;
const GAINED: f32 = 0.1;
/// Loss of trust of a pixel that moves like the background, per unit of log-odds.
const LOST: f32 = 0.1;
/// Share of the recent area below which the object is not well visible.
const ENOUGH: f32 = 0.4;
/// Number of frames after which the weight of the keyframe's shape falls to 1/e.
const NEAR_STEPS: f32 = 5.0;
/// Relative growth of the search radius per frame without a good view, and its limit.
const SEARCH_GROWTH: f32 = 0.1;
const WIDEST_SEARCH: f32 = 3.0;
/// Expectation of the shape where a hidden object seems to reappear, 0–1.
const REAPPEARS: f32 = 0.6;
/// Exponent of a step's factor in the confidence.
///
/// Fitted on the seven videos of `davis2016`: with it, the confidence is their IoU on average.
const FADE: f32 = 0.05;

/// State of a tracked object.
pub(super) struct TrackedObject {
    pub id: LabelId,
    mask: Region,
    /// Confidence that each pixel came from the object in the keyframe, 0–1.
    trust: Plane,
    /// Where the object is expected, 0–1, including hidden parts.
    expected: Plane,
    first_colors: ColorModel,
    last_colors: ColorModel,
    appearance: ObjectAppearance,
    cell_side: usize,
    centre: Vec2,
    /// Latest motion.
    motion: Affine2,
    areas: Vec<f32>,
    /// Frames since the keyframe.
    steps: usize,
    /// Frames since the object was last well visible, with its shape and that shape's centre.
    hidden: usize,
    shape: Plane,
    shape_centre: Vec2,
    /// Product of the confidences of all steps since the keyframe.
    faith: f32,
    /// Similarity of the mask's colours to the keyframe's, 0–1.
    likeness: f32,
}

/// Prediction of an object in the next frame, before its pixels are decided.
pub(super) struct Prediction {
    /// Motion from the last frame to the next.
    pub motion: Affine2,
    pub centre: Vec2,
    /// The last mask, warped by the flow.
    pub warped: Plane,
    pub trust: Plane,
    pub expected: Plane,
    cells: FeatureCells,
}

impl TrackedObject {
    /// Starts tracking the object of a keyframe.
    ///
    /// `region` has the working size and is not empty.
    pub fn new(id: LabelId, region: Region, image: &TrackedImage) -> Self {
        let shape = Plane::of_mask(image.width, image.height, &region.inside);
        let colors = colors_of(image, &region);
        let area = region.area() as f32;
        let cell_side = ((area.sqrt() / CELLS_ACROSS).round() as usize)
            .clamp(3, 10)
            .max(extent(&region) / MOST_CELLS);
        let centre = centre_of(&shape, 0.5).unwrap_or(Vec2::ZERO);
        let whole = image.width.max(image.height) as f32;
        let cells = FeatureCells::new(image, &colors.odds(), cell_side, centre, whole);
        let appearance = ObjectAppearance::new(&cells, &cells.means(&shape), centre);
        Self {
            id,
            mask: region,
            trust: shape.clone(),
            hidden: 0,
            shape_centre: centre,
            expected: shape.clone(),
            shape,
            last_colors: colors.clone(),
            first_colors: colors,
            appearance,
            cell_side,
            centre,
            motion: Affine2::IDENTITY,
            areas: vec![area],
            steps: 0,
            faith: 1.0,
            likeness: 1.0,
        }
    }

    /// Learns the colours of another keyframe.
    pub fn add_appearance(&mut self, image: &TrackedImage, region: &Region) {
        self.first_colors.learn(&colors_of(image, region), 0.5);
    }

    pub fn mask(&self) -> &Region {
        &self.mask
    }

    /// Returns the proximity to the keyframe: 1 at the keyframe, falling to 0.
    pub fn nearness(&self) -> f32 {
        (-(self.steps as f32) / NEAR_STEPS).exp()
    }

    /// Returns the confidence in the mask, 0–1; 0 if the object is not visible.
    ///
    /// Within a hundred frames of the keyframe it is about the expected IoU; beyond that it is only
    /// a ranking. Errors accumulate from frame to frame. If the colours differ from the keyframe's,
    /// the tracker has probably switched to something else.
    pub fn confidence(&self) -> f32 {
        self.faith * self.likeness
    }

    pub fn expected(&self) -> &Plane {
        &self.expected
    }

    /// Returns the number of pixels of the expected shape, at least 1.
    pub fn area(&self) -> f32 {
        (self
            .expected
            .values
            .iter()
            .filter(|&&value| value > SHAPE)
            .count() as f32)
            .max(1.0)
    }

    /// Returns the median area in the last frames with a good view, in pixels, at least 1.
    fn usual_area(&self) -> f32 {
        median(self.areas.iter().copied()).max(1.0)
    }

    /// Returns the odds by colour bin: of the keyframes and of recent frames.
    pub fn color_odds(&self) -> (Vec<f32>, Vec<f32>) {
        (self.first_colors.odds(), self.last_colors.odds())
    }

    /// Predicts the object in the next frame, by flow and corrected by its appearance.
    pub fn predict(&mut self, change: &FrameChange, options: &FlowOptions) -> Prediction {
        let (mut motion, zoom) = self.motion_by_flow(change);
        let centre = centre_of(&self.expected, 0.5).unwrap_or(self.centre);
        let wider = (1.0 + SEARCH_GROWTH * self.hidden as f32).min(WIDEST_SEARCH);
        let reach = wider * options.search * self.usual_area().sqrt() + 3.0 * self.cell_side as f32;
        let predicted = motion.transform_point2(centre);
        let cells = self.cells(&change.next, predicted, reach);
        let (shape, shape_centre) = if self.hidden > 0 {
            (&self.shape, self.shape_centre)
        } else {
            (&self.expected, centre)
        };
        let shape = ExpectedShape {
            share: &cells.means(shape),
            centre: shape_centre,
        };
        let place = self.appearance.find(&cells, &shape, predicted, zoom, reach);
        if place.corrected {
            if self.hidden == 0 {
                self.motion = Affine2::from_translation(place.centre - centre);
            }
            motion = Affine2::from_scale(Vec2::splat(zoom));
            motion.translation = place.centre - zoom * centre;
        }
        let mask = Plane::of_mask(
            self.mask.width as usize,
            self.mask.height as usize,
            &self.mask.inside,
        );
        let warped = mask.pulled(&change.backward);
        let trust = self.trust.pulled(&change.backward);
        let mut expected = self.expected.moved(motion);
        for (at, value) in expected.values.iter_mut().enumerate() {
            *value = value.max(warped.values[at].min(trust.values[at] + 0.2));
        }
        if place.is_like && self.hidden > 0 {
            let back = self
                .shape
                .moved(Affine2::from_translation(place.centre - self.shape_centre));
            let reappears = |(value, back): (&mut f32, &f32)| *value = value.max(REAPPEARS * back);
            expected
                .values
                .iter_mut()
                .zip(&back.values)
                .for_each(reappears);
        }
        Prediction {
            motion,
            centre: place.centre,
            warped,
            trust,
            expected,
            cells,
        }
    }

    /// Computes the cells needed to search within `reach_px` of a position.
    fn cells(&self, image: &TrackedImage, place: Vec2, reach_px: f32) -> FeatureCells {
        let (first, last) = self.color_odds();
        let odds: Vec<f32> = first
            .iter()
            .zip(&last)
            .map(|(first, last)| 0.6 * first + 0.4 * last)
            .collect();
        let appearance = ((self.appearance.radius() + 1) * self.cell_side) as f32;
        FeatureCells::new(image, &odds, self.cell_side, place, reach_px + appearance)
    }

    /// Estimates the object's similarity transform by flow, and its zoom.
    ///
    /// Falls back to the median shift, and to the last motion if too few pixels are reliable.
    fn motion_by_flow(&mut self, change: &FrameChange) -> (Affine2, f32) {
        let width = change.next.width;
        let own: Vec<usize> = (0..self.mask.inside.len())
            .filter(|&at| self.mask.inside[at])
            .collect();
        let every = own.len().div_ceil(MOST_STEPS).max(1);
        let matches = own.into_iter().step_by(every).filter_map(|at| {
            let from = Vec2::new((at % width) as f32, (at / width) as f32);
            let vector = change.forward.vectors[at];
            let back = change.backward.sample(from + vector);
            let confidence = (vector + back).length() < 1.5 + 0.1 * vector.length();
            confidence.then_some(PointMatch {
                from,
                to: from + vector,
            })
        });
        let matches: Vec<PointMatch> = matches.collect();
        if self.hidden > 0 {
            return (self.motion, 1.0);
        }
        if matches.len() > 15 {
            let shift = Vec2::new(
                median(matches.iter().map(|pair| pair.to.x - pair.from.x)),
                median(matches.iter().map(|pair| pair.to.y - pair.from.y)),
            );
            let found = similarity(&matches, 3.0)
                .filter(|(motion, share)| *share > 0.4 && (zoom(motion) - 1.0).abs() < 0.1);
            self.motion = found.map_or(Affine2::from_translation(shift), |(motion, _)| motion);
        }
        (self.motion, zoom(&self.motion))
    }

    /// Decides which pixels belong to the object.
    pub fn decide(
        &self,
        prediction: &Prediction,
        evidence: &Evidence,
        image: &TrackedImage,
        options: &FlowOptions,
    ) -> Region {
        let mut mask = Region::empty(image.width as u32, image.height as u32);
        if evidence.odds.is_empty() {
            return mask;
        }
        let borders = Borders::new(
            &image.lab,
            image.width,
            evidence.window,
            options.outline_weight,
        );
        let most = options.most_growth * self.usual_area();
        for round in 0..=TRIES {
            let inside = borders.cut(&evidence.odds, -FALL * round as f32);
            for (at, inside) in evidence.window.places(image.width).zip(inside) {
                mask.inside[at] = inside;
            }
            keep_expected(&mut mask, &prediction.expected, SHAPE);
            if mask.area() as f32 <= most {
                break;
            }
        }
        mask
    }

    /// Returns the confidence in this frame's mask, given that the last one was right, 0–1.
    fn step_confidence(
        &self,
        mask: &Region,
        prediction: &Prediction,
        change: &FrameChange,
        colors: f32,
    ) -> f32 {
        let area = mask.area() as f32;
        let mean = |plane: &Plane| {
            let inside = plane
                .values
                .iter()
                .zip(&mask.inside)
                .filter(|(_, inside)| **inside);
            inside.map(|(value, _)| value).sum::<f32>() / area
        };
        let usual = self.usual_area();
        let size = (area / usual).min(usual / area);
        (mean(&change.reliable) * mean(&prediction.trust) * colors * size).powf(FADE)
    }

    /// Updates trust and expectation.
    fn remember(
        &mut self,
        mask: &Region,
        prediction: &Prediction,
        evidence: &Evidence,
        options: &FlowOptions,
    ) {
        let mut strange = vec![0.0f32; mask.inside.len()];
        for (at, motion) in evidence
            .window
            .places(mask.width as usize)
            .zip(&evidence.motion)
        {
            strange[at] = (-motion).max(0.0);
        }
        for (at, &inside) in mask.inside.iter().enumerate() {
            let trust = prediction.trust.values[at];
            self.trust.values[at] = if inside {
                let trust = trust.max(options.trust_of_new);
                let gained = if strange[at] > 0.0 {
                    0.0
                } else {
                    GAINED * (1.0 - trust)
                };
                (trust + gained) * (1.0 - LOST * strange[at])
            } else {
                FORGIVEN * trust
            };
            let seen = if inside { self.trust.values[at] } else { 0.0 };
            self.expected.values[at] = seen.max(options.memory * prediction.expected.values[at]);
        }
    }

    /// Accepts a decided mask and learns from it.
    pub fn settle(
        &mut self,
        mask: Region,
        prediction: &Prediction,
        evidence: &Evidence,
        change: &FrameChange,
        options: &FlowOptions,
    ) {
        let image = &change.next;
        self.steps += 1;
        let well_seen = mask.area() as f32 > ENOUGH * self.usual_area();
        self.hidden = if well_seen { 0 } else { self.hidden + 1 };
        if well_seen {
            self.areas.push(mask.area() as f32);
            self.areas
                .drain(..self.areas.len().saturating_sub(REMEMBERED));
            self.shape = Plane::of_mask(image.width, image.height, &mask.inside);
            self.shape_centre = prediction.centre;
        }
        self.remember(&mask, prediction, evidence, options);
        self.centre = prediction.centre;
        self.likeness = 0.0;
        if !mask.is_empty() {
            let colors = colors_of(image, &mask);
            self.likeness = self.first_colors.likeness(&colors);
            self.faith *= self.step_confidence(&mask, prediction, change, self.likeness);
            self.last_colors.learn(&colors, options.color_rate);
        }
        if well_seen {
            let mut share = self.expected.clone();
            for (share, &inside) in share.values.iter_mut().zip(&mask.inside) {
                *share = if inside { 1.0 } else { 0.5 * *share };
            }
            self.appearance.learn(
                &prediction.cells,
                &prediction.cells.means(&share),
                self.centre,
            );
        }
        self.mask = mask;
    }
}

/// Returns the longer side of a region's bounding box, in pixels.
fn extent(region: &Region) -> usize {
    let width = region.width as usize;
    let inside = || (0..region.inside.len()).filter(|&at| region.inside[at]);
    let length = |of: &dyn Fn(usize) -> usize| {
        let (least, most) = inside()
            .map(of)
            .fold((usize::MAX, 0), |(a, b), at| (a.min(at), b.max(at)));
        most.saturating_sub(least) + 1
    };
    length(&|at| at % width).max(length(&|at| at / width))
}

/// Returns the scale factor of a similarity transform.
fn zoom(motion: &Affine2) -> f32 {
    motion.matrix2.x_axis.length()
}

/// Returns the mean position of the pixels above a level.
fn centre_of(plane: &Plane, level: f32) -> Option<Vec2> {
    let (mut sum, mut count) = (glam::DVec2::ZERO, 0usize);
    for (at, _) in plane
        .values
        .iter()
        .enumerate()
        .filter(|(_, value)| **value > level)
    {
        sum += glam::DVec2::new((at % plane.width) as f64, (at / plane.width) as f64);
        count += 1;
    }
    (count > 0).then(|| (sum / count as f64).as_vec2())
}

/// Learns the colours of a region and its surroundings.
fn colors_of(image: &TrackedImage, region: &Region) -> ColorModel {
    let reach = 0.3 * (region.area() as f32).sqrt() + 6.0;
    let near = (reach * reach) as u32;
    let around: Vec<bool> = squared_distance_to(region)
        .into_iter()
        .map(|d| d > 0 && d <= near)
        .collect();
    ColorModel::new(&image.bins, &region.inside, &around)
}

/// Minimum share of a fragment that must lie in the expected shape.
const EXPECTED: f32 = 0.1;
/// Minimum number of pixels of a fragment.
const LEAST: usize = 8;

/// Removes specks and fragments away from the object.
///
/// The expected shape is where `expected` is above `level`. An object that consists of one speck is
/// kept.
fn keep_expected(mask: &mut Region, expected: &Plane, level: f32) {
    let found = components(mask, Connectivity::Eight);
    let mut common = vec![0usize; found.areas.len()];
    for (&label, &expected) in found.labels.iter().zip(&expected.values) {
        if label > 0 && expected > level {
            common[label as usize - 1] += 1;
        }
    }
    let least = LEAST.min(found.areas.iter().copied().max().unwrap_or(0));
    let keep = |piece: usize| {
        let area = found.areas[piece];
        area >= least && common[piece] as f32 > EXPECTED * area as f32
    };
    let kept: Vec<bool> = (0..found.areas.len()).map(keep).collect();
    for (inside, &label) in mask.inside.iter_mut().zip(&found.labels) {
        *inside = label > 0 && kept[label as usize - 1];
    }
}

/// Evidence for and against each pixel of a window belonging to an object.
pub(super) struct Evidence {
    pub window: PixelWindow,
    /// Log-odds, row by row.
    pub odds: Vec<f32>,
    /// Contribution of the motion to the odds, before its weight.
    pub motion: Vec<f32>,
}

/// Expectation above which a pixel belongs to the expected shape.
pub(super) const SHAPE: f32 = 0.4;
