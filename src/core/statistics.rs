//! Medians, quantiles and trimmed ranges.
//!
//! Values are compared in the total order of IEEE 754, so that a result depends neither on the
//! order of the values nor on the number of threads. NaN sorts above all numbers, or below them if
//! its sign is set.

use std::cmp::Ordering;
use std::ops::{Add, Mul, Sub};

/// Floating-point numbers of either precision.
pub trait Real: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// 1.
    const ONE: Self;
    /// 0.5.
    const HALF: Self;

    /// Compares by the total order of IEEE 754.
    fn total_order(&self, other: &Self) -> Ordering;
}

macro_rules! real {
    ($number:ty) => {
        impl Real for $number {
            const ONE: Self = 1.0;
            const HALF: Self = 0.5;

            #[inline]
            fn total_order(&self, other: &Self) -> Ordering {
                self.total_cmp(other)
            }
        }
    };
}

real!(f32);
real!(f64);

/// Returns the value with `place` values before it in ascending order.
///
/// Returns `None` if there are not that many values. Takes linear time and reorders the values.
#[inline]
pub fn nth_smallest<T: Real>(values: &mut [T], place: usize) -> Option<T> {
    if place >= values.len() {
        return None;
    }
    Some(*values.select_nth_unstable_by(place, T::total_order).1)
}

/// Returns the upper median: the middle value, or the larger of the two middle values.
///
/// Returns `None` without values, and reorders them. The result is one of the values; for depths or
/// colours, a mean of two values might lie on no surface.
#[inline]
pub fn upper_median<T: Real>(values: &mut [T]) -> Option<T> {
    nth_smallest(values, values.len() / 2)
}

/// Returns the median: the middle value, or the mean of the two middle values.
///
/// Returns `None` without values, and reorders them.
#[inline]
pub fn mean_median<T: Real>(values: &mut [T]) -> Option<T> {
    let last = values.len().checked_sub(1)?;
    let low = nth_smallest(values, last / 2)?;
    let high = nth_smallest(values, last.div_ceil(2))?;
    Some(T::HALF * (low + high))
}

/// Returns the value below which `share` (0 to below 1) of the values lie.
///
/// The number of values below is rounded down. Returns `None` without values, and reorders them.
#[inline]
pub fn quantile<T: Real>(values: &mut [T], share: f64) -> Option<T> {
    nth_smallest(values, (share * values.len() as f64) as usize)
}

/// Returns the smallest and the largest value without the `cut` smallest and the `cut` largest.
///
/// Returns `None` for fewer than `cut + 1` values, and reorders them.
#[inline]
pub fn trimmed_range<T: Real>(values: &mut [T], cut: usize) -> Option<[T; 2]> {
    let last = values.len().checked_sub(cut + 1)?;
    Some([nth_smallest(values, cut)?, nth_smallest(values, last)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns 0 to `count` − 1, shuffled.
    fn shuffled(count: usize) -> Vec<f64> {
        (0..count).map(|at| (at * 7 % count) as f64).collect()
    }

    #[test]
    fn nth_smallest_ignores_the_order() {
        for place in 0..10 {
            assert_eq!(nth_smallest(&mut shuffled(10), place), Some(place as f64));
        }
        assert_eq!(nth_smallest(&mut shuffled(10), 10), None);
        assert_eq!(nth_smallest::<f32>(&mut [], 0), None);
    }

    #[test]
    fn medians_of_even_and_odd_counts() {
        assert_eq!(upper_median(&mut shuffled(5)), Some(2.0));
        assert_eq!(upper_median(&mut shuffled(6)), Some(3.0));
        assert_eq!(mean_median(&mut shuffled(5)), Some(2.0));
        assert_eq!(mean_median(&mut shuffled(6)), Some(2.5));
        assert_eq!(mean_median(&mut [4.0_f32]), Some(4.0));
        assert_eq!(upper_median::<f32>(&mut []), None);
        assert_eq!(mean_median::<f32>(&mut []), None);
    }

    #[test]
    fn nan_is_above_all_numbers() {
        let mut values = [f32::NAN, 1.0, f32::INFINITY];
        assert_eq!(upper_median(&mut values), Some(f32::INFINITY));
    }

    #[test]
    fn quantiles_are_rounded_down() {
        assert_eq!(quantile(&mut shuffled(10), 0.0), Some(0.0));
        assert_eq!(quantile(&mut shuffled(10), 0.5), Some(5.0));
        assert_eq!(quantile(&mut shuffled(10), 0.99), Some(9.0));
        assert_eq!(quantile::<f64>(&mut [], 0.5), None);
    }

    #[test]
    fn trimmed_ranges_leave_out_both_ends() {
        assert_eq!(trimmed_range(&mut shuffled(10), 0), Some([0.0, 9.0]));
        assert_eq!(trimmed_range(&mut shuffled(10), 2), Some([2.0, 7.0]));
        assert_eq!(trimmed_range(&mut [3.0_f32], 0), Some([3.0, 3.0]));
        assert_eq!(trimmed_range(&mut [3.0_f32], 1), None);
    }
}
