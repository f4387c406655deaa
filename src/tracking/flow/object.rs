use glam::{Affine2, Vec2};

use super::cells::Cells;
use super::change::Change;
use super::locate::Looks;
use super::motion::{Step, similarity};
use super::options::FlowOptions;
use super::picture::{ColorModel, Picture};
use super::plane::{Plane, median};
use ostra_masks::cut::{Borders, Window};
use ostra_masks::{Connectivity, LabelId, Region, components, squared_distance_to};

/// Pixels whose motion is looked at to find the object's.
const MOST_STEPS: usize = 800;
/// Cells across an object, about.
const CELLS_ACROSS: f32 = 10.0;
/// The most cells that an object is long: thin and scattered ones have larger cells.
const MOST_CELLS: usize = 48;
/// Frames over which the area is remembered.
const REMEMBERED: usize = 10;
/// How often a cut that grew too much is made again, and by how much the odds fall each time.
const TRIES: usize = 6;
const FALL: f32 = 0.3;
/// What trust a pixel keeps that was taken for background, and gains as part of the object.
const FORGIVEN: f32 = 0.6;
const GAINED: f32 = 0.1;
/// What trust a pixel loses that moves like the background, per unit of odds.
const LOST: f32 = 0.1;
/// Less than this of the area of late is too little to tell how the object moves.
const ENOUGH: f32 = 0.4;
/// Frames from the keyframe on over which its shape counts, where flow cannot be trusted, falls to 1/e.
const NEAR_STEPS: f32 = 5.0;
/// By how much of itself the search grows with every frame in which the object is not well seen.
const SEARCH_GROWTH: f32 = 0.1;
const WIDEST_SEARCH: f32 = 3.0;
/// How far the shape is expected where an object that was hidden seems to come back, 0–1.
const REAPPEARS: f32 = 0.6;
/// Power of a step's share in the confidence, fitted on the seven videos of `davis2016`: with it the confidence is their IoU
/// on average.
const FADE: f32 = 0.05;

/// An object on its way through the frames.
pub(super) struct Object {
    pub id: LabelId,
    mask: Region,
    /// How sure it is, 0–1, that each pixel came from the object in the keyframe.
    trust: Plane,
    /// Where the object is expected, 0–1, also where something hides it.
    expected: Plane,
    first_colors: ColorModel,
    last_colors: ColorModel,
    looks: Looks,
    cell_side: usize,
    centre: Vec2,
    /// How it moved last.
    motion: Affine2,
    areas: Vec<f32>,
    /// Frames since the keyframe.
    steps: usize,
    /// Frames since the object was last well seen, its shape then, and where that shape's centre was.
    hidden: usize,
    shape: Plane,
    shape_centre: Vec2,
    /// Product of the confidences of all steps since the keyframe.
    faith: f32,
    /// How alike the mask's colours are to the keyframe's, 0–1.
    likeness: f32,
}

/// What is known of an object in the next frame before its pixels are looked at one by one.
pub(super) struct Prediction {
    /// From the last frame to the next.
    pub motion: Affine2,
    pub centre: Vec2,
    /// The last mask pulled along the flow.
    pub warped: Plane,
    pub trust: Plane,
    pub expected: Plane,
    cells: Cells,
}

