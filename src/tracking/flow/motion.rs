use glam::{Affine2, Mat2, Vec2};
use rand::RngExt;
use rand_pcg::Pcg32;

/// A position in one frame and its match in the other.
#[derive(Debug, Clone, Copy)]
pub(super) struct PointMatch {
    pub from: Vec2,
    pub to: Vec2,
}

const TRIES: usize = 120;
const SEED: u64 = 7;

/// Estimates the similarity transform that most matches agree with, and their share.
///
/// A match agrees if its error is below `tolerance_px`. Returns `None` for fewer than two matches.
///
/// Method: RANSAC (Fischler, Bolles, "Random sample consensus", CACM 1981), then least squares.
pub(super) fn similarity(matches: &[PointMatch], tolerance_px: f32) -> Option<(Affine2, f32)> {
    let inliers = |motion: &Affine2| -> Vec<PointMatch> {
        let near = |pair: &&PointMatch| {
            motion.transform_point2(pair.from).distance_squared(pair.to) < tolerance_px.powi(2)
        };
        matches.iter().filter(near).copied().collect()
    };
    let mut dice = Pcg32::new(SEED, 0);
    let mut best: Vec<PointMatch> = Vec::new();
    for _ in 0..TRIES {
        let pair = draw::<2>(matches, &mut dice)?;
        let agreeing = least_squares_similarity(&pair)
            .map(|motion| inliers(&motion))
            .unwrap_or_default();
        if agreeing.len() > best.len() {
            best = agreeing;
        }
    }
    let share = best.len() as f32 / matches.len() as f32;
    least_squares_similarity(&best).map(|motion| (motion, share))
}

/// Fits a similarity transform with Umeyama's closed form in 2-D.
///
/// Returns `None` if all matches start at one position.
fn least_squares_similarity(matches: &[PointMatch]) -> Option<Affine2> {
    let count = matches.len() as f32;
    let from = matches.iter().map(|pair| pair.from).sum::<Vec2>() / count;
    let to = matches.iter().map(|pair| pair.to).sum::<Vec2>() / count;
    let (mut dot, mut cross, mut spread) = (0.0, 0.0, 0.0);
    for pair in matches {
        let (a, b) = (pair.from - from, pair.to - to);
        dot += a.dot(b);
        cross += a.perp_dot(b);
        spread += a.length_squared();
    }
    if !(spread > 1e-3 && spread.is_finite()) {
        return None;
    }
    let turn = Mat2::from_cols(
        Vec2::new(dot, cross) / spread,
        Vec2::new(-cross, dot) / spread,
    );
    Some(Affine2::from_mat2_translation(turn, to - turn * from))
}

/// Image motion of a rigid plane, or of any scene seen by a rotating camera.
///
/// It has eight parameters and is quadratic in the position (Longuet-Higgins, "The visual ambiguity
/// of a moving plane", Proc. R. Soc. B, 1984).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PlaneMotion {
    terms: [f32; 8],
    /// Origin of the positions; `unit_px` is their unit.
    centre: Vec2,
    unit_px: f32,
}

const TERMS: usize = 8;

impl PlaneMotion {
    /// Estimates the motion that most matches agree with to within `tolerance_px`.
    ///
    /// Uses RANSAC over four matches, then least squares over the inliers. Returns `None` for fewer
    /// than four matches, or if they do not determine a motion.
    pub fn of(matches: &[PointMatch], centre: Vec2, tolerance_px: f32) -> Option<Self> {
        let mut dice = Pcg32::new(SEED, 1);
        let mut best: Vec<PointMatch> = Vec::new();
        let fit = |matches: &[PointMatch]| Self::least_squares(matches, centre);
        let inliers = |motion: &Self| -> Vec<PointMatch> {
            let near = |pair: &&PointMatch| motion.miss(pair) < tolerance_px;
            matches.iter().filter(near).copied().collect()
        };
        for _ in 0..TRIES {
            let agreeing = fit(&draw::<4>(matches, &mut dice)?)
                .map(|motion| inliers(&motion))
                .unwrap_or_default();
            if agreeing.len() > best.len() {
                best = agreeing;
            }
        }
        fit(&best)
    }

    /// Returns the displacement of a pixel, in pixels.
    pub fn displacement(&self, at: Vec2) -> Vec2 {
        let p = (at - self.centre) / self.unit_px;
        let rows = rows(p);
        let dot = |row: &[f32; TERMS]| row.iter().zip(self.terms).map(|(a, b)| a * b).sum::<f32>();
        Vec2::new(dot(&rows[0]), dot(&rows[1]))
    }

