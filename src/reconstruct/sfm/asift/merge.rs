use std::collections::BTreeMap;

use glam::DVec2;
use rustc_hash::{FxHashMap, FxHashSet};

use crate::sfm::{Descriptors, Features, ImageFeatures};

/// Keypoints nearer to each other than this, in pixels, are one.
const RADIUS_PX: f64 = 1.5;

/// An image's features merged with those of some of its tilted views, each position once.
#[derive(Debug, Clone)]
pub struct Merged {
    /// The image's own features first, in their order.
    image: ImageFeatures,
    /// Numbers of the keypoints in squares as wide as the radius.
    squares: FxHashMap<[i64; 2], Vec<u32>>,
}

impl Merged {
    /// Starts with the image's own features only.
    pub fn new(own: &ImageFeatures) -> Self {
        let mut merged = Self {
            image: own.clone(),
            squares: FxHashMap::default(),
        };
        for (number, &at_px) in (0..).zip(&own.features.keypoints) {
            merged
                .squares
                .entry(square(at_px))
                .or_default()
                .push(number);
        }
        merged
    }

    /// Returns the number of a view's feature: that of an existing one at its position, or a new one.
    pub fn number(&mut self, view: &ImageFeatures, index: u32) -> u32 {
        let at_px = view.features.keypoints[index as usize];
        if let Some(known) = self.nearest(at_px) {
            return known;
        }
        let number = self.image.features.keypoints.len() as u32;
        add(&mut self.image.features, &view.features, index as usize);
        self.image.kept = None;
        self.image.colors.push(view.colors[index as usize]);
        self.squares.entry(square(at_px)).or_default().push(number);
        number
    }

    /// Returns the features so far.
    pub fn image(&self) -> &ImageFeatures {
        &self.image
    }

    /// Returns all features.
    pub fn into_image(self) -> ImageFeatures {
        self.image
    }

    fn nearest(&self, at_px: DVec2) -> Option<u32> {
        let [x, y] = square(at_px);
        let around = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| [x + dx, y + dy]));
        let near = around
            .filter_map(|square| self.squares.get(&square))
            .flatten()
            .copied();
        let keypoints = &self.image.features.keypoints;
        let distances = near.map(|number| (keypoints[number as usize].distance(at_px), number));
        let best = distances.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        best.filter(|&(distance, _)| distance <= RADIUS_PX)
            .map(|(_, number)| number)
    }
}

fn square(at_px: DVec2) -> [i64; 2] {
    (at_px / RADIUS_PX).floor().to_array().map(|v| v as i64)
}

/// Adds a feature of another list of the same kind.
fn add(features: &mut Features, from: &Features, index: usize) {
    features.keypoints.push(from.keypoints[index]);
    features.scales_px.extend(from.scales_px.get(index));
    features.orientations.extend(from.orientations.get(index));
    features.scores.extend(from.scores.get(index));
    match (&mut features.descriptors, &from.descriptors) {
        (Descriptors::Bytes { dim, values }, Descriptors::Bytes { values: others, .. }) => {
            values.extend_from_slice(&others[index * *dim..(index + 1) * *dim]);
        }
        (Descriptors::Floats { dim, values }, Descriptors::Floats { values: others, .. }) => {
            values.extend_from_slice(&others[index * *dim..(index + 1) * *dim]);
        }
        _ => {}
    }
}

/// Selects one-to-one matches from those of several views, preferring those that most views found.
pub fn one_to_one(found: impl IntoIterator<Item = (u32, u32)>) -> Vec<(u32, u32)> {
    let mut votes: BTreeMap<(u32, u32), u32> = BTreeMap::new();
    found
        .into_iter()
        .for_each(|pair| *votes.entry(pair).or_default() += 1);
    let mut ranked: Vec<((u32, u32), u32)> = votes.into_iter().collect();
    ranked.sort_by_key(|&(pair, votes)| (std::cmp::Reverse(votes), pair));
    let (mut firsts, mut seconds) = (FxHashSet::default(), FxHashSet::default());
    let mut pairs: Vec<(u32, u32)> = ranked.into_iter().map(|(pair, _)| pair).collect();
    pairs.retain(|(a, b)| {
        !firsts.contains(a) && !seconds.contains(b) && firsts.insert(*a) && seconds.insert(*b)
    });
    pairs.sort_unstable();
    pairs
}