impl Object {
    /// The object of a keyframe; its region is at the working size and not empty.
    pub fn new(id: LabelId, region: Region, picture: &Picture) -> Self {
        let shape = Plane::of_mask(picture.width, picture.height, &region.inside);
        let colors = colors_of(picture, &region);
        let area = region.area() as f32;
        let cell_side = ((area.sqrt() / CELLS_ACROSS).round() as usize)
            .clamp(3, 10)
            .max(extent(&region) / MOST_CELLS);
        let centre = centre_of(&shape, 0.5).unwrap_or(Vec2::ZERO);
        let whole = picture.width.max(picture.height) as f32;
        let cells = Cells::new(picture, &colors.odds(), cell_side, centre, whole);
        let looks = Looks::new(&cells, &cells.means(&shape), centre);
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
            looks,
            cell_side,
            centre,
            motion: Affine2::IDENTITY,
            areas: vec![area],
            steps: 0,
            faith: 1.0,
            likeness: 1.0,
        }
    }

    /// Takes the colours of another keyframe into account.
    pub fn also_looks_like(&mut self, picture: &Picture, region: &Region) {
        self.first_colors.learn(&colors_of(picture, region), 0.5);
    }

    pub fn mask(&self) -> &Region {
        &self.mask
    }

    /// How near the keyframe still is, 1 at it and falling to 0.
    pub fn nearness(&self) -> f32 {
        (-(self.steps as f32) / NEAR_STEPS).exp()
    }

    /// How sure it is that the mask is right, 0–1; within a hundred frames of the keyframe about the IoU to be expected, from
    /// there on only an order. Errors add up along the way; where the colours are no longer the keyframe's, something else
    /// was taken. 0 where the object is not seen.
    pub fn confidence(&self) -> f32 {
        self.faith * self.likeness
    }

    pub fn expected(&self) -> &Plane {
        &self.expected
    }

    /// Pixels of the expected shape, at least 1.
    pub fn area(&self) -> f32 {
        (self
            .expected
            .values
            .iter()
            .filter(|&&value| value > SHAPE)
            .count() as f32)
            .max(1.0)
    }

    /// Median area in the last frames that showed the object well, in pixels, at least 1.
    fn usual_area(&self) -> f32 {
        median(self.areas.iter().copied()).max(1.0)
    }

    /// Odds by colour bin: in the keyframes, and of late.
    pub fn color_odds(&self) -> (Vec<f32>, Vec<f32>) {
        (self.first_colors.odds(), self.last_colors.odds())
    }

    /// Where the object should be in the next frame: by flow, and by its looks where these say otherwise.
    pub fn predict(&mut self, change: &Change, options: &FlowOptions) -> Prediction {
        let (mut motion, zoom) = self.motion_by_flow(change);
        let centre = centre_of(&self.expected, 0.5).unwrap_or(self.centre);
        let wider = (1.0 + SEARCH_GROWTH * self.hidden as f32).min(WIDEST_SEARCH);
        let reach = wider * options.search * self.usual_area().sqrt() + 3.0 * self.cell_side as f32;
        let predicted = motion.transform_point2(centre);
        let cells = self.cells(&change.next, predicted, reach);
        let shape = if self.hidden > 0 {
            (&self.shape, self.shape_centre)
        } else {
            (&self.expected, centre)
        };
        let place = self.looks.find(
            &cells,
            (&cells.means(shape.0), shape.1),
            predicted,
            zoom,
            reach,
        );
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

    /// The cells that matter when the object is looked for at most `reach_px` from a place.
    fn cells(&self, picture: &Picture, place: Vec2, reach_px: f32) -> Cells {
        let (first, last) = self.color_odds();
        let odds: Vec<f32> = first
            .iter()
            .zip(&last)
            .map(|(first, last)| 0.6 * first + 0.4 * last)
            .collect();
        let looks = ((self.looks.radius() + 1) * self.cell_side) as f32;
        Cells::new(picture, &odds, self.cell_side, place, reach_px + looks)
    }

    /// The similarity that the object's reliable pixels follow, or their shift; as last time where there are too few.
    /// With it its zoom.
    fn motion_by_flow(&mut self, change: &Change) -> (Affine2, f32) {
        let width = change.next.width;
        let own: Vec<usize> = (0..self.mask.inside.len())
            .filter(|&at| self.mask.inside[at])
            .collect();
        let every = own.len().div_ceil(MOST_STEPS).max(1);
        let steps = own.into_iter().step_by(every).filter_map(|at| {
            let from = Vec2::new((at % width) as f32, (at / width) as f32);
            let vector = change.forward.vectors[at];
            let back = change.backward.sample(from + vector);
            let sure = (vector + back).length() < 1.5 + 0.1 * vector.length();
            sure.then_some(Step {
                from,
                to: from + vector,
            })
        });
        let steps: Vec<Step> = steps.collect();
        if self.hidden > 0 {
            return (self.motion, 1.0);
        }
        if steps.len() > 15 {
            let shift = Vec2::new(
                median(steps.iter().map(|step| step.to.x - step.from.x)),
                median(steps.iter().map(|step| step.to.y - step.from.y)),
            );
            let found = similarity(&steps, 3.0)
                .filter(|(motion, share)| *share > 0.4 && (zoom(motion) - 1.0).abs() < 0.1);
            self.motion = found.map_or(Affine2::from_translation(shift), |(motion, _)| motion);
        }
        (self.motion, zoom(&self.motion))
    }

    /// Decides which pixels are the object's by the evidence.
    pub fn decide(
        &self,
        prediction: &Prediction,
        evidence: &Evidence,
        picture: &Picture,
        options: &FlowOptions,
    ) -> Region {
        let mut mask = Region::empty(picture.width as u32, picture.height as u32);
        if evidence.odds.is_empty() {
            return mask;
        }
        let borders = Borders::new(
            &picture.lab,
            picture.width,
            evidence.window,
            options.outline_weight,
        );
        let most = options.most_growth * self.usual_area();
        for round in 0..=TRIES {
            let inside = borders.cut(&evidence.odds, -FALL * round as f32);
            for (at, inside) in evidence.window.places(picture.width).zip(inside) {
                mask.inside[at] = inside;
            }
            keep_expected(&mut mask, &prediction.expected, SHAPE);
            if mask.area() as f32 <= most {
                break;
            }
        }
        mask
    }

    /// How far the mask of this frame is to be believed given that the last one was right, 0–1.
    fn step_confidence(
        &self,
        mask: &Region,
        prediction: &Prediction,
        change: &Change,
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

    /// Brings trust and expectation up to date.
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

    /// Makes a decided mask the object's, and learns from it.
    pub fn settle(
        &mut self,
        mask: Region,
        prediction: &Prediction,
        evidence: &Evidence,
        change: &Change,
        options: &FlowOptions,
    ) {
        let picture = &change.next;
        self.steps += 1;
        let well_seen = mask.area() as f32 > ENOUGH * self.usual_area();
        self.hidden = if well_seen { 0 } else { self.hidden + 1 };
        if well_seen {
            self.areas.push(mask.area() as f32);
            self.areas
                .drain(..self.areas.len().saturating_sub(REMEMBERED));
            self.shape = Plane::of_mask(picture.width, picture.height, &mask.inside);
            self.shape_centre = prediction.centre;
        }
        self.remember(&mask, prediction, evidence, options);
        self.centre = prediction.centre;
        self.likeness = 0.0;
        if !mask.is_empty() {
            let colors = colors_of(picture, &mask);
            self.likeness = self.first_colors.likeness(&colors);
            self.faith *= self.step_confidence(&mask, prediction, change, self.likeness);
            self.last_colors.learn(&colors, options.color_rate);
        }
        if well_seen {
            let mut share = self.expected.clone();
            for (share, &inside) in share.values.iter_mut().zip(&mask.inside) {
                *share = if inside { 1.0 } else { 0.5 * *share };
            }
            self.looks.learn(
                &prediction.cells,
                &prediction.cells.means(&share),
                self.centre,
            );
        }
        self.mask = mask;
    }
}

/// The longer side of the rectangle around a region, in pixels.
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

/// By how much a similarity enlarges.
fn zoom(motion: &Affine2) -> f32 {
    motion.matrix2.x_axis.length()
}

/// The mean position of the pixels above a level.
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

/// The colours of a region and of what lies around it.
fn colors_of(picture: &Picture, region: &Region) -> ColorModel {
    let reach = 0.3 * (region.area() as f32).sqrt() + 6.0;
    let near = (reach * reach) as u32;
    let around: Vec<bool> = squared_distance_to(region)
        .into_iter()
        .map(|d| d > 0 && d <= near)
        .collect();
    ColorModel::new(&picture.bins, &region.inside, &around)
}

/// A piece of a mask stays only if at least this share of it lies where the object is expected.
const EXPECTED: f32 = 0.1;
/// Pieces of fewer pixels go.
const LEAST: usize = 8;

/// Takes away pieces that lie elsewhere than the object, whose expected shape is where `expected` is above `level`, and
/// specks, unless the whole object is one.
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

/// What speaks for and against each pixel of a window being an object's.
pub(super) struct Evidence {
    pub window: Window,
    /// Natural logarithm of the odds, row by row.
    pub odds: Vec<f32>,
    /// What of them, not weighed yet, the motion says.
    pub motion: Vec<f32>,
}

/// The expected shape is where the expectation is above this.
pub(super) const SHAPE: f32 = 0.4;