    /// Returns the distance in pixels between a match's end and the end this motion predicts.
    fn miss(&self, pair: &PointMatch) -> f32 {
        (pair.from + self.displacement(pair.from)).distance(pair.to)
    }

    fn least_squares(matches: &[PointMatch], centre: Vec2) -> Option<Self> {
        let unit_px = centre.max_element().max(1.0);
        let mut normal = [[0.0f64; TERMS + 1]; TERMS];
        for pair in matches {
            let displacement = pair.to - pair.from;
            let rows = rows((pair.from - centre) / unit_px);
            for (row, value) in rows.iter().zip([displacement.x, displacement.y]) {
                for (line, &a) in normal.iter_mut().zip(row) {
                    for (out, &b) in line.iter_mut().zip(row) {
                        *out += f64::from(a * b);
                    }
                    line[TERMS] += f64::from(a * value);
                }
            }
        }
        let terms = solved(normal)?.map(|term| term as f32);
        Some(Self {
            terms,
            centre,
            unit_px,
        })
    }
}

/// Returns the two rows of the linear system for one position.
fn rows(p: Vec2) -> [[f32; TERMS]; 2] {
    [
        [1.0, p.x, p.y, 0.0, 0.0, 0.0, p.x * p.x, p.x * p.y],
        [0.0, 0.0, 0.0, 1.0, p.x, p.y, p.x * p.y, p.y * p.y],
    ]
}

/// Solves the system by Gaussian elimination with row pivots; `None` if it is singular.
fn solved(mut system: [[f64; TERMS + 1]; TERMS]) -> Option<[f64; TERMS]> {
    for column in 0..TERMS {
        let pivot = (column..TERMS)
            .max_by(|&a, &b| system[a][column].abs().total_cmp(&system[b][column].abs()))?;
        system.swap(column, pivot);
        let lead = system[column];
        if lead[column].abs() < 1e-9 {
            return None;
        }
        for (_, line) in system
            .iter_mut()
            .enumerate()
            .filter(|(row, _)| *row != column)
        {
            let share = line[column] / lead[column];
            line.iter_mut()
                .zip(lead)
                .skip(column)
                .for_each(|(value, lead)| *value -= share * lead);
        }
    }
    Some(std::array::from_fn(|row| {
        system[row][TERMS] / system[row][row]
    }))
}

fn draw<const N: usize>(matches: &[PointMatch], dice: &mut Pcg32) -> Option<[PointMatch; N]> {
    (matches.len() >= N)
        .then(|| std::array::from_fn(|_| matches[dice.random_range(0..matches.len())]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn matches(motion: impl Fn(Vec2) -> Vec2) -> Vec<PointMatch> {
        let mut dice = Pcg32::new(1, 2);
        let pair = |at: usize| {
            let from = Vec2::new(
                dice.random_range(0.0..640.0f32),
                dice.random_range(0.0..360.0f32),
            );
            // Every third match is an outlier.
            let residual = Vec2::new(
                dice.random_range(-40.0..40.0f32),
                dice.random_range(-40.0..40.0f32),
            );
            PointMatch {
                from,
                to: if at.is_multiple_of(3) {
                    from + residual
                } else {
                    motion(from)
                },
            }
        };
        (0..300).map(pair).collect()
    }

    #[test]
    fn similarity_is_recovered_despite_outliers() {
        let truth =
            Affine2::from_scale_angle_translation(Vec2::splat(1.03), 0.05, Vec2::new(4.0, -7.0));
        let (found, share) =
            similarity(&matches(|from| truth.transform_point2(from)), 1.0).unwrap();
        for corner in [Vec2::ZERO, Vec2::new(640.0, 360.0)] {
            assert!(
                found
                    .transform_point2(corner)
                    .distance(truth.transform_point2(corner))
                    < 0.05
            );
        }
        assert!((0.64..0.72).contains(&share), "{share}");
        assert!(similarity(&[], 1.0).is_none());
    }

    #[test]
    fn plane_motion_is_recovered_despite_outliers() {
        let truth = |p: Vec2| {
            let q = (p - Vec2::new(320.0, 180.0)) / 320.0;
            p + Vec2::new(
                12.0 + 2.0 * q.y + 3.0 * q.x * q.x,
                1.0 - q.x + 3.0 * q.x * q.y,
            )
        };
        let found = PlaneMotion::of(&matches(truth), Vec2::new(320.0, 180.0), 0.5).unwrap();
        for corner in [Vec2::ZERO, Vec2::new(640.0, 0.0), Vec2::new(300.0, 360.0)] {
            assert!((corner + found.displacement(corner)).distance(truth(corner)) < 0.05);
        }
        assert!(PlaneMotion::of(&[], Vec2::ONE, 0.5).is_none());
    }
}
