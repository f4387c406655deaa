use pulp::Arch;

use super::cells::{Comparison, Rule, SetCells, references};
use super::centres::Value;
use crate::sfm::{Descriptors, FeatureError, FeatureMatcher, Features, PairMatches};

/// Matches descriptors that are each other's nearest.
///
/// In images with many descriptors, only those that share one of their nearest k-means centres are
/// compared (an inverted file: J. Sivic and A. Zisserman, "Video Google", ICCV 2003). This finds
/// nearly all matches with a small part of the work.
///
/// The ratio test is from D. Lowe, "Distinctive Image Features from Scale-Invariant Keypoints",
/// IJCV 2004.
#[derive(Debug, Clone, Copy)]
pub struct NearestMatcher {
    rule: Rule,
}

impl NearestMatcher {
    /// Creates a matcher with a ratio test and a smallest cosine.
    ///
    /// For both descriptors, the distance to the nearest must be below `ratio` (0–1; 1 = any) times
    /// the distance to the second nearest. The cosine between the two must be larger than
    /// `min_cosine` (−1 = any).
    #[must_use]
    pub fn new(ratio: f32, min_cosine: f32) -> Self {
        Self {
            rule: Rule::new(ratio, min_cosine),
        }
    }

    /// Creates a matcher for SIFT: ratio 0.8, at most 0.7 rad between the two.
    #[must_use]
    pub fn for_bytes() -> Self {
        Self::new(0.8, 0.764_842)
    }

    /// Creates a matcher for learned descriptors such as XFeat's: no ratio test, cosine above 0.82.
    #[must_use]
    pub fn for_floats() -> Self {
        Self::new(1.0, 0.82)
    }

    /// Matches pairs of images that all have descriptors of `T`; an empty image has none.
    fn of_values<'a, T: Value + 'a>(&self, images: Vec<&'a [T]>, dim: usize) -> PairMatches<'a> {
        let (set, rule) = (SetCells::new(images, dim), self.rule);
        Box::new(move |first, second| {
            let values = [first, second].map(|image| set.values(image));
            let cells = [first, second].map(|image| set.of(image));
            let [forth, back] = Arch::new().dispatch(Comparison {
                cells,
                values,
                dim,
                rule,
            });
            let found = (0u32..)
                .zip(forth)
                .filter_map(|(at, found)| found.map(|other| (at, other)));
            Ok(found
                .filter(|&(at, other)| back[other as usize] == Some(at))
                .collect())
        })
    }
}

impl FeatureMatcher for NearestMatcher {
    fn name(&self) -> &'static str {
        "nearest"
    }

    /// The descriptors of some images determine the cells.
    fn shared_images(&self, images: &[&Features]) -> Vec<usize> {
        references(images.iter().map(|one| one.descriptors.len()))
    }

    fn matches(
        &self,
        first: &Features,
        second: &Features,
    ) -> Result<Vec<(u32, u32)>, FeatureError> {
        self.of_set(&[first, second])?(0, 1)
    }

    fn of_set<'a>(&'a self, images: &'a [&'a Features]) -> Result<PairMatches<'a>, FeatureError> {
        let kinds = || {
            images
                .iter()
                .map(|one| &one.descriptors)
                .filter(|one| !one.is_empty())
        };
        let Some(known) = kinds().next() else {
            return Ok(Box::new(|_, _| Ok(Vec::new())));
        };
        if let Some(other) =
            kinds().find(|other| other.dim() != known.dim() || is_bytes(other) != is_bytes(known))
        {
            return Err(FeatureError::Kinds(format!(
                "descriptors of {} {} and {} {} cannot be compared",
                known.dim(),
                noun(known),
                other.dim(),
                noun(other)
            )));
        }
        let all = images.iter().map(|one| &one.descriptors);
        Ok(if is_bytes(known) {
            self.of_values(
                all.map(|one| one.as_bytes().unwrap_or_default()).collect(),
                known.dim(),
            )
        } else {
            self.of_values(
                all.map(|one| one.as_floats().unwrap_or_default()).collect(),
                known.dim(),
            )
        })
    }
}

fn is_bytes(descriptors: &Descriptors) -> bool {
    descriptors.as_bytes().is_some()
}

fn noun(descriptors: &Descriptors) -> &'static str {
    if is_bytes(descriptors) {
        "bytes"
    } else {
        "floats"
    }
}
