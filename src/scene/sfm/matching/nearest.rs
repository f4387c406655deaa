use std::sync::OnceLock;

use pulp::{Arch, Simd, WithSimd};

use super::record::Rule;
use super::scan::nearest;
use super::sketch::Basis;
use super::value::Value;
use crate::scene::sfm::{Descriptors, FeatureError, FeatureMatcher, Features};

/// Pairs descriptors of which each is the other's nearest; which those are is found exactly.
///
/// The ratio test is from D. Lowe, "Distinctive Image Features from Scale-Invariant Keypoints", IJCV 2004.
#[derive(Debug)]
pub struct NearestMatcher {
    ratio: f32,
    min_cosine: f32,
    /// Found from the first pictures seen. It decides how fast the nearest are found, not which they are.
    basis: OnceLock<Basis>,
}

impl NearestMatcher {
    /// Both descriptors' nearest is nearer than `ratio` (0..1; 1 = any) of the distance to their second nearest, and the
    /// cosine between the two larger than `min_cosine` (−1 = any).
    #[must_use]
    pub fn new(ratio: f32, min_cosine: f32) -> Self {
        Self { ratio, min_cosine, basis: OnceLock::new() }
    }

    /// For SIFT: ratio 0.8, at most 0.7 rad between the two.
    #[must_use]
    pub fn for_bytes() -> Self {
        Self::new(0.8, 0.764_842)
    }

    /// For learned descriptors such as XFeat's: no ratio, cosine above 0.82.
    #[must_use]
    pub fn for_floats() -> Self {
        Self::new(1.0, 0.82)
    }

    fn values<T: Value>(&self, values: [&[T]; 2], dim: usize) -> Vec<(u32, u32)> {
        let basis = self.basis.get_or_init(|| Basis::fit(values, dim));
        let fitted = (basis.dim() != dim).then(|| Basis::fit(values, dim));
        let basis = fitted.as_ref().unwrap_or(basis);
        let rule = Rule::new(self.ratio, self.min_cosine);
        let [forth, back] = Arch::new().dispatch(BothWays { basis, values, dim, rule });
        (0u32..)
            .zip(forth)
            .filter_map(|(at, found)| found.map(|other| (at, other)))
            .filter(|&(at, other)| back[other as usize] == Some(at))
            .collect()
    }
}

/// The whole comparison of two pictures, compiled for the processor at hand.
struct BothWays<'a, T> {
    basis: &'a Basis,
    values: [&'a [T]; 2],
    dim: usize,
    rule: Rule,
}

impl<T: Value> BothWays<'_, T> {
    #[inline(always)]
    fn run<const FUSED: bool>(&self) -> [Vec<Option<u32>>; 2] {
        let first = self.basis.side::<FUSED, T>(self.values[0]);
        let second = self.basis.side::<FUSED, T>(self.values[1]);
        nearest::<FUSED, T>([&first, &second], self.dim, self.rule)
    }
}

impl<T: Value> WithSimd for BothWays<'_, T> {
    type Output = [Vec<Option<u32>>; 2];

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) -> Self::Output {
        if S::IS_SCALAR { self.run::<false>() } else { self.run::<true>() }
    }
}

impl FeatureMatcher for NearestMatcher {
    fn name(&self) -> &'static str {
        "nearest descriptors"
    }

    fn matches(&self, first: &Features, second: &Features) -> Result<Vec<(u32, u32)>, FeatureError> {
        let both = [&first.descriptors, &second.descriptors];
        if both.iter().any(|one| one.is_empty()) {
            return Ok(Vec::new());
        }
        let dims = both.map(Descriptors::dim);
        match both {
            [Descriptors::Bytes { values: a, .. }, Descriptors::Bytes { values: b, .. }] if dims[0] == dims[1] => {
                Ok(self.values([a, b], dims[0]))
            }
            [Descriptors::Floats { values: a, .. }, Descriptors::Floats { values: b, .. }] if dims[0] == dims[1] => {
                Ok(self.values([a, b], dims[0]))
            }
            _ => Err(FeatureError::Kinds(format!(
                "descriptors of {} and {} values cannot be compared",
                dims[0], dims[1]
            ))),
        }
    }
}
