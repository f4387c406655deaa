/// Number of halvings of an interval after which the roots in it count as one.
const MAX_DEPTH: u32 = 45;
/// Step of Newton's method below which the root is exact up to rounding.
const SMALL_STEP: f64 = 1e-10;
/// Margin of the first search beyond ±1, so that it includes roots at ±1.
const HAIR: f64 = 1e-9;
/// Maximum number of steps that refine one root.
const MAX_STEPS: usize = 60;

/// Returns all real roots of the polynomial `Σ coefficients[i] zⁱ`, in no particular order.
///
/// Roots that are equal up to rounding are returned once. A Sturm chain counts the roots in an
/// interval. Intervals are halved until each contains one root, which Newton's method, confined to
/// the interval, then finds. Roots beyond ±1 are found as reciprocals, so that none is too large.
/// (D. G. Hook, P. R. McAree, *Using Sturm Sequences to Bracket Real Roots of Polynomial
/// Equations*, Graphics Gems, 1990.)
pub(super) fn real_roots<const N: usize>(coefficients: &[f64; N]) -> Vec<f64> {
    let mut roots = Vec::new();
    let largest = coefficients
        .iter()
        .fold(0.0, |most: f64, c| most.max(c.abs()));
    if largest <= 0.0 || !coefficients.iter().all(|c| c.is_finite()) {
        return roots;
    }
    let scaled = coefficients.map(|c| c / largest);
    within_one(&scaled, &mut roots);
    let inner = roots.len();
    let mut reversed = scaled;
    reversed.reverse();
    within_one(&reversed, &mut roots);
    let mut kept = inner;
    for i in inner..roots.len() {
        let root = roots[i];
        // Roots at ±1 were found above; roots near 0 stand for infinity.
        if (HAIR..1.0 - HAIR).contains(&root.abs()) {
            roots[kept] = 1.0 / root;
            kept += 1;
        }
    }
    roots.truncate(kept);
    roots
}

/// An interval and the number of sign changes of the chain at its ends.
struct Interval {
    ends: [f64; 2],
    changes: [i64; 2],
    depth: u32,
}

/// Number of parts of the first search; their ends are evaluated at once.
const PARTS: usize = 3;

/// Returns the roots from −1 to 1.
fn within_one<const N: usize>(polynomial: &[f64; N], roots: &mut Vec<f64>) {
    let chain = Chain::new(polynomial);
    let ends: [f64; PARTS + 1] =
        std::array::from_fn(|i| (1.0 + HAIR) * (2.0 * i as f64 / PARTS as f64 - 1.0));
    let changes = chain.sign_changes(&ends);
    let mut open = Vec::new();
    for part in 0..PARTS {
        open.push(Interval {
            ends: [ends[part], ends[part + 1]],
            changes: [changes[part], changes[part + 1]],
            depth: 0,
        });
        while let Some(Interval {
            ends,
            changes,
            depth,
        }) = open.pop()
        {
            let count = changes[0] - changes[1];
            if count <= 0 {
                continue;
            }
            let middle = 0.5 * (ends[0] + ends[1]);
            let alone = if count == 1 {
                refine(polynomial, ends)
            } else {
                None
            };
            if let Some(root) = alone.or((depth == MAX_DEPTH).then_some(middle)) {
                roots.push(root);
                continue;
            }
            let [between] = chain.sign_changes(&[middle]);
            let depth = depth + 1;
            open.push(Interval {
                ends: [ends[0], middle],
                changes: [changes[0], between],
                depth,
            });
            open.push(Interval {
                ends: [middle, ends[1]],
                changes: [between, changes[1]],
                depth,
            });
        }
    }
}

/// Sturm chain, stored as its quotients.
///
/// Each member is `(slope · z + offset) · next − share · next but one`, so that evaluating it costs
/// two multiplications per member.
struct Chain<const N: usize> {
    quotients: [[f64; 3]; N],
    length: usize,
    last: f64,
}

