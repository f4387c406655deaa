use super::keypoint::{SiftFeatures, SiftKeypoint};
use std::cmp::Ordering;

/// A feature with what it is chosen by.
#[derive(Debug, Clone)]
pub(super) struct Feature {
    /// Where it is.
    pub keypoint: SiftKeypoint,
    /// Contrast of its peak, in grey.
    pub strength: f32,
    /// How its surroundings look.
    pub descriptor: [u8; 128],
}

/// The strongest features so far. Strong ones are found again more often and more exactly than large ones.
#[derive(Debug)]
pub(super) struct Strongest {
    most: usize,
    least: f32,
    features: Vec<Feature>,
}

impl Strongest {
    /// None yet, `most` at the end.
    pub fn new(most: usize) -> Self {
        Self {
            most,
            least: 0.0,
            features: Vec::new(),
        }
    }

    /// What is weaker will not be among the strongest.
    pub fn least_strength(&self) -> f32 {
        self.least
    }

    /// Adds features and drops the weakest where there are too many.
    pub fn add(&mut self, features: Vec<Feature>) {
        self.features.extend(features);
        if self.most > 0 && self.features.len() > self.most {
            let (_, weakest, _) = self
                .features
                .select_nth_unstable_by(self.most - 1, stronger_first);
            self.least = weakest.strength;
        }
        self.features.truncate(self.most);
    }

    /// All that stayed, the strongest first.
    pub fn into_features(mut self) -> SiftFeatures {
        self.features.sort_unstable_by(stronger_first);
        let (keypoints, descriptors) = self
            .features
            .into_iter()
            .map(|f| (f.keypoint, f.descriptor))
            .unzip();
        SiftFeatures {
            keypoints,
            descriptors,
        }
    }
}

/// An order without ties, so that the same features stay in whatever order they came.
fn stronger_first(a: &Feature, b: &Feature) -> Ordering {
    let place = |f: &Feature| {
        [
            f.keypoint.at_px.y,
            f.keypoint.at_px.x,
            f.keypoint.scale_px,
            f.keypoint.angle,
        ]
    };
    let places = place(a).into_iter().zip(place(b));
    b.strength.total_cmp(&a.strength).then_with(|| {
        places
            .map(|(a, b)| a.total_cmp(&b))
            .find(|&order| order != Ordering::Equal)
            .unwrap_or(Ordering::Equal)
    })
}
