use glam::Vec2;
use wide::f32x8;

use super::dis::PATCH;
use super::pyramid::{Level, PAD};

/// Steps of descent per patch and pass.
const STEPS: usize = 8;
/// A step shorter than this, in pixels, is the last.
const STILL: f32 = 0.02;
const PIXELS: f32 = (PATCH * PATCH) as f32;

/// A square of the first picture, made ready for the search of its match in the second.
pub(super) struct Patch {
    pub x: usize,
    pub y: usize,
    grey: [f32x8; PATCH],
    slope_x: [f32x8; PATCH],
    slope_y: [f32x8; PATCH],
    mean_slope: Vec2,
    /// Inverse of the Hessian: xx, xy, yy. Zero where the patch is too plain to be followed.
    inverse: [f32; 3],
}

/// How well a patch fits at a displacement, and which way it slides.
struct Fit {
    /// Sum of squared differences of grey levels, their mean taken out.
    cost: f32,
    slide: Vec2,
}

impl Patch {
    /// The patch whose top-left pixel is (x, y).
    pub fn new(level: &Level, x: usize, y: usize) -> Self {
        let row = |dx: isize, dy: isize, line: usize| {
            eight(
                &level.padded,
                level.place(x as isize + dx, (y + line) as isize + dy),
            )
        };
        let grey = std::array::from_fn(|line| row(0, 0, line));
        let half = f32x8::splat(0.5);
        let slope_x: [f32x8; PATCH] =
            std::array::from_fn(|line| (row(1, 0, line) - row(-1, 0, line)) * half);
        let slope_y: [f32x8; PATCH] =
            std::array::from_fn(|line| (row(0, 1, line) - row(0, -1, line)) * half);
        let sum = |a: &[f32x8; PATCH], b: &[f32x8; PATCH]| {
            a.iter()
                .zip(b)
                .fold(f32x8::ZERO, |sum, (&a, &b)| sum + a * b)
                .reduce_add()
        };
        let ones = [f32x8::ONE; PATCH];
        let mean_slope = Vec2::new(sum(&slope_x, &ones), sum(&slope_y, &ones)) / PIXELS;
        let xx = sum(&slope_x, &slope_x) - PIXELS * mean_slope.x * mean_slope.x;
        let xy = sum(&slope_x, &slope_y) - PIXELS * mean_slope.x * mean_slope.y;
        let yy = sum(&slope_y, &slope_y) - PIXELS * mean_slope.y * mean_slope.y;
        let determinant = xx * yy - xy * xy;
        let inverse = if determinant > 1.0 {
            [yy, -xy, xx].map(|h| h / determinant)
        } else {
            [0.0; 3]
        };
        Self {
            x,
            y,
            grey,
            slope_x,
            slope_y,
            mean_slope,
            inverse,
        }
    }

    /// Sum of squared differences to the second picture at this displacement, without the mean difference.
    pub fn cost(&self, other: &Level, displacement: Vec2) -> f32 {
        self.fit(other, displacement).cost
    }

    /// Descends from a displacement to the nearest best one (inverse compositional); the start where it strays farther
    /// than a patch.
    pub fn descend(&self, other: &Level, start: Vec2) -> Vec2 {
        let mut best = start;
        let mut fit = self.fit(other, start);
        for _ in 0..STEPS {
            let next = best - fit.slide;
            if (next - start).length_squared() > (PATCH * PATCH) as f32 {
                return start;
            }
            let after = self.fit(other, next);
            if after.cost >= fit.cost {
                break;
            }
            let still = fit.slide.length_squared() < STILL * STILL;
            (best, fit) = (next, after);
            if still {
                break;
            }
        }
        best
    }

    fn fit(&self, other: &Level, displacement: Vec2) -> Fit {
        let reach = PAD as f32 - 2.0;
        let x =
            (self.x as f32 + displacement.x).clamp(-reach, (other.width - PATCH) as f32 + reach);
        let y =
            (self.y as f32 + displacement.y).clamp(-reach, (other.height - PATCH) as f32 + reach);
        let (left, top) = (x.floor(), y.floor());
        let (u, v) = (f32x8::splat(x - left), f32x8::splat(y - top));
        let mut place = other.place(left as isize, top as isize);
        let line = |place: usize| {
            let (a, b) = (eight(&other.padded, place), eight(&other.padded, place + 1));
            a + (b - a) * u
        };
        let mut above = line(place);
        let (mut sum, mut squares, mut along_x, mut along_y) =
            (f32x8::ZERO, f32x8::ZERO, f32x8::ZERO, f32x8::ZERO);
        for row in 0..PATCH {
            place += other.stride;
            let below = line(place);
            let difference = above + (below - above) * v - self.grey[row];
            sum += difference;
            squares += difference * difference;
            along_x += difference * self.slope_x[row];
            along_y += difference * self.slope_y[row];
            above = below;
        }
        let sum = sum.reduce_add();
        let pull = Vec2::new(along_x.reduce_add(), along_y.reduce_add()) - self.mean_slope * sum;
        let [xx, xy, yy] = self.inverse;
        let slide = Vec2::new(xx * pull.x + xy * pull.y, xy * pull.x + yy * pull.y);
        Fit {
            cost: squares.reduce_add() - sum * sum / PIXELS,
            slide,
        }
    }
}

/// Eight values from a place on.
fn eight(values: &[f32], place: usize) -> f32x8 {
    let mut lanes = [0.0; 8];
    lanes.copy_from_slice(&values[place..place + 8]);
    f32x8::new(lanes)
}