impl<const N: usize> Chain<N> {
    fn new(polynomial: &[f64; N]) -> Self {
        let mut chain = Self {
            quotients: [[0.0; 3]; N],
            length: 0,
            last: 0.0,
        };
        let mut above = *polynomial;
        let mut degree = (0..N).rev().find(|&i| above[i].abs() > 0.0).unwrap_or(0);
        let mut below = [0.0; N];
        (1..=degree).for_each(|i| below[i - 1] = above[i] * i as f64);
        while degree > 0 && below[degree - 1].abs() > 0.0 {
            let lead = 1.0 / below[degree - 1];
            let slope = above[degree] * lead;
            let next_below = if degree > 1 { below[degree - 2] } else { 0.0 };
            let offset = (above[degree - 1] - slope * next_below) * lead;
            let mut rest = [0.0; N];
            for i in 0..degree - 1 {
                let shifted = if i > 0 { below[i - 1] } else { 0.0 };
                rest[i] = slope * shifted + offset * below[i] - above[i];
            }
            let share = rest[..degree - 1]
                .iter()
                .fold(0.0, |most: f64, c| most.max(c.abs()));
            if share > 0.0 {
                rest[..degree - 1].iter_mut().for_each(|c| *c /= share);
            }
            chain.quotients[chain.length] = [slope, offset, share];
            chain.length += 1;
            chain.last = below[degree - 1];
            (above, below) = (below, rest);
            degree -= 1;
        }
        chain
    }

    /// Returns the number of sign changes along the chain at each of several positions.
    fn sign_changes<const M: usize>(&self, places: &[f64; M]) -> [i64; M] {
        let (mut value, mut before, mut changes) = ([self.last; M], [0.0; M], [0; M]);
        for [slope, offset, share] in self.quotients[..self.length].iter().rev() {
            for i in 0..M {
                let next = (slope * places[i] + offset) * value[i] - share * before[i];
                changes[i] += i64::from((next < 0.0) != (value[i] < 0.0));
                (before[i], value[i]) = (value[i], next);
            }
        }
        changes
    }
}

/// Returns the single root in an interval; `None` for a root without a sign change.
///
/// Takes Newton steps, and bisects if a step would leave the interval.
fn refine<const N: usize>(polynomial: &[f64; N], [mut low, mut high]: [f64; 2]) -> Option<f64> {
    let rises = evaluate(polynomial, high).0 > 0.0;
    if rises == (evaluate(polynomial, low).0 > 0.0) {
        return None;
    }
    let mut z = 0.5 * (low + high);
    for _ in 0..MAX_STEPS {
        let (value, slope) = evaluate(polynomial, z);
        if (value > 0.0) == rises {
            high = z;
        } else {
            low = z;
        }
        let step = z - value / slope;
        let next = if step > low && step < high {
            step
        } else {
            0.5 * (low + high)
        };
        if (next - z).abs() <= SMALL_STEP {
            return Some(next);
        }
        z = next;
    }
    Some(z)
}

/// Returns value and derivative.
fn evaluate<const N: usize>(polynomial: &[f64; N], z: f64) -> (f64, f64) {
    polynomial
        .iter()
        .rev()
        .fold((0.0, 0.0), |(value, slope), c| {
            (value * z + c, slope * z + value)
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_large_negative_and_close_roots_are_found() {
        let truth = [-40.0, -1.0, -0.3, 0.0, 1e-4, 0.999, 1.0, 1.001, 5.0, 3000.0];
        let mut polynomial = [0.0; 11];
        polynomial[0] = 1.0;
        for root in truth {
            for i in (0..11).rev() {
                polynomial[i] = if i > 0 { polynomial[i - 1] } else { 0.0 } - root * polynomial[i];
            }
        }
        let mut found = real_roots(&polynomial);
        found.sort_by(f64::total_cmp);
        assert_eq!(found.len(), truth.len(), "{found:?}");
        for (f, t) in found.iter().zip(truth) {
            assert!((f - t).abs() < 1e-6 * t.abs().max(1.0), "{f} {t}");
        }
    }

    #[test]
    fn polynomials_without_real_roots_have_none() {
        assert!(real_roots(&[1.0, 0.0, 1.0]).is_empty());
        assert!(real_roots(&[0.0; 4]).is_empty());
        assert!(real_roots(&[1.0, f64::NAN, 1.0]).is_empty());
        let found = real_roots(&[2.0, 1.0, 0.0, 0.0]);
        assert!(
            found.len() == 1 && (found[0] + 2.0).abs() < 1e-9,
            "{found:?}"
        );
    }

    #[test]
    fn double_root_is_found_at_most_once_and_other_roots_are_not_lost() {
        // (z − 0.5)² (z + 0.25)
        let found = real_roots(&[0.0625, 0.0, -0.75, 1.0]);
        assert!(found.iter().any(|z| (z + 0.25).abs() < 1e-9), "{found:?}");
        assert!(
            found
                .iter()
                .all(|z| (z + 0.25).abs() < 1e-9 || (z - 0.5).abs() < 1e-6),
            "{found:?}"
        );
    }
}
