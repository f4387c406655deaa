//! Tests whether two depths belong to one surface.

/// Returns whether `depth` differs from `reference` by less than `share` of the reference.
///
/// Returns `false` if the reference is unknown (0) or one of them is NaN.
#[must_use]
#[inline(always)]
pub fn is_same_depth(depth: f32, reference: f32, share: f32) -> bool {
    (depth - reference).abs() < share * reference
}

/// Maximum difference between a point's depth and the depth map at which the point is visible.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthTolerance {
    /// Absolute part, in world units.
    pub absolute: f64,
    /// Relative part, as a share of the depth.
    pub relative: f64,
}

impl DepthTolerance {
    /// Returns the maximum difference at a depth, in world units.
    #[must_use]
    #[inline]
    pub fn at(&self, depth: f64) -> f64 {
        self.absolute + self.relative * depth
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depths_agree_within_a_share_of_the_reference() {
        assert!(is_same_depth(2.05, 2.0, 0.03) && is_same_depth(1.95, 2.0, 0.03));
        assert!(!is_same_depth(2.07, 2.0, 0.03) && !is_same_depth(1.93, 2.0, 0.03));
        assert!(is_same_depth(2.0, 2.0, 0.03));
    }

    #[test]
    fn unknown_depth_never_agrees() {
        for (depth, reference) in [(0.0, 0.0), (1.0, 0.0), (f32::NAN, 1.0), (1.0, f32::NAN)] {
            assert!(!is_same_depth(depth, reference, 0.03));
        }
    }

    #[test]
    fn tolerance_grows_with_the_depth() {
        let tolerance = DepthTolerance {
            absolute: 0.5,
            relative: 0.25,
        };
        assert_eq!((tolerance.at(0.0), tolerance.at(2.0)), (0.5, 1.0));
    }
}
